"""What a bag shows at one moment, as its messages up to there say."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.poses import Pose
from mrs_tools.diagnosis.diagnose import Check, causes_in
from mrs_tools.diagnosis.facts import Facts
from mrs_tools.diagnosis.look import take_report
from mrs_tools.view import protocol
from mrs_tools.view.state import HeadView, TeamState

#: Trails go back so far, as on the page [ns].
TRAIL_NS = 8_000_000_000
#: A report on `/diagnostics` holds for so long [ns].
_REPORT_NS = 5_000_000_000


@dataclass(frozen=True)
class MapCells:
    """Cells of an interval.

    Attributes:
        xy: In the map [m], shape (n, 2).
        robot: Which of the interval's robots each comes from, shape (n,).
    """

    xy: Float
    robot: Int


@dataclass(frozen=True)
class Found:
    """The people of one interval.

    Attributes:
        stamp_ns: Stamp of the interval [ns].
        persons: Everybody, also who is hidden.
        groups: Their groups.
        poses: By robot, where it was.
        cells: Their cells; None: they come by themselves.
    """

    stamp_ns: int
    persons: Sequence[Person]
    groups: Sequence[Group]
    poses: Mapping[str, Pose]
    cells: MapCells | None = None


class Moment:
    """What is shown, fed with the messages of a bag in their order, at the times of its record.

    Args:
        heads: By robot, what it sees, as far as that is known.

    Attributes:
        changes: How often something that `state` shows has changed.
    """

    def __init__(self, heads: Mapping[str, HeadView]) -> None:
        self.changes = 0
        self._team = TeamState(dict(heads))
        self._trails: defaultdict[int, deque[tuple[int, Float]]] = defaultdict(deque)
        self._people_ns: int | None = None
        self._truth: Float | None = None
        self._scanned: Sequence[str] = ()
        self._cells: tuple[int, MapCells] | None = None
        self._reports = Facts(0, nodes=[])
        self._reported_ns: int | None = None

    # ---- messages ----

    def take_people(self, time_ns: int, found: Found) -> None:
        """Takes the people of an interval."""
        self.changes += 1
        self._people_ns = time_ns
        self._team.show(found.stamp_ns, found.persons, found.groups, found.poses, time_ns / 1e9)
        self._scanned = list(found.poses)
        if found.cells is not None:
            self._cells = time_ns, found.cells
        present = {person.id for person in found.persons if person.id}
        for gone in self._trails.keys() - present:
            del self._trails[gone]
        for person in found.persons:
            if person.id:
                trail = self._trails[person.id]
                trail.append((time_ns, person.position))
                while trail[0][0] < time_ns - TRAIL_NS:
                    trail.popleft()

    def take_pose(self, time_ns: int, robot: str, message: Any) -> None:
        """Takes a robot's PoseWithCovarianceStamped.

        Raises:
            PeopleLocError: It cannot be used.
        """
        self._team.take_pose(robot, message, time_ns / 1e9)
        self.changes += 1

    def take_truth(self, _time_ns: int, places: Float) -> None:
        """Takes the true places of people [m], shape (n, 2)."""
        self.changes += 1
        self._truth = places

    def take_status(self, time_ns: int, message: Any) -> None:
        """Takes a mrs_people_msgs/GuideStatus."""
        self.changes += 1
        self._team.take_status(message, time_ns / 1e9)

    def take_cells(self, time_ns: int, cells: MapCells) -> None:
        """Takes the cells of the robots of the last interval."""
        self._cells = time_ns, cells

    def take_diagnostics(self, time_ns: int, message: Any) -> None:
        """Takes a diagnostic_msgs/DiagnosticArray."""
        take_report(self._reports, message)
        self._reported_ns = time_ns

    # ---- what is shown ----

    def state(self, now_ns: int, *, with_trails: bool) -> protocol.State:
        """Everybody and every robot.

        Args:
            now_ns: The moment [ns].
            with_trails: Whether the page is told where people have been.
        """
        state = self._team.state(now_ns / 1e9)
        state["t"] = None if self._people_ns is None else seconds(self._people_ns)
        if self._truth is not None:
            state["truth"] = np.round(self._truth, 3).tolist()
        if with_trails:
            state["trails"] = {
                str(one): [[seconds(ns), *np.round(xy, 3).tolist()] for ns, xy in trail]
                for one, trail in self._trails.items()
            }
        return state

    def cells(self) -> protocol.Cells | None:
        """The robots' cells; None: there are none."""
        if self._cells is None:
            return None
        time_ns, cells = self._cells
        of_robot = {name: cells.xy[cells.robot == k] for k, name in enumerate(self._scanned)}
        flat = {name: np.round(xy, 3).reshape(-1).tolist() for name, xy in of_robot.items()}
        return protocol.Cells(type="cells", t=seconds(time_ns), robots=flat)

    def checks(self, now_ns: int) -> list[Check] | None:
        """What was not well with the team, by its last reports; None: there is none."""
        if self._reported_ns is None or now_ns - self._reported_ns > _REPORT_NS:
            return None
        return causes_in(self._reports.reports)


def seconds(time_ns: int) -> float:
    """A time of the bag [s], to the millisecond."""
    return round(time_ns / 1e9, 3)
