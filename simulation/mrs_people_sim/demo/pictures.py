"""Pictures of a team that was replayed through its real processes."""

from __future__ import annotations

import dataclasses
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mrs_people_loc import messages
from mrs_people_loc.arrays import Float
from mrs_people_loc.config import Team
from mrs_people_loc.errors import BagError
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.sensing.camera import CameraModel, StereoCamera
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_sim.demo.replayed_team import Listener
from mrs_people_sim.demo.steps import step
from mrs_people_sim.figures.animation import animate, headline, with_trails
from mrs_people_sim.figures.plots import TopView, draw_top_view, seen_floor
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.records import Truth
from mrs_tools.bags.sources import read_grid
from mrs_tools.bags.truth import read_truth
from mrs_tools.plain import plain
from mrs_tools.view.recorded import read_found, read_map_cells
from mrs_tools.view.results import Results

if TYPE_CHECKING:
    from rich.console import Console

#: What is drawn of the cells, of which there may be none.
_NO_CELLS = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("robot", "<u4"), ("cluster", "<i4"), ("person", "<i4")]
)


def stamp_of(message: Any) -> int:
    """The stamp of a message [ns]."""
    return stamp_ns_of(message.header.stamp)


@dataclass(frozen=True)
class RecordedTeam:
    """What a bag itself tells.

    Attributes:
        truth: The ground truth.
        grid: Walls and furniture; None: it says nothing of them.
        borders: By robot, what its camera sees of the floor, in its base_link [m].
        start_ns: Bag time of its beginning [ns].
        end_ns: Bag time of its end [ns].
    """

    truth: Truth
    grid: OccupancyGrid | None
    borders: dict[str, Float]
    start_ns: int = 0
    end_ns: int = 0


def read_team_bag(path: Path, config: Team) -> RecordedTeam:
    """Reads what a bag holds besides the messages that are replayed.

    Raises:
        BagError: The bag cannot be read, or lacks the calibration of a robot of the team.
    """
    infos: dict[str, CameraModel] = {}
    with BagReader(path) as bag:
        wanted = [t for t in bag.topics if t.endswith(("left/camera_info", "right/camera_info"))]
        missing = [r for r in config.robots if f"/{r}/left/camera_info" not in wanted]
        if missing:
            raise BagError(
                f"{path}: has no camera_info of {', '.join(missing)}; "
                f"topics: {', '.join(bag.topics)}"
            )
        for topic, _, message in bag.decoded(wanted):
            if topic not in infos:
                infos[topic] = messages.read_camera_info(message)
        truth, grid = read_truth(bag), read_grid(bag, config.planner.map_frame)
        start_ns, end_ns = bag.start_ns, bag.end_ns
    borders = {}
    for robot, settings in config.robots.items():
        left, right = (infos[f"/{robot}/{camera}/camera_info"] for camera in ("left", "right"))
        camera = StereoCamera.from_models(left, right, mounting=settings.mounting)
        reach = settings.disparity
        borders[robot] = seen_floor(camera, reach.min_range, reach.max_range)
    return RecordedTeam(truth, grid, borders, start_ns, end_ns)


def draw_demo(
    views: Sequence[TopView], robots: int, out: Path, console: Console, *, gif: bool
) -> None:
    """Draws one interval, and all of them as an animation beside it, if that is wanted.

    The one has all robots, and as many people as most intervals. Of several it is the last; if
    somebody fell behind, the one in which they were farthest from their group.
    """
    whole = [view for view in with_trails(views) if len(view.robots) == robots]
    counts = Counter(len(view.people) for view in whole)
    usual = max(counts, key=lambda count: (counts[count], count))
    whole = [view for view in whole if len(view.people) == usual]
    shown = max(reversed(whole), key=_farthest_behind)
    at_s = (shown.stamp_ns - views[0].stamp_ns) / 1e9
    with step(console, f"drawing {out}"):
        title = f"after {at_s:.1f} s: {headline(shown)}"
        draw_top_view(dataclasses.replace(shown, title=title), out)
    if not gif:
        return
    film = out.with_suffix(".gif")
    with step(console, f"drawing {film}") as on_progress:
        animate(views, film, on_progress=on_progress)


def _farthest_behind(view: TopView) -> float:
    """How far stragglers are from the centres of their groups [m]; 0: there is none."""
    places = {person.id: person.position for person in view.people}
    return max(
        (
            float(np.hypot(*(places[one] - group.centre)))
            for group in view.groups
            for one in group.stragglers
            if one in places
        ),
        default=0.0,
    )


def views_of(
    people: Sequence[Any], listener: Listener, recorded: RecordedTeam, config: Team
) -> list[TopView]:
    """The map of each interval; each event is that of the last interval before it was heard."""
    stamps_ns = [stamp_of(message) for message in people]
    events: defaultdict[int, list[str]] = defaultdict(list)
    for heard_ns, event in listener.events:
        events[max(0, bisect_right(stamps_ns, heard_ns) - 1)].append(event)
    return [
        _top_view(message, listener.maps.get(stamp_ns), recorded, config, events[index])
        for index, (stamp_ns, message) in enumerate(zip(stamps_ns, people, strict=True))
    ]


def results_of(people: Sequence[Any], listener: Listener, recorded: RecordedTeam) -> Results:
    """The people of each interval, for the page; their bag times are the stamps.

    Args:
        people: The `tracked_people` messages, by stamp.
        listener: What else the team said.
        recorded: The bag that was replayed.
    """
    results = Results(recorded.start_ns)
    for message in people:
        stamp_ns = stamp_of(message)
        cells = listener.maps.get(stamp_ns)
        found = read_found(message, None if cells is None else read_map_cells(cells))
        results.add(stamp_ns, found)
    results.events = [(heard_ns, plain(event)) for heard_ns, event in listener.events]
    results.ready_ns = recorded.end_ns
    return results


def _top_view(
    message: Any,
    cells: Any,
    recorded: RecordedTeam,
    config: Team,
    events: Sequence[str],
) -> TopView:
    if cells is None:
        records = np.empty(0, _NO_CELLS)
    else:
        # Our own topic: every field has four bytes, floats first, whole numbers after them.
        kinds = {7: "<f4", 6: "<u4", 5: "<i4"}
        layout = np.dtype([(f.name, kinds[f.datatype]) for f in cells.fields])
        records = np.frombuffer(cells.data, layout)
    stamp_ns = stamp_of(message)
    people, groups = messages.read_people(message, message.header.frame_id.lstrip("/"))
    true, visible = recorded.truth.at(stamp_ns)
    return TopView(
        title="",
        stamp_ns=stamp_ns,
        xy=np.stack([records["x"], records["y"]], axis=1).astype(np.float64),
        robot=records["robot"],
        cluster=records["cluster"],
        person=records["person"],
        robots=messages.read_people_scans(message),
        views=recorded.borders,
        people=people,
        groups=groups,
        truth=true,
        circle_sigmas=config.planner.human.circle_sigmas,
        visible=visible,
        events=events,
        grid=recorded.grid,
    )
