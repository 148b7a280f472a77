"""Converts data sets of UTIAS MRCLAM: real wheels, measured ranges and bearings, motion capture.

The bag is what robots of ours would send: a landmark is a person who stands, a team-mate is
something low that is nobody. Barcodes tell who is who in the data; in the bag nothing does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.errors import BagError
from mrs_people_loc.geometry import rotation_2d, wrap_angles
from mrs_people_loc.scan import Cells, Scan
from mrs_people_sim.render_scene import team_file
from mrs_people_sim.robot_writer import RobotWriter
from mrs_studies.recordings.frames import EPOCH_NS
from mrs_studies.recordings.mrclam_files import Mrclam, MrclamRobot, read_mrclam
from mrs_tools.bags.writer import BagWriter

#: x, y [m] and yaw [rad].
_Place = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """What bodies of a kind look like.

    Attributes:
        score: Log-odds of being a person.
        top: Height [m].
    """

    score: float
    top: float


@dataclass(frozen=True)
class MrclamTuning:
    """Constants of the conversion.

    Ranges come from the height of a barcode in an image, so that their errors grow in proportion.
    Sigmas are those of data set 6 against motion capture, without the 3 % that are farther off than
    five robust sigmas.

    Attributes:
        odometry_s: Period of the odometry [s].
        truth_s: Poses of motion capture are no nearer in time than this [s].
        people_s: Period of the truth about landmarks [s] ...
        seen_s: ... of which those are seen that are measured no farther away in time than this [s].
        scan_s: A scan is of measurements no farther apart in time than this [s].
        silence_s: Where there are none for longer, the camera saw nobody: empty scans ...
        period_s: ... with its period [s].
        start_s: Where odometry begins is known from the truth of so long [s] ...
        odometry: ... to within `start_sigmas`, x, y [m] and yaw [rad], and what it errs by over 1
            to 10 s, as the section `localization` has it: speeds are those that were commanded.
        range_share: Standard deviation of a range over the range.
        bearing: Standard deviation of a bearing [rad].
        landmark: What landmarks look like: clearly people.
        robot: What robots look like.
        lowest: Lowest point of a body [m].
        points: Number of its points.
        longest_s: What is longer is no recording [s].
    """

    odometry_s: float = 0.1
    truth_s: float = 0.1
    people_s: float = 1.0
    seen_s: float = 0.2
    scan_s: float = 0.1
    silence_s: float = 0.35
    period_s: float = 0.235
    start_s: float = 1.0
    odometry: Mapping[str, float | _Place] = field(
        default_factory=lambda: {
            "start_sigmas": (0.01, 0.01, 0.01),
            "position_noise": 0.05,
            "heading_noise": 0.06,
            "turn_noise": 0.07,
            "wheel_sigmas": (0.05, 0.05, 0.07),
        }
    )
    range_share: float = 0.042
    bearing: float = math.radians(0.6)
    landmark: Look = Look(6.0, 1.7)
    robot: Look = Look(0.0, 0.6)
    lowest: float = 0.25
    points: int = 300
    longest_s: float = 86_400.0


MRCLAM_TUNING = MrclamTuning()
#: A stamp [ns], and what writes a message of that time.
_Event = tuple[int, Callable[[], None]]


@dataclass(frozen=True)
class Converted:
    """What was converted.

    Attributes:
        seconds: How long it is [s].
        counts: By robot, the numbers of its scans that are not empty, and of landmarks and
            team-mates in them.
        unknown: Measurements of the data set that were left out: their barcodes are nobody's, or
            the robot's own.
    """

    seconds: float
    counts: Mapping[str, tuple[int, int, int]]
    unknown: int


def convert_mrclam(folder: Path, out: Path, tuning: MrclamTuning = MRCLAM_TUNING) -> Converted:
    """Writes a data set of MRCLAM as a bag, and the team's parameters beside it.

    The bag is the time in which all robots have odometry and truth. Of each robot it holds

    - `odom`: the speeds, integrated, in a frame of its own; without covariances;
    - `points`: what was measured at one time, stamped with the first measurement, and empty scans
      while the camera saw nothing. Measurements are as they are, those that are wrong, too;
    - its true poses, by motion capture.

    Landmarks are the true people. The parameters say where the odometry begins, by the truth of the
    first second.

    Args:
        folder: The data set, see `read_mrclam`.
        out: The bag: a folder, or one file if it ends in `.mcap`.
        tuning: Constants.

    Raises:
        BagError: A file is missing or wrong, the robots have no time in common, or `out` exists.
    """
    data = read_mrclam(folder)
    begin, end = common_span(data)
    if not tuning.start_s <= end - begin <= tuning.longest_s:
        raise BagError(
            f"{folder}: all robots have odometry and truth at the same time for "
            f"{max(0.0, end - begin):.1f} s; allowed: {tuning.start_s:g} to {tuning.longest_s:g} s"
        )
    count = math.floor((end - begin) / tuning.odometry_s + 1e-6) + 1
    times = np.asarray(begin + tuning.odometry_s * np.arange(count))
    robots = {
        f"robot_{number}": _Robot(f"robot_{number}", recorded, data.landmarks, times, tuning)
        for number, recorded in data.robots.items()
    }
    with BagWriter(out) as bag:
        events = [*_true_landmarks(RobotWriter(bag, next(iter(robots))), data, times, tuning)]
        for name, robot in robots.items():
            events += robot.events(RobotWriter(bag, name))
        for _, write in sorted(events, key=lambda event: event[0]):
            write()
    starts = {name: robot.start for name, robot in robots.items()}
    write_team(team_file(out), starts, tuning)
    return Converted(
        float(times[-1] - times[0]),
        {name: robot.counts(tuning.landmark) for name, robot in robots.items()},
        sum(recorded.unknown for recorded in data.robots.values()),
    )


class _Robot:
    """A robot of a data set as one of ours.

    Args:
        name: Its name.
        recorded: What was recorded of it.
        landmarks: The numbers of the landmarks.
        times: Of its odometry [s], shape (n,).
        tuning: Constants.

    Attributes:
        start: Where the frame of its odometry is in the map.
        scans: Its scans.
    """

    def __init__(
        self,
        name: str,
        recorded: MrclamRobot,
        landmarks: Iterable[int],
        times: Float,
        tuning: MrclamTuning,
    ) -> None:
        self._name, self._times = name, times
        self._places, self._speeds = reckoned(recorded.odometry, times)
        self._truth = thinned(recorded.truth, times, tuning.truth_s)
        self.start = start_of(recorded.truth, times, self._places, tuning.start_s)
        is_landmark = np.isin(recorded.subjects, [*landmarks])
        self.scans = [*scans_of(name, recorded.seen, is_landmark, times, tuning)]

    def counts(self, landmark: Look) -> tuple[int, int, int]:
        """Scans that are not empty; landmarks and team-mates in them."""
        scores = np.concatenate([scan.cells.score for scan in self.scans])
        landmarks = int((scores == landmark.score).sum())
        return sum(len(scan.cells) > 0 for scan in self.scans), landmarks, len(scores) - landmarks

    def events(self, writer: RobotWriter) -> Iterator[_Event]:
        """Writes all that it sends, and where it is."""
        begin, frame = float(self._times[0]), f"{self._name}/odom"
        for time, place, speed in zip(
            self._times.tolist(), self._places.tolist(), self._speeds.tolist(), strict=True
        ):
            ns = stamp_of(time - begin)
            yield ns, partial(writer.odometry, frame, place, speed, ns)
        for time, *place in self._truth.tolist():
            ns = stamp_of(time - begin)
            yield ns, partial(writer.true_pose, place, ns)
        for scan in self.scans:
            yield scan.stamp_ns, partial(writer.points, scan)


def stamp_of(seconds: float) -> int:
    """The stamp of a time since the beginning of the bag [s], in ns; to a microsecond."""
    return EPOCH_NS + 1000 * round(seconds * 1e6)


def common_span(data: Mrclam) -> tuple[float, float]:
    """When all robots have odometry and truth for the first and for the last time [s]."""
    tables = [table for r in data.robots.values() for table in (r.truth, r.odometry)]
    begin = max(float(table[0, 0]) for table in tables)
    return begin, min(float(table[-1, 0]) for table in tables)


# ------------------------------------------------------------------------------------ wheels


def reckoned(odometry: Float, times: Float) -> tuple[Float, Float]:
    """Dead reckoning: speeds on arcs, each until the next one.

    Where rows are far apart the robot drives on as before: those that say the same were not logged.

    Args:
        odometry: Time [s], speed [m/s] and turn [rad/s], shape (m, 3).
        times: None is before the first row, shape (n,).

    Returns:
        x, y [m] and yaw [rad] in base_link at the first of the times, shape (n, 3), and the speeds
        and turns at the times, shape (n, 2).
    """
    since, speed, turn = odometry.T
    lasts = np.diff(since, append=since[-1])
    yaw = np.concatenate([[0.0], np.cumsum(turn * lasts)])[:-1]
    steps = _arc(yaw, speed, turn, lasts)
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])[:-1]
    row = np.searchsorted(since, times, side="right") - 1
    late = times - since[row]
    at = xy[row] + _arc(yaw[row], speed[row], turn[row], late)
    heading = yaw[row] + turn[row] * late
    places = np.column_stack([(at - at[0]) @ rotation_2d(heading[0]), heading - heading[0]])
    return places, odometry[row, 1:]


def _arc(yaw: Float, speed: Float, turn: Float, seconds: Float) -> Float:
    """The ways on arcs that begin with these headings, x and y, shape (n, 2)."""
    half = 0.5 * turn * seconds
    chord = speed * seconds * np.sinc(half / math.pi)
    return np.stack([chord * np.cos(yaw + half), chord * np.sin(yaw + half)], axis=1)


def start_of(truth: Float, times: Float, places: Float, start_s: float) -> _Place:
    """Where the frame of the odometry is in the map, by the truth of the first time.

    Args:
        truth: Time [s], x, y [m] and yaw [rad], shape (m, 4).
        times: Of the odometry [s], shape (n,).
        places: The odometry: x, y [m] and yaw [rad], shape (n, 3).
        start_s: How long that is [s].
    """
    first = times <= times[0] + start_s
    x, y, yaw = (np.interp(times[first], truth[:, 0], column) for column in _unwrapped(truth))
    turn = float(np.mean(yaw - places[first, 2]))
    off = np.stack([x, y], axis=1) - places[first, :2] @ rotation_2d(turn).T
    return float(off[:, 0].mean()), float(off[:, 1].mean()), float(wrap_angles(np.array(turn)))


def _unwrapped(truth: Float) -> tuple[Float, Float, Float]:
    return truth[:, 1], truth[:, 2], np.unwrap(truth[:, 3])


def thinned(rows: Float, times: Float, least_s: float) -> Float:
    """Rows within the span of some times, none nearer in time to the one before than this [s].

    Args:
        rows: Time first [s], shape (m, k).
        times: Shape (n,).
        least_s: The least distance [s].
    """
    kept: list[int] = []
    last = -math.inf
    for index, time in enumerate(rows[:, 0].tolist()):
        if times[0] <= time <= times[-1] and time - last >= least_s:
            kept.append(index)
            last = time
    return rows[kept]


# ------------------------------------------------------------------------------------- scans


def scans_of(
    robot: str,
    seen: Float,
    is_landmark: Bool,
    times: Float,
    tuning: MrclamTuning = MRCLAM_TUNING,
) -> Iterator[Scan]:
    """The scans of a robot.

    Args:
        robot: Its name.
        seen: Time [s], range [m] and bearing [rad] of what it measured, shape (k, 3).
        is_landmark: Which of it are landmarks, shape (k,).
        times: Of its odometry [s]; scans are within their span, shape (n,).
        tuning: Constants.
    """
    begin, end = float(times[0]), float(times[-1])
    inside = (seen[:, 0] >= begin) & (seen[:, 0] <= end)
    seen, is_landmark = seen[inside], is_landmark[inside]
    last = begin
    for first, after in _together(seen[:, 0], tuning.scan_s):
        time = float(seen[first, 0])
        for empty in _silent(last, time, tuning):
            yield Scan(robot, stamp_of(empty - begin), Cells.empty())
        # From left to right: the order of the file may tell who they are.
        order = first + np.argsort(-seen[first:after, 2], kind="stable")
        cells = cells_of(seen[order, 1:], is_landmark[order], tuning)
        yield Scan(robot, stamp_of(time - begin), cells)
        last = time
    for empty in _silent(last, end, tuning):
        yield Scan(robot, stamp_of(empty - begin), Cells.empty())


def _together(times: Float, within_s: float) -> Iterator[tuple[int, int]]:
    """Index of the first time, and past the last one, of each scan."""
    first = 0
    while first < len(times):
        after = int(np.searchsorted(times, times[first] + within_s, side="right"))
        yield first, after
        first = after


def _silent(last: float, time: float, tuning: MrclamTuning) -> list[float]:
    """Times of empty scans between two others, evenly apart [s]."""
    if time - last <= tuning.silence_s:
        return []
    count = round((time - last) / tuning.period_s)
    return [last + (time - last) * k / count for k in range(1, count)]


def cells_of(seen: Float, is_landmark: Bool, tuning: MrclamTuning = MRCLAM_TUNING) -> Cells:
    """The bodies of a scan, a cell for each, in their order.

    Args:
        seen: Range [m] and bearing [rad], shape (k, 2).
        is_landmark: Which are landmarks, shape (k,).
        tuning: Constants.
    """
    away, bearing = seen.astype(np.float32).T
    count = len(seen)

    def of_kind(landmark: float, robot: float) -> NDArray[np.float32]:
        return np.where(is_landmark, np.float32(landmark), np.float32(robot))

    top = of_kind(tuning.landmark.top, tuning.robot.top)
    return Cells(
        x=away * np.cos(bearing),
        y=away * np.sin(bearing),
        z=top,
        z_min=np.full(count, tuning.lowest, dtype=np.float32),
        top=top,
        count=np.full(count, tuning.points, dtype=np.uint32),
        body=np.arange(1, count + 1, dtype=np.uint32),
        score=of_kind(tuning.landmark.score, tuning.robot.score),
        sigma_range=away * np.float32(tuning.range_share),
        sigma_across=away * np.float32(tuning.bearing),
    )


# ------------------------------------------------------------------------------------- truth


def _true_landmarks(
    writer: RobotWriter, data: Mrclam, times: Float, tuning: MrclamTuning
) -> Iterator[_Event]:
    """Writes where the landmarks are, and which of them a robot sees."""
    places = np.array([*data.landmarks.values()])
    when = np.concatenate([robot.seen[:, 0] for robot in data.robots.values()])
    what: Int = np.concatenate([robot.subjects for robot in data.robots.values()])
    for time in np.arange(times[0], times[-1], tuning.people_s).tolist():
        seen = np.isin([*data.landmarks], what[np.abs(when - time) <= tuning.seen_s])
        ns = stamp_of(time - times[0])
        yield ns, partial(writer.ground_truth, places, ns, seen)


def write_team(file: Path, starts: Mapping[str, _Place], tuning: MrclamTuning) -> None:
    """Writes the team's parameters, as the nodes and `--config` read them.

    Args:
        file: Where to.
        starts: By robot, where the frame of its odometry is in the map.
        tuning: How sure that is, and the odometry.
    """
    document = {
        f"/{name}/robot_node": {
            "ros__parameters": {
                "pose": {"map_from_odom": [round(value, 6) for value in place]},
                "localization": {
                    name: [*value] if isinstance(value, tuple) else value
                    for name, value in tuning.odometry.items()
                },
            }
        }
        for name, place in starts.items()
    }
    planner = {"/**/planner_node": {"ros__parameters": {"robots": [*starts]}}}
    text = yaml.safe_dump({**document, **planner}, sort_keys=False, default_flow_style=None)
    file.write_text(f"# A team of MRCLAM: what differs from default.yaml.\n{text}", "utf-8")
