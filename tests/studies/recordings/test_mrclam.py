"""Data sets of MRCLAM as bags, on a small one that is made up."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import BagError
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.messages import read_pose, read_scan, stamp_ns_of
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.masking import MASKING_TUNING

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_people_sim.evaluation.results import evaluate_bag
from mrs_studies.commands.convert import app
from mrs_studies.recordings.frames import EPOCH_NS
from mrs_studies.recordings.mrclam import convert_mrclam, reckoned
from mrs_studies.recordings.mrclam_files import read_mrclam
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.truth import read_truth, true_pose_topic

T0 = 1_248_000_000.0
#: By subject, its barcode; 1 and 2 are robots.
BARCODES = {1: 5, 2: 14, 6: 63, 7: 72, 8: 81}
LANDMARKS = {6: (4.0, 1.0), 7: (4.5, -1.0), 8: (1.0, 3.0)}
#: Nothing is seen for so long [s].
SILENCE = (8.0, 10.0)
#: What the odometry of robot 1 turns too much [rad/s].
DRIFT = 0.005


def place(robot: int, t: Float) -> Float:
    """Where a robot is: the first one drives along x, the second one turns on the spot."""
    if robot == 1:
        return np.stack([0.1 * t, 0.0 * t, 0.0 * t], axis=1)
    return np.stack([2.0 + 0.0 * t, -0.5 + 0.0 * t, 2.5 + 0.05 * t], axis=1)


def seen(robot: int, t: float) -> list[tuple[int, float, float]]:
    """Subject, range and bearing of all that is ahead."""
    x, y, yaw = place(robot, np.array([t]))[0]
    found = []
    for subject in (*LANDMARKS, 3 - robot):
        other = LANDMARKS.get(subject)
        at = np.array(other) if other else place(subject, np.array([t]))[0, :2]
        ahead, left = (at - (x, y)) @ rotation_2d(yaw)
        if abs(math.atan2(left, ahead)) < 1.0:
            found.append((subject, math.hypot(ahead, left), math.atan2(left, ahead)))
    return found


def write(folder: Path, barcodes: dict[int, int] = BARCODES, *, turned: bool = False) -> Path:
    """Writes the data set: 20 s, of which the second robot misses the first half second.

    Args:
        folder: Where to.
        barcodes: By subject.
        turned: Whether rows of one time are the other way round.
    """
    folder.mkdir()

    def table(name: str, rows: list[tuple[float, ...]]) -> None:
        lines = [" \t".join(f"{value:.9g}" for value in row) for row in rows]
        (folder / name).write_text("\n".join(["# a comment", *lines, ""]), encoding="utf-8")

    def timed(name: str, rows: list[tuple[float, ...]]) -> None:
        lines = [f"{T0 + t:.3f} " + " ".join(f"{v:.9f}" for v in row) for t, *row in rows]
        (folder / name).write_text("\n".join(["# Time [s] ...", *lines, ""]), encoding="utf-8")

    table("Barcodes.dat", [*barcodes.items()])
    table("Landmark_Groundtruth.dat", [(s, *xy, 1e-4, 1e-4) for s, xy in LANDMARKS.items()])
    for robot in (1, 2):
        times = np.arange(0.0 if robot == 1 else 0.5, 20.01, 0.02)
        timed(
            f"Robot{robot}_Groundtruth.dat",
            [(t, *row) for t, row in zip(times, place(robot, times).tolist(), strict=True)],
        )
        speeds = (0.1, DRIFT) if robot == 1 else (0.0, 0.05)
        timed(f"Robot{robot}_Odometry.dat", [(t, *speeds) for t in times[::10]])
        rows: list[tuple[float, ...]] = []
        for t in np.arange(1.09 + 0.01 * robot, 20.0, 0.25).tolist():
            if not SILENCE[0] <= t < SILENCE[1]:
                found = seen(robot, t)[:: -1 if turned else 1]
                rows += [(t, barcodes[subject], *polar) for subject, *polar in found]
        timed(f"Robot{robot}_Measurement.dat", rows)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("mrclam") / "data")


@pytest.fixture(scope="module")
def bag(folder: Path) -> Path:
    out = folder.parent / "bag.mcap"
    convert_mrclam(folder, out)
    return out


def messages(bag: Path, topic: str) -> list[Any]:
    with BagReader(bag) as reader:
        return [message for _, _, message in reader.decoded([topic])]


def scans(bag: Path, robot: int) -> list[Scan]:
    name = f"robot_{robot}"
    return [read_scan(message, name) for message in messages(bag, f"/{name}/points")]


def seconds(stamp_ns: int) -> float:
    """Time in the data set [s] since `T0`: the bag begins where both robots are recorded."""
    return (stamp_ns - EPOCH_NS) / 1e9 + 0.5


# ------------------------------------------------------------------------------------- wheels


def test_a_quarter_of_a_circle_and_a_straight_way():
    quarter = math.pi / 2
    odometry = np.array([[10.0, quarter, quarter], [11.0, 1.0, 0.0], [13.0, 0.0, 0.0]])
    places, speeds = reckoned(odometry, np.array([10.0, 10.5, 11.0, 12.5]))
    half = math.sin(math.pi / 4)
    wanted = [(0, 0, 0), (half, 1 - half, quarter / 2), (1, 1, quarter), (1, 2.5, quarter)]
    np.testing.assert_allclose(places, wanted, atol=1e-12)
    np.testing.assert_allclose(speeds[2:], [(1.0, 0.0), (1.0, 0.0)])


def test_dead_reckoning_begins_at_the_first_time():
    odometry = np.array([[0.0, 1.0, 0.1], [5.0, 1.0, 0.1], [9.0, 0.0, 0.0]])
    whole, _ = reckoned(odometry, np.arange(0.0, 9.0))
    later, _ = reckoned(odometry, np.arange(3.0, 9.0))
    assert later[0].tolist() == [0.0, 0.0, 0.0]
    off = (whole[3:, :2] - whole[3, :2]) @ rotation_2d(whole[3, 2])
    np.testing.assert_allclose(later[:, :2], off, atol=1e-12)


def test_odometry_is_in_a_frame_of_its_own_and_states_no_covariance(bag):
    odometry = messages(bag, "/robot_1/odom")
    assert {message.header.frame_id for message in odometry} == {"robot_1/odom"}
    assert {message.child_frame_id for message in odometry} == {"robot_1/base_link"}
    assert not any(message.pose.covariance.any() for message in odometry)
    poses = [read_pose(message) for message in odometry]
    assert (poses[0].stamp_ns, poses[0].x, poses[0].y, poses[0].yaw) == (EPOCH_NS, 0.0, 0.0, 0.0)
    assert seconds(poses[-1].stamp_ns) == pytest.approx(20.0, abs=0.11)
    assert poses[-1].yaw == pytest.approx(DRIFT * (seconds(poses[-1].stamp_ns) - 0.5))
    assert np.diff([pose.stamp_ns for pose in poses]) == pytest.approx(1e8)


# -------------------------------------------------------------------------------------- scans


@pytest.mark.parametrize("robot", [1, 2])
def test_bodies_are_where_they_were_measured(bag, robot):
    full = [scan for scan in scans(bag, robot) if len(scan.cells)]
    assert len(full) >= 50
    for scan in full:
        wanted = {
            (round(away * math.cos(bearing), 4), round(away * math.sin(bearing), 4)): subject
            for subject, away, bearing in seen(robot, round(seconds(scan.stamp_ns), 3))
        }
        cells = scan.cells
        assert len(np.unique(cells.body)) == len(wanted)
        for x, y, score, top, along, across in zip(
            cells.x, cells.y, cells.score, cells.top, cells.sigma_range, cells.sigma_across,
            strict=True,
        ):  # fmt: skip
            (subject,) = (s for at, s in wanted.items() if math.dist(at, (x, y)) < 1e-3)
            if subject in LANDMARKS:
                assert score > MASKING_TUNING.clearly_a_person
                assert 1.5 < top < 2.0
            else:
                assert score < PlannerConfig().joining.min_score
                assert top < 0.8
            away = math.hypot(x, y)
            assert 0.03 * away < along < 0.06 * away
            assert 0.005 * away < across < 0.02 * away


def test_scans_come_also_while_nothing_is_seen(bag):
    times = [seconds(scan.stamp_ns) for scan in scans(bag, 1)]
    assert times[0] < 1.0
    assert times[-1] > 19.0
    assert max(np.diff(times)) < 0.36
    empty = [seconds(scan.stamp_ns) for scan in scans(bag, 1) if not len(scan.cells)]
    assert any(SILENCE[0] < t < SILENCE[1] for t in empty)


def test_measurements_of_nearly_one_time_are_one_scan(folder, tmp_path):
    data = write(tmp_path / "data")
    file = data / "Robot1_Measurement.dat"
    lines = file.read_text(encoding="utf-8").splitlines()
    late = [f"{T0 + 5.18:.3f} 63 2.5 0.3", f"{T0 + 5.22:.3f} 72 2.5 0.2"]
    rest = [line for line in lines if not line.startswith(f"{T0 + 5.1:.2f}")]
    first = f"{T0 + 5.1:.3f} 81 3.0 0.1"
    before = [x for x in rest if x.startswith("#") or float(x.split()[0]) < T0 + 5.1]
    text = "\n".join([*before, first, *late, *rest[len(before) :], ""])
    file.write_text(text, encoding="utf-8")
    convert_mrclam(data, tmp_path / "bag")
    found = {round(seconds(s.stamp_ns), 3): len(s.cells) for s in scans(tmp_path / "bag", 1)}
    assert (found[5.1], found[5.22]) == (2, 1)


def test_nothing_that_a_robot_sends_tells_who_is_who(bag, folder, tmp_path):
    other = dict(zip(BARCODES, (99, 7, 23, 54, 1), strict=True))
    convert_mrclam(write(tmp_path / "data", other, turned=True), tmp_path / "bag")

    def sent(path: Path) -> list[tuple[str, int, bytes]]:
        with BagReader(path) as reader:
            topics = [topic for topic in reader.topics if topic.startswith("/robot_")]
            assert sorted(topics) == [f"/robot_{k}/{t}" for k in (1, 2) for t in ("odom", "points")]
            return sorted((raw.topic, raw.time_ns, raw.data) for raw in reader.messages(topics))

    assert sent(bag) == sent(tmp_path / "bag")


def test_unknown_barcodes_are_left_out_and_counted(tmp_path):
    data = write(tmp_path / "data")
    with (data / "Robot2_Measurement.dat").open("a", encoding="utf-8") as file:
        file.write(f"{T0 + 19.9:.3f} 43 2.0 0.0\n{T0 + 19.9:.3f} {BARCODES[2]} 2.0 0.0\n")
    made = convert_mrclam(data, tmp_path / "bag")
    assert made.unknown == 2
    assert all(len(s.cells) == 0 for s in scans(tmp_path / "bag", 2) if seconds(s.stamp_ns) > 19.88)


# -------------------------------------------------------------------------------------- truth


def test_truth_is_that_of_motion_capture(bag):
    for robot in (1, 2):
        true = messages(bag, true_pose_topic(f"robot_{robot}"))
        assert len(true) > 150
        for message in true:
            t = np.array([seconds(stamp_ns_of(message.header.stamp))])
            x, y, yaw = place(robot, t)[0]
            at, turn = message.pose.position, message.pose.orientation
            assert (at.x, at.y) == pytest.approx((x, y), abs=1e-6)
            assert 2 * math.atan2(turn.z, turn.w) == pytest.approx(yaw, abs=1e-6)


def test_landmarks_are_the_true_people(bag):
    with BagReader(bag) as reader:
        truth = read_truth(reader)
    assert len(truth) == 20
    for positions in truth.positions:
        np.testing.assert_allclose(positions, [*LANDMARKS.values()])
    assert truth.visible is not None
    often = np.mean(truth.visible, axis=0)
    assert often[0] > 0.7  # the first robot looks at it all the time
    silent = [
        v for ns, v in zip(truth.stamps_ns, truth.visible, strict=True)
        if SILENCE[0] + 0.3 < seconds(int(ns)) < SILENCE[1] - 0.3
    ]  # fmt: skip
    assert len(silent) == 2
    assert not np.any(silent)


def test_the_team_is_localized_without_further_options(bag):
    result = evaluate_bag(bag, localize=True)
    poses = result.report()["poses"]
    # Only the start: to the true poses of the first second.
    drifted = poses["odometry"]["relative"]["heading_deg"]["max"]
    assert drifted == pytest.approx(math.degrees(DRIFT * 19.5), abs=0.3)
    assert poses["relative"]["position_m"]["median"] < 0.1
    assert poses["relative"]["nees"]["mean"] is not None
    assert not [note for note in result.notes if "not used" in note or "no scan" in note]
    # The landmarks are people, and the team-mates are not.
    exact = poses["people_with_exact_poses"]
    assert exact["recall"] > 0.8
    assert exact["precision"] == 1.0


# ------------------------------------------------------------------------------------- errors


def test_what_is_read(folder):
    data = read_mrclam(folder)
    assert sorted(data.robots) == [1, 2]
    assert data.landmarks == LANDMARKS
    assert data.robots[1].truth.shape == (1001, 4)
    assert data.robots[2].odometry[0].tolist() == [T0 + 0.5, 0.0, 0.05]


def replaced(name: str, number: int, line: str) -> Callable[[Path], None]:
    """What writes another line in place of one of a file, counted from 1."""

    def change(folder: Path) -> None:
        lines = (folder / name).read_text(encoding="utf-8").splitlines()
        lines[number - 1] = line
        (folder / name).write_text("\n".join(lines), encoding="utf-8")

    return change


def emptied(folder: Path) -> None:
    (folder / "Robot2_Odometry.dat").write_text("# nothing\n\n", encoding="utf-8")


def without_text(folder: Path) -> None:
    (folder / "Robot2_Odometry.dat").write_bytes(b"\xff\xfe\x00")


def much_later(folder: Path) -> None:
    (folder / "Robot2_Odometry.dat").write_text(
        f"{T0 + 19.5:.3f} 0.1 0\n{T0 + 20:.3f} 0.1 0\n", encoding="utf-8"
    )


def ages(folder: Path) -> None:
    for file in folder.glob("Robot?_*.dat"):
        last = "0 0 0" if "Ground" in file.name else "0 0" if "Odo" in file.name else "63 1 0"
        with file.open("a", encoding="utf-8") as table:
            table.write(f"9999999999 {last}\n")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ages,
            r"all robots have odometry and truth at the same time for 87\d+\.\d s; allowed: 1 to",
        ),
        (
            lambda folder: (folder / "Robot2_Groundtruth.dat").unlink(),
            r"Robot2_Groundtruth\.dat: there is no such file",
        ),
        (emptied, r"Robot2_Odometry\.dat has no rows; wanted: time, speed, turn in each"),
        (without_text, r"Robot2_Odometry\.dat cannot be read: "),
        (
            replaced("Robot1_Odometry.dat", 4, "1248000000.9 0.1"),
            r"Robot1_Odometry\.dat, line 4: 2 values; wanted: 3, which are time, speed, turn",
        ),
        (
            replaced("Robot1_Odometry.dat", 4, "1248000000.9 fast 0"),
            r"Robot1_Odometry\.dat, line 4: speed is fast; allowed: -100000 to 100000",
        ),
        (
            replaced("Robot1_Groundtruth.dat", 9, "1248000000.9 0 nan 0"),
            r"Robot1_Groundtruth\.dat, line 9: y is nan; allowed: -100000 to 100000",
        ),
        (
            replaced("Robot1_Measurement.dat", 3, "1248000001.1 63 -2 0"),
            r"Robot1_Measurement\.dat, line 3: range is -2; allowed: more than 0, at most 100000",
        ),
        (
            replaced("Robot1_Measurement.dat", 3, "1248000001.1 6.5 2 0"),
            r"line 3: barcode is 6\.5; allowed: whole numbers from 0 to 999",
        ),
        (
            replaced("Robot1_Odometry.dat", 3, "1247999999 0.1 0"),
            r"line 3: time is 1247999999\.000; allowed: from 1248000000\.000 on",
        ),
        (
            replaced("Barcodes.dat", 3, "2 5"),
            r"Barcodes\.dat: barcode 5 is given twice; allowed: once",
        ),
        (
            replaced("Landmark_Groundtruth.dat", 2, "9 4 1 0 0"),
            r"Landmark_Groundtruth\.dat: subject 9 is not in Barcodes\.dat; allowed: \[1, 2, 6",
        ),
        (
            much_later,
            r"all robots have odometry and truth at the same time for 0\.5 s; "
            r"allowed: 1 to 86400 s",
        ),
    ],
)
def test_what_is_wrong_is_named(change, message, tmp_path):
    data = write(tmp_path / "data")
    change(data)
    with pytest.raises(BagError, match=message):
        convert_mrclam(data, tmp_path / "bag")
    assert not (tmp_path / "bag").exists()
    assert not (tmp_path / "bag.yaml").exists()


def test_landmarks_alone_are_no_team(tmp_path):
    data = write(tmp_path / "data")
    (data / "Barcodes.dat").write_text("6 63\n7 72\n8 81\n", encoding="utf-8")
    with pytest.raises(BagError, match=r"every subject of Barcodes\.dat is a landmark"):
        read_mrclam(data)


def test_the_command_says_what_it_wrote(folder, tmp_path):
    result = CliRunner().invoke(app, ["mrclam", str(folder), str(tmp_path / "bag")])
    assert result.exit_code == 0, result.output
    lines = result.output.replace("\n", " ")
    assert "robot_1:" in lines
    assert "robot_2:" in lines
    assert "19.4 s of 2 robots" in lines
    assert (tmp_path / "bag.yaml").is_file()
