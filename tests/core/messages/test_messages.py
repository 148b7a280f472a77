import array
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc import messages
from mrs_people_loc.errors import (
    CameraError,
    GridError,
    ImageError,
    PeopleLocError,
    PoseError,
    RangeError,
    ScanError,
    StampError,
)
from mrs_people_loc.geometry import quaternion_from_rotation, rotation_from_rpy
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import ImagePreparer, StereoImages
from mrs_people_loc.team.masking import Walls
from mrs_people_loc.team.poses import Pose

NAN, INF = math.nan, math.inf


def stamp(sec=12, nanosec=345) -> SimpleNamespace:
    return SimpleNamespace(sec=sec, nanosec=nanosec)


def header(frame_id="map") -> SimpleNamespace:
    return SimpleNamespace(stamp=stamp(), frame_id=frame_id)


def test_stamp_is_converted_to_nanoseconds():
    assert messages.stamp_ns_of(stamp()) == 12_000_000_345
    # uint32 of a bag, which must not overflow
    assert messages.stamp_ns_of(stamp(np.int32(2**31 - 1), np.uint32(999_999_999))) == (
        2_147_483_647_999_999_999
    )


# -------------------------------------------------------------------------- camera_info ----


def test_camera_info_matches_hand_computed_values(camera_info):
    p = [100.0, 0.0, 79.5, -10.0, 0.0, 101.0, 59.5, 3.0, 0.0, 0.0, 1.0, 0.0]
    k = [90.0, 0.0, 70.0, 0.0, 91.0, 50.0, 0.0, 0.0, 1.0]
    r = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    model = messages.read_camera_info(camera_info(p=p, k=k, r=r, d=[0.1, 0.2, 0.3, 0.4, 0.5]))
    assert (model.width, model.height, model.distortion_model) == (160, 120, "plumb_bob")
    assert model.d == (0.1, 0.2, 0.3, 0.4, 0.5)
    np.testing.assert_array_equal(model.p, [[100, 0, 79.5, -10], [0, 101, 59.5, 3], [0, 0, 1, 0]])
    np.testing.assert_array_equal(model.k, [[90, 0, 70], [0, 91, 50], [0, 0, 1]])
    np.testing.assert_array_equal(model.r, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])


def test_camera_info_arrays_of_rosbags_and_rclpy_are_read(camera_info):
    plain = camera_info()
    arrays = camera_info(k=np.array(plain.k), r=np.array(plain.r), p=np.array(plain.p))
    np.testing.assert_array_equal(
        messages.read_camera_info(arrays).p, messages.read_camera_info(plain).p
    )


def roi(width, height) -> SimpleNamespace:
    return SimpleNamespace(x_offset=0, y_offset=0, width=width, height=height, do_rectify=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"binning_x": 2, "binning_y": 2}, "binning is 2x2; allowed: none"),
        ({"binning_x": 0, "binning_y": 2}, "binning is 0x2"),
        ({"roi": roi(80, 60)}, "roi is 80x60; allowed: none or the full image"),
        ({"roi": roi(160, 60)}, "roi is 160x60"),
        ({"width": 0, "height": 0}, "image size is 0x0; allowed: more than 0x0"),
        ({"p": [0.0] * 12}, "focal length in p is 0, 0 px; .*is the camera calibrated"),
        (
            {"width": 2**32 - 1, "height": 2**32 - 1},
            "image size is 4294967295x4294967295; allowed: ",
        ),
        ({"height": 8193}, "image size is 160x8193; allowed: more than 0x0, up to 8192x8192"),
        ({"k": [1e300] * 9}, r"k holds 1e\+300; allowed: numbers up to 1e\+06"),
        ({"p": [-2e6] * 12}, r"p holds 2e\+06; allowed: numbers up to 1e\+06"),
        ({"p": [1e-300] * 12}, "focal length in p is 1e-300, 1e-300 px; allowed: at least 0.01"),
        ({"p": [NAN] * 12}, "p holds NaN or infinite"),
        ({"k": [INF] * 9}, "k holds NaN or infinite"),
        ({"r": [NAN] * 9}, "r holds NaN or infinite"),
        ({"d": [0.0, NAN, 0.0, 0.0, 0.0]}, "d holds NaN or infinite"),
        ({"k": [1.0] * 8}, "k has 8 values; wanted: 9"),
        ({"r": []}, "r has 0 values; wanted: 9"),
        ({"p": [1.0] * 9}, "p has 9 values; wanted: 12"),
    ],
)
def test_bad_camera_info_is_refused(camera_info, changes, message):
    with pytest.raises(CameraError, match=message):
        messages.read_camera_info(camera_info(**changes))


@pytest.mark.parametrize("changes", [{"binning_x": 1, "binning_y": 1}, {"roi": roi(160, 120)}])
def test_full_images_are_read(camera_info, changes):
    messages.read_camera_info(camera_info(**changes))


def right_info(camera_info, tx, **changes):
    p = camera_info().p
    return camera_info(p=[*p[:3], tx, *p[4:]], **changes)


@pytest.mark.parametrize(
    ("tx", "changes", "message"),
    [
        (0.0, {}, r"baseline is 0: P\[3\] of the right camera_info is missing; wanted: -fx \* b"),
        (10.0, {}, r"baseline is -0.1 m: .* is 10; wanted: .* left and right swapped"),
        (-10.0, {"width": 320}, "right camera_info is 320x120; wanted as left: 160x120"),
    ],
)
def test_camera_infos_that_form_no_pair_are_refused(camera_info, tx, changes, message):
    left, right = camera_info(), right_info(camera_info, tx, **changes)
    with pytest.raises(CameraError, match=message):
        StereoCamera.from_models(*map(messages.read_camera_info, (left, right)))


# -------------------------------------------------------------------------------- images ----


def image(rows, encoding="mono8", **changes) -> SimpleNamespace:
    """An Image with the bytes of `rows`, of shape (height, step)."""
    rows = np.array(rows, dtype=np.uint8)
    values = {
        "header": header(),
        "height": rows.shape[0],
        "width": rows.shape[1] // messages.ENCODINGS.get(encoding, (1, ""))[0],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": rows.shape[1],
        "data": rows.tobytes(),
    }
    return SimpleNamespace(**values | changes)


def test_grey_image_is_read():
    grey = messages.read_image(image([[1, 2, 3], [4, 5, 6]]))
    np.testing.assert_array_equal(grey, [[1, 2, 3], [4, 5, 6]])
    assert grey.dtype == np.uint8


def test_padded_rows_are_read():
    padded = image([[1, 2, 3, 99], [4, 5, 6, 99]], width=3)
    np.testing.assert_array_equal(messages.read_image(padded), [[1, 2, 3], [4, 5, 6]])
    padded = image([[0, 0, 255, 0, 255, 0, 99, 99]], "rgb8", width=2)
    np.testing.assert_array_equal(messages.read_image(padded), [[29, 150]])


@pytest.mark.parametrize(
    ("encoding", "grey"),
    [
        ("rgb8", [76, 150, 29]),
        ("rgba8", [76, 150, 29]),
        ("bgr8", [29, 150, 76]),
        ("bgra8", [29, 150, 76]),
        ("8UC3", [29, 150, 76]),  # as OpenCV has it
    ],
)
def test_colours_are_converted_to_grey(encoding, grey):
    # Red, green, blue weigh 0.299, 0.587, 0.114; alpha does not count.
    alphas = [[200], [0], [255]] if encoding.endswith("a8") else [[], [], []]
    pixels = [[*row, *alpha] for row, alpha in zip(255 * np.eye(3, dtype=int), alphas, strict=True)]
    rows = [np.concatenate(pixels)]
    np.testing.assert_array_equal(messages.read_image(image(rows, encoding)), [grey])


@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_both_grey_encodings_are_read(encoding):
    rows = [[1, 2, 3], [4, 5, 6]]
    np.testing.assert_array_equal(messages.read_image(image(rows, encoding)), rows)


def test_a_pose_without_a_stamp_is_refused():
    message = odometry()
    message.header.stamp.sec = message.header.stamp.nanosec = 0
    with pytest.raises(StampError, match="stamp is 0"):
        messages.read_pose(message)


def test_stamp_of_zero_is_refused():
    message = SimpleNamespace(header=header())
    message.header.stamp.sec, message.header.stamp.nanosec = 0, 1
    assert messages.read_stamp(message) == 1
    message.header.stamp.nanosec = 0
    with pytest.raises(StampError, match=r"stamp is 0: its sender sets none.*use_sim_time"):
        messages.read_stamp(message)


@pytest.mark.parametrize("make", [bytes, bytearray, lambda data: np.frombuffer(data, np.uint8)])
def test_image_data_of_any_buffer_type_is_read(make):
    message = image([[1, 2], [3, 4]])
    message.data = make(message.data)
    np.testing.assert_array_equal(messages.read_image(message), [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"encoding": "mono16"}, "encoding is 'mono16'; allowed: mono8, bgr8, rgb8"),
        ({"encoding": ""}, "encoding is ''; allowed: mono8"),
        ({"encoding": "bayer_rggb8"}, "encoding is 'bayer_rggb8'"),
        ({"width": 0}, "image is 0x2; wanted: more than 0x0"),
        ({"height": 0, "data": b""}, "image is 3x0; wanted: more than 0x0"),
        ({"step": 2}, "step is 2 bytes; wanted for mono8 at width 3: at least 3"),
        ({"encoding": "rgb8", "width": 3}, "step is 3 bytes; wanted for rgb8 at width 3: at lea"),
        (
            {"encoding": "bgra8", "width": 3},
            "step is 3 bytes; wanted for bgra8 at width 3: at least 12",
        ),
        ({"data": b"12345"}, r"data has 5 bytes; wanted: step \* height = 6"),
        ({"data": b"1234567"}, r"data has 7 bytes; wanted: step \* height = 6"),
        ({"data": b""}, r"data has 0 bytes; wanted: step \* height = 6"),
        ({"height": 3}, r"data has 6 bytes; wanted: step \* height = 9"),
    ],
)
def test_a_bad_image_is_refused(changes, message):
    with pytest.raises(ImageError, match=message):
        messages.read_image(image([[1, 2, 3], [4, 5, 6]], **changes))


def test_images_that_differ_from_camera_info_or_each_other_are_refused(camera_info):
    model = messages.read_camera_info(camera_info())
    prepare = ImagePreparer(model, rectified=True, width=160, height=120)
    fits = prepare(messages.read_image(image(np.zeros((120, 160)))))
    other = messages.read_image(image(np.zeros((60, 80))))
    with pytest.raises(ImageError, match="image is 80x60; wanted as in camera_info: 160x120"):
        prepare(other)
    with pytest.raises(ImageError, match="right image is 80x60; wanted as left: 160x120"):
        StereoImages(0, fits, other)


# --------------------------------------------------------------------------------- poses ----


def with_covariance(x, y, z, quaternion, covariance) -> SimpleNamespace:
    orientation = SimpleNamespace(**dict(zip("xyzw", quaternion, strict=True)))
    pose = SimpleNamespace(position=SimpleNamespace(x=x, y=y, z=z), orientation=orientation)
    return SimpleNamespace(pose=pose, covariance=covariance)


def odometry(x=1.0, y=2.0, z=0.0, quaternion=(0, 0, 0, 1), covariance=(0.0,) * 36):
    pose = with_covariance(x, y, z, quaternion, covariance)
    return SimpleNamespace(header=header(), child_frame_id="robot_a/base_link", pose=pose)


def test_pose_matches_hand_computed_values():
    s = math.sqrt(0.5)
    pose = messages.read_pose(odometry(1.5, -2.5, 7.0, (0, 0, s, s), np.arange(36.0)))
    assert (pose.stamp_ns, pose.x, pose.y) == (12_000_000_345, 1.5, -2.5)
    assert pose.yaw == pytest.approx(math.pi / 2)
    # Of the 6 x 6 about x, y, z, roll, pitch, yaw: rows and columns 0, 1 and 5.
    np.testing.assert_array_equal(pose.covariance, [[0, 1, 5], [6, 7, 11], [30, 31, 35]])


def test_rounded_quaternion_is_accepted():
    pose = messages.read_pose(odometry(quaternion=(0, 0, 0.7078, 0.7078)))
    assert pose.yaw == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("lean", [{"roll": 0.5}, {"pitch": -0.5}])
def test_robot_on_a_slope_has_a_heading(lean):
    rpy = {"roll": 0.0, "pitch": 0.0, "yaw": 2.0} | lean
    quaternion = quaternion_from_rotation(rotation_from_rpy(**rpy))
    assert messages.read_pose(odometry(quaternion=quaternion)).yaw == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": NAN}, r"pose holds NaN or infinite values: position \(nan, 2.0, 0.0\)"),
        ({"y": INF}, r"pose holds NaN or infinite values: position \(1.0, inf, 0.0\)"),
        ({"z": NAN}, "pose holds NaN or infinite"),
        ({"quaternion": (0, 0, 0, NAN)}, r"pose holds NaN .*orientation \(0, 0, 0, nan\)"),
        ({"quaternion": (0, -INF, 0, 1)}, r"pose holds NaN .*orientation \(0, -inf, 0, 1\)"),
        ({"x": 9e7}, r"position is \(9e\+07, 2\) m; wanted: within 2\.1e\+07"),
        ({"y": -1e308}, r"position is \(1, -1e\+308\) m; wanted: within 2\.1e\+07"),
        ({"quaternion": (0, 0, 0, 0)}, "orientation has length 0; wanted: a quaternion of length"),
        ({"quaternion": (0, 0, 0.8, 0.8)}, "orientation has length 1.131; wanted"),
        ({"quaternion": (0, 0, 0, 0.98)}, "orientation has length 0.98; wanted"),
        ({"quaternion": (0, 0, 0, 1e200)}, r"orientation has length 1e\+200; wanted"),
        # base_link's orientation mistaken for that of a camera's optical frame
        ({"quaternion": (-0.5, 0.5, -0.5, 0.5)}, "pose leans by 1.57 rad; allowed: 0.52"),
        ({"quaternion": (math.sin(0.3), 0, 0, math.cos(0.3))}, "pose leans by 0.60 rad"),
        ({"quaternion": (0, math.sin(0.3), 0, math.cos(0.3))}, "pose leans by 0.60 rad"),
        ({"quaternion": (1, 0, 0, 0)}, "pose leans by 3.14 rad"),
        ({"covariance": (NAN,) * 36}, "covariance of x, y, yaw is no covariance"),
        ({"covariance": (-1.0,) + (0.0,) * 35}, "covariance of x, y, yaw is no covariance"),
        ({"covariance": (0.0,) * 9}, "covariance has 9 values; wanted: 36"),
    ],
)
def test_a_bad_pose_is_refused(changes, message):
    with pytest.raises(PoseError, match=message):
        messages.read_pose(odometry(**changes))


BASE = "robot_a/base_link"


@pytest.mark.parametrize(
    "child",
    ["robot_a/base_link", "/robot_a/base_link", "base_link", "/base_link", "",
     "robot_a/base_footprint", "base_footprint"],
)  # fmt: skip
def test_odometry_of_the_robot_is_accepted(child):
    message = odometry()
    message.child_frame_id = child
    assert messages.read_pose(message, BASE).x == 1.0


@pytest.mark.parametrize(
    "child", ["robot_b/base_link", "robot_a/odom", "camera_link", "robot_a//base_link", "robot_a"]
)
def test_odometry_of_another_frame_is_refused(child):
    message = odometry()
    message.child_frame_id = child
    with pytest.raises(PoseError, match=f"child_frame_id is '{child}'; wanted: '{BASE}' "):
        messages.read_pose(message, BASE)
    assert messages.read_pose(message).x == 1.0  # whatever it is of


def test_pose_without_child_frame_or_robot_name_is_read():
    message = odometry()
    message.child_frame_id = "base_footprint"
    assert messages.read_pose(message, "base_link").x == 1.0
    del message.child_frame_id
    assert messages.read_pose(message, BASE).x == 1.0


def transform(x=1.0, y=2.0, z=3.0, quaternion=(0, 0, 0, 1)) -> SimpleNamespace:
    turn = SimpleNamespace(**dict(zip("xyzw", quaternion, strict=True)))
    place = SimpleNamespace(x=x, y=y, z=z)
    return SimpleNamespace(
        header=header(), transform=SimpleNamespace(translation=place, rotation=turn)
    )


def test_transform_matches_hand_computed_pose():
    s = math.sqrt(0.5)
    pose = messages.read_transform(transform(quaternion=(0, 0, s, s)), (0.1, 0.2, 0.3))
    assert (pose.stamp_ns, pose.x, pose.y) == (12_000_000_345, 1.0, 2.0)
    assert pose.yaw == pytest.approx(math.pi / 2)
    np.testing.assert_allclose(pose.covariance, np.diag([0.01, 0.04, 0.09]))
    assert not messages.read_transform(transform()).covariance.any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": NAN}, "pose holds NaN or infinite"),
        ({"quaternion": (0, 0, 0, 0)}, "orientation has length 0"),
        ({"quaternion": (1, 0, 0, 0)}, "pose leans by 3.14 rad"),
    ],
)
def test_a_bad_transform_is_refused(changes, message):
    with pytest.raises(PoseError, match=message):
        messages.read_transform(transform(**changes))


def test_unused_covariance_entries_are_ignored():
    covariance = np.full((6, 6), NAN)
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] = np.diag([0.1, 0.2, 0.3])
    pose = messages.read_pose(odometry(covariance=covariance.reshape(-1)))
    np.testing.assert_array_equal(pose.covariance, np.diag([0.1, 0.2, 0.3]))


def test_unknown_covariance_is_finite():
    """It is given as DBL_MAX."""
    pose = messages.read_pose(odometry(covariance=np.eye(6).reshape(-1) * sys.float_info.max))
    np.testing.assert_array_equal(pose.covariance, np.eye(3) * 1e12)
    placed = Pose(0, 1.0, 2.0, 0.5) @ pose
    assert np.isfinite(placed.covariance).all()


def test_scans_used_for_people_are_read():
    def robot_scan(robot, nanosec, x):
        pose = with_covariance(x, 0.0, 0.0, (0, 0, 0, 1), (0.0,) * 36)
        return SimpleNamespace(robot=robot, stamp=stamp(1, nanosec), pose=pose)

    people = SimpleNamespace(scans=[robot_scan("robot_b", 5, 1.0), robot_scan("robot_a", 7, 2.0)])
    poses = messages.read_people_scans(people)
    assert {name: (p.stamp_ns, p.x) for name, p in poses.items()} == {
        "robot_b": (1_000_000_005, 1.0),
        "robot_a": (1_000_000_007, 2.0),
    }
    assert messages.read_people_scans(SimpleNamespace(scans=[])) == {}
    people.scans[0].pose.pose.position.x = NAN
    with pytest.raises(PoseError, match="NaN"):
        messages.read_people_scans(people)


# --------------------------------------------------------------------------------- scans ----

F4, F8, U4 = 7, 8, 6  # sensor_msgs/PointField
TYPES = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", U4: "<u4", F4: "<f4", F8: "<f8"}
FIELDS = {"x": F4, "y": F4, "z": F4, "z_min": F4, "top": F4, "count": U4}
CELLS = [(1.0, 2.0, 1.4, 0.2, 1.7, 30), (-1.0, 0.5, 1.3, 0.25, 1.75, 40)]
# A robot that seeks bodies says besides whose cell it is, how likely a person, and how sure.
BODY_FIELDS = FIELDS | {"body": U4, "score": F4, "sigma_range": F4, "sigma_across": F4}
BODY_CELLS = [(*CELLS[0], 2, -1.5, 0.125, 0.0625), (*CELLS[1], 1, 4.25, 0.5, 0.03125)]


def point_cloud(
    cells=CELLS, fields=None, *, offsets=None, point_step=None, **changes
) -> SimpleNamespace:
    """A PointCloud2 with one row of points; `fields` are names and datatypes in their order."""
    fields = FIELDS if fields is None else fields
    codes = [TYPES.get(kind, "<f4") for kind in fields.values()]
    sizes = [np.dtype(code).itemsize for code in codes]
    if offsets is None:
        offsets = [sum(sizes[:i]) for i in range(len(sizes))]
    point_step = sum(sizes) if point_step is None else point_step
    layout = np.dtype(
        {"names": list(fields), "formats": codes, "offsets": offsets, "itemsize": point_step}
    )
    records = np.zeros(len(cells), layout)
    for name in fields:
        if name in BODY_FIELDS:
            records[name] = [cell[list(BODY_FIELDS).index(name)] for cell in cells]
    values = {
        "header": header("robot_a/base_link"),
        "height": 1,
        "width": len(cells),
        "fields": [
            SimpleNamespace(name=name, offset=offset, datatype=kind, count=1)
            for (name, kind), offset in zip(fields.items(), offsets, strict=True)
        ],
        "is_bigendian": False,
        "point_step": point_step,
        "row_step": point_step * len(cells),
        "data": records.tobytes(),
        "is_dense": True,
    }
    return SimpleNamespace(**values | changes)


def read(message, **options) -> list[tuple]:
    """The cells of a message, as tuples of Python's numbers."""
    scan = messages.read_scan(message, "robot_a", **options)
    assert (scan.robot, scan.stamp_ns) == ("robot_a", 12_000_000_345)
    return [tuple(round(float(v), 6) for v in record) for record in scan.cells.to_records()]


def test_scan_matches_hand_computed_values():
    assert read(point_cloud()) == CELLS


def test_scan_of_bodies_matches_hand_computed_values():
    assert read(point_cloud(BODY_CELLS, BODY_FIELDS)) == BODY_CELLS
    shuffled = dict(reversed(BODY_FIELDS.items())) | {"label": 5, "sigma_range": F8, "body": 2}
    assert read(point_cloud(BODY_CELLS, shuffled)) == BODY_CELLS
    assert read(point_cloud([], BODY_FIELDS)) == []


@pytest.mark.parametrize("name", ["sigma_range", "sigma_across"])
@pytest.mark.parametrize("value", [0.0, -5.0])
def test_a_body_without_uncertainty_is_refused(name, value):
    index = list(BODY_FIELDS).index(name)
    cells = [list(cell) for cell in BODY_CELLS]
    cells[1][index] = value
    with pytest.raises(ScanError, match=f"{name} of a body is 0 or less"):
        read(point_cloud([tuple(cell) for cell in cells], BODY_FIELDS))


def test_cells_without_a_body_are_plain_cells():
    scan = messages.read_scan(point_cloud(), "robot_a")
    for name in ("body", "score", "sigma_range", "sigma_across"):
        np.testing.assert_array_equal(getattr(scan.cells, name), [0, 0])
    # Other fields of these names mean nothing without `body`.
    others = FIELDS | {"score": F4, "sigma_range": F4}
    scan = messages.read_scan(point_cloud(BODY_CELLS, others), "robot_a")
    np.testing.assert_array_equal(scan.cells.score, [0, 0])
    # And a body 0 is none.
    nobody = [(*CELLS[0], 0, 0.0, 0.0, 0.0), (*CELLS[1], 0, 0.0, 0.0, 0.0)]
    assert read(point_cloud(nobody, BODY_FIELDS)) == CELLS


@pytest.mark.parametrize("point_step", [24, 2**31, 2**32 - 1])
@pytest.mark.parametrize(
    "empty",
    [
        {"width": 0, "height": 0, "row_step": 0, "data": b""},
        {"width": 0, "height": 1, "row_step": 0, "data": b""},
        {"width": 7, "height": 0, "row_step": 2**36, "data": b""},
        {"width": 0, "height": 2, "row_step": 5, "data": bytes(10)},
        {"width": 0, "height": 0, "row_step": 0, "data": np.empty(0, dtype=np.uint8)},
    ],
    ids=str,
)
def test_empty_scan_is_valid(empty, point_step):
    message = point_cloud([], **empty)
    message.point_step = point_step
    assert read(message) == []


def test_fields_are_taken_by_name():
    shuffled = {"count": U4, "label": 5, "top": F4, "y": F4, "z_min": F4, "x": F4, "z": F4}
    assert read(point_cloud(fields=shuffled)) == CELLS
    assert read(point_cloud(offsets=[40, 4, 8, 12, 16, 20], point_step=48)) == CELLS


def test_fields_may_be_of_another_datatype():
    assert read(point_cloud(fields=FIELDS | {"x": F8, "z": F8, "count": 4})) == CELLS
    assert read(point_cloud(fields=FIELDS | {"count": F4})) == CELLS
    assert read(point_cloud([(1, 2, 1, 0, 1, 3)], FIELDS | {"x": 1, "y": 3, "z": 5})) == [
        (1, 2, 1, 0, 1, 3)
    ]


def test_several_padded_rows_are_read():
    one = point_cloud(CELLS[:1])
    rows = one.data + b"12345678" + point_cloud(CELLS[1:]).data + b"12345678"
    one.data, one.height, one.row_step = rows, 2, one.point_step + 8
    assert read(one) == CELLS


def test_scan_has_the_frame_of_its_robot():
    assert read(point_cloud(header=header("base_link")), frame_id="base_link") == CELLS
    with pytest.raises(ScanError, match="frame_id is 'map'; wanted: 'robot_a/base_link'"):
        read(point_cloud(header=header("map")))
    with pytest.raises(ScanError, match="frame_id is 'robot_a/base_link'; wanted: 'base_link'"):
        read(point_cloud(), frame_id="base_link")


def without(*names) -> dict[str, int]:
    return {name: kind for name, kind in FIELDS.items() if name not in names}


def counted(value: float, datatype: int = U4) -> SimpleNamespace:
    return point_cloud([(*CELLS[0][:5], value)], FIELDS | {"count": datatype})


def bodied(*, kind: int = U4, **changes: float) -> SimpleNamespace:
    """A scan of bodies with changed values in its first cell; `kind` is the type of `body`."""
    first = tuple((dict(zip(BODY_FIELDS, BODY_CELLS[0], strict=True)) | changes).values())
    return point_cloud([first, BODY_CELLS[1]], BODY_FIELDS | {"body": kind})


def field_of(**changes) -> SimpleNamespace:
    message = point_cloud()
    vars(message.fields[1]).update(changes)
    return message


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (point_cloud(is_bigendian=True), "is_bigendian is true; wanted: little-endian"),
        (
            point_cloud(fields=without("z_min", "top")),
            "fields are missing: z_min, top; got: x, y, z, count; wanted: x, y, z, z_min, top, co",
        ),
        (point_cloud(fields={}), "fields are missing: x, y.*; got: none"),
        (point_cloud(fields=without("count")), "fields are missing: count"),
        (field_of(datatype=9), "field y has datatype 9 and count 1; wanted: one number"),
        (field_of(datatype=0), "field y has datatype 0"),
        (field_of(count=3), "field y has datatype 7 and count 3; wanted: one number"),
        (field_of(count=0), "field y has datatype 7 and count 0"),
        (field_of(offset=21), "field y ends at byte 25; point_step is 24"),
        (field_of(offset=17, datatype=F8), "field y ends at byte 25; point_step is 24"),
        (point_cloud(row_step=47), "row_step is 47; wanted: at least 48"),
        (point_cloud(width=3), "row_step is 48; wanted: at least 72"),
        (point_cloud(data=bytes(47)), r"data has 47 bytes; wanted: row_step \* height = 48"),
        (point_cloud(data=bytes(49)), r"data has 49 bytes; wanted: row_step \* height = 48"),
        (point_cloud(data=b""), r"data has 0 bytes; wanted: row_step \* height = 48"),
        (point_cloud(height=2), r"data has 48 bytes; wanted: row_step \* height = 96"),
        (point_cloud([(NAN, *CELLS[0][1:]), CELLS[1]]), "x is NaN or infinite in 1 of 2 points"),
        (point_cloud([(1, 2, 3, 4, INF, 5)] * 2), "top is NaN or infinite in 2 of 2 points"),
        (
            point_cloud([(1e300, *CELLS[0][1:])], FIELDS | {"x": F8}),
            "x is NaN or infinite in 1 of 1 points",  # as float32 it is
        ),
        (counted(-1, 5), "count is negative or too large; wanted: uint32"),
        (counted(-1.0, F4), "count is negative or too large"),
        (counted(2.0**32, F8), "count is negative or too large"),
        (counted(2.0**32, F4), "count is negative or too large"),
        (
            point_cloud(BODY_CELLS, {k: v for k, v in BODY_FIELDS.items() if k != "sigma_range"}),
            "fields are missing: sigma_range; got: .*; wanted: .* body, score, sigma_range, sigma_",
        ),
        (bodied(body=-1.0, kind=F4), "body is negative or too large; wanted: uint32"),
        (bodied(body=2.0**32, kind=F8), "body is negative or too large"),
        (bodied(body=NAN, kind=F4), "body is NaN or infinite"),
        (bodied(score=NAN), "score is NaN or infinite in 1 of 2 points"),
        (bodied(sigma_range=INF), "sigma_range is NaN or infinite in 1 of 2 points"),
        (bodied(sigma_across=-INF), "sigma_across is NaN or infinite in 1 of 2 points"),
        (counted(NAN, F4), "count is NaN or infinite"),
        (counted(INF, F8), "count is NaN or infinite"),
    ],
)
def test_a_bad_scan_is_refused(message, error):
    with pytest.raises(ScanError, match=error):
        read(message)


def test_scan_above_the_size_limit_is_refused():
    bodies = [(*CELLS[0], 7 * i + 1, 3.0, 0.1, 0.1) for i in range(101)]
    assert len(read(point_cloud(bodies[:100], BODY_FIELDS))) == 100
    with pytest.raises(ScanError, match="scan has 101 bodies; allowed: up to 100"):
        read(point_cloud(bodies, BODY_FIELDS))
    assert len(read(point_cloud(CELLS * 5_000))) == 10_000
    with pytest.raises(ScanError, match="scan has 10001 cells; allowed: up to 10000"):
        read(point_cloud(CELLS * 5_000 + CELLS[:1]))


def test_largest_count_is_read():
    assert read(counted(2**32 - 1))[0][5] == 2**32 - 1
    assert read(counted(2.0**32 - 1, F8))[0][5] == 2**32 - 1


# ------------------------------------------------------------------------- occupancy grids ----


def occupancy_grid(
    data=(0, 100, -1, 0, 50, 0),
    *,
    width=3,
    height=2,
    resolution=0.05,
    place=(1.0, 2.0, 0.0),
    quaternion=(0.0, 0.0, 0.0, 1.0),
    frame_id="map",
) -> SimpleNamespace:
    origin = SimpleNamespace(
        position=SimpleNamespace(**dict(zip("xyz", place, strict=True))),
        orientation=SimpleNamespace(**dict(zip("xyzw", quaternion, strict=True))),
    )
    info = SimpleNamespace(width=width, height=height, resolution=resolution, origin=origin)
    return SimpleNamespace(header=header(frame_id), info=info, data=data)


@pytest.mark.parametrize(
    "make",
    [
        list,
        lambda values: np.array(values, dtype=np.int8),  # rosbags
        lambda values: array.array("b", values),  # rclpy
    ],
)
def test_occupancy_grid_matches_hand_computed_values(make):
    turned = (0.0, 0.0, math.sin(0.2), math.cos(0.2))
    message = occupancy_grid(make([0, 100, -1, 0, 50, 0]), quaternion=turned)
    grid = messages.read_occupancy_grid(message, "map")
    assert (grid.resolution, grid.x, grid.y) == (0.05, 1.0, 2.0)
    assert grid.yaw == pytest.approx(0.4)
    assert grid.data.dtype == np.int8
    np.testing.assert_array_equal(grid.data, [[0, 100, -1], [0, 50, 0]])
    # tf1's leading slash.
    assert messages.read_occupancy_grid(occupancy_grid(frame_id="/map"), "map") is not None


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"frame_id": "odom"}, "frame_id is 'odom'; wanted: 'map'"),
        ({"width": 4}, "data has 6 cells; wanted: width * height = 4 * 2"),
        ({"width": 0, "height": 0, "data": []}, "data has 0 cells; wanted"),
        ({"data": [0, 0, 0, 0, 0, 300]}, "data holds what is no int8"),
        ({"data": [0, 0, 0, 0, 0, 0.5]}, "data holds what is no int8"),
        ({"data": [0, 0, 0, 0, 0, -2]}, "data goes from -2 to 0"),
        ({"resolution": 0.0}, "resolution is 0.0 m"),
        ({"resolution": math.nan}, "resolution is nan m"),
        ({"place": (math.nan, 0.0, 0.0)}, "origin is (nan, 0.0, 0.0); wanted: finite"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "origin has an orientation of length 0"),
        ({"quaternion": (0.0, 0.0, 0.0, math.nan)}, "origin has an orientation of length nan"),
        ({"quaternion": (0.6, 0.0, 0.0, 0.8)}, "wanted: a level grid, turned about z"),
        ({"quaternion": (0.0, 0.02, 0.0, 0.9998)}, "wanted: a level grid"),  # 2.3 degrees
    ],
)
def test_a_bad_occupancy_grid_is_refused(changes, error):
    with pytest.raises(GridError) as err:
        messages.read_occupancy_grid(occupancy_grid(**changes), "map")
    assert error in str(err.value)


# --------------------------------------------------------------------------- range sensors ----


def sonar(**changes) -> SimpleNamespace:
    values = {
        "header": header("robot_a/sonar_0"), "field_of_view": 0.5, "min_range": 0.1,
        "max_range": 4.0, "range": 1.5, "variance": 0.0025,
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def test_range_matches_its_message():
    measured = messages.read_range(sonar())
    assert (measured.frame_id, measured.stamp_ns) == ("robot_a/sonar_0", 12_000_000_345)
    assert (measured.range, measured.field_of_view, measured.is_echo) == (1.5, 0.5, True)
    assert measured.variance == 0.0025
    before_iron = sonar()
    del before_iron.variance
    assert messages.read_range(before_iron).variance == 0.0


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, 0.05, 4.1, 0.0, -1.0])
def test_range_outside_the_limits_is_no_echo(value):
    assert not messages.read_range(sonar(range=value)).is_echo


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"field_of_view": 0.0}, "field_of_view is 0.0 rad; allowed: more than 0, at most pi"),
        ({"field_of_view": math.nan}, "field_of_view is nan rad"),
        ({"min_range": 4.0}, "min_range is 4.0 m and max_range 4.0 m; wanted: 0 <= min_range"),
        ({"min_range": -0.1}, "min_range is -0.1 m"),
        ({"variance": -1.0}, "variance is -1.0 m^2; wanted: at least 0"),
        ({"variance": math.nan}, "variance is nan m^2"),
        ({"max_range": math.inf}, "max_range inf m"),
        ({"max_range": math.nan}, "max_range nan m"),
    ],
)
def test_a_bad_sonar_is_refused(changes, error):
    with pytest.raises(RangeError) as err:
        messages.read_range(sonar(**changes))
    assert error in str(err.value)


def laser_scan(**changes) -> SimpleNamespace:
    values = {
        "header": header("robot_a/laser"), "angle_min": -1.0, "angle_increment": 0.5,
        "range_min": 0.1, "range_max": 8.0, "ranges": [1.0, 0.05, math.inf, 8.5, 3.0],
        "time_increment": 0.0,
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def test_laser_scan_matches_hand_computed_values():
    scan = messages.read_laser_scan(laser_scan())
    assert (scan.frame_id, scan.stamp_ns, scan.max_range) == ("robot_a/laser", 12_000_000_345, 8.0)
    np.testing.assert_allclose(scan.angles, [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_array_equal(scan.ranges, [1.0, np.nan, np.inf, np.nan, 3.0])


def test_laser_scan_from_left_to_right_is_turned_round():
    scan = messages.read_laser_scan(
        laser_scan(angle_min=1.0, angle_increment=-0.5, ranges=[1.0, 2.0, 3.0])
    )
    np.testing.assert_allclose(scan.angles, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(scan.ranges, [3.0, 2.0, 1.0])


def test_laser_scan_says_how_long_it_took():
    assert messages.read_laser_scan(laser_scan(time_increment=0.02)).sweep_s == pytest.approx(0.08)
    turned = laser_scan(
        angle_min=1.0, angle_increment=-0.5, ranges=[1.0, 2.0, 3.0], time_increment=0.02
    )
    assert messages.read_laser_scan(turned).sweep_s == pytest.approx(-0.04)


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"ranges": []}, "scan has 0 ranges; allowed: 1 to"),
        ({"angle_increment": 0.0}, "angle_increment 0.0 rad; wanted: finite, and a step"),
        ({"angle_min": math.nan}, "angle_min is nan"),
        ({"angle_increment": 2.0}, "scan covers 8.00 rad; allowed: a full turn"),
        ({"range_max": math.nan}, "max_range is nan m"),
        ({"range_max": 0.0}, "max_range is 0.0 m; wanted: more than 0"),
        ({"range_min": -1.0}, "range_min is -1.0 m; wanted: at least 0"),
        ({"time_increment": 1.0}, "scan takes 4.0 s (time_increment times its rays); allowed"),
        ({"time_increment": math.nan}, "scan takes nan s"),
    ],
)
def test_a_bad_laser_scan_is_refused(changes, error):
    with pytest.raises(RangeError) as err:
        messages.read_laser_scan(laser_scan(**changes))
    assert error in str(err.value)


# ------------------------------------------------------------------------------- fuzzing ----

small = st.integers(0, 8)
uint32 = small | st.sampled_from([2**31 - 1, 2**31, 2**32 - 1]) | st.integers(0, 2**32 - 1)
number = st.floats(width=64) | st.floats(-2, 2)


def only_our_errors(function, *arguments):
    """What the function returns; None if it refuses its arguments. Any other error passes."""
    try:
        return function(*arguments)
    except PeopleLocError:
        return None


@given(
    encoding=st.sampled_from([*messages.ENCODINGS, "mono16"]) | st.text(max_size=5),
    height=small | uint32,
    width=small | uint32,
    padding=st.integers(-2, 2),
    data=st.binary(max_size=200),
    whole=st.booleans(),
)
def test_any_image_is_read_or_refused(encoding, height, width, padding, data, whole):
    step = max(0, width * messages.ENCODINGS.get(encoding, (1, ""))[0] + padding)
    if whole and step * height <= 1000:
        data = (data + bytes(1000))[: step * height]
    message = SimpleNamespace(
        header=header(), height=height, width=width, encoding=encoding, step=step, data=data,
        is_bigendian=0,
    )  # fmt: skip
    grey = only_our_errors(messages.read_image, message)
    if grey is not None:
        assert grey.shape == (height, width)
        assert grey.dtype == np.uint8


@given(
    width=uint32,
    height=uint32,
    k=st.lists(number, min_size=9, max_size=9) | st.lists(number, max_size=10),
    r=st.lists(number, min_size=9, max_size=9) | st.lists(number, max_size=10),
    p=st.lists(number, min_size=12, max_size=12) | st.lists(number, max_size=13),
    d=st.lists(number, max_size=15),
    distortion_model=st.sampled_from(["plumb_bob", "equidistant", "", "rational_polynomial"])
    | st.text(max_size=4),
    binning_x=small,
)
def test_any_camera_info_is_read_or_refused(camera_info, **values):
    model = only_our_errors(messages.read_camera_info, camera_info(**values))
    if model is not None:
        only_our_errors(model.check_raw)
        only_our_errors(model.scaled_to_fit, 160, 120)


@given(
    x=number,
    y=number,
    quaternion=st.tuples(number, number, number, number)
    | st.floats(-4, 4).map(lambda yaw: (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))),
    covariance=st.lists(number, min_size=36, max_size=36) | st.just([0.1] * 36),
)
def test_any_pose_is_read_or_refused(x, y, quaternion, covariance):
    pose = only_our_errors(
        messages.read_pose, odometry(x, y, 0.0, quaternion, np.array(covariance))
    )
    if pose is not None:
        assert np.isfinite([pose.x, pose.y, pose.yaw]).all()
        assert np.isfinite(pose.covariance).all()


@st.composite
def point_clouds(draw):
    """Clouds that are right in most respects, with arbitrary bytes."""
    names = draw(st.permutations(list(draw(st.sampled_from([FIELDS, BODY_FIELDS])))))
    if draw(st.integers(0, 9)) == 0:
        names = [*names[:-1], draw(st.text(max_size=3))]
    kinds = {name: draw(st.sampled_from([1, 2, 3, 4, 5, U4, F4, F4, F4, F8])) for name in names}
    width, height = draw(small), draw(st.integers(0, 3))
    message = point_cloud([], kinds, width=width, height=height)
    message.row_step = width * message.point_step + draw(st.sampled_from([0, 0, 0, 5]))
    message.data = draw(st.binary(min_size=64)) * (message.row_step * height // 64 + 1)
    message.data = message.data[: message.row_step * height]
    for attribute in draw(
        st.lists(st.sampled_from(["width", "height", "point_step", "row_step", "data"]), max_size=2)
    ):
        value = draw(st.binary(max_size=100) if attribute == "data" else uint32)
        setattr(message, attribute, value)
    if draw(st.integers(0, 4)) == 0:
        field = draw(st.sampled_from(message.fields))
        setattr(field, draw(st.sampled_from(["offset", "datatype", "count"])), draw(uint32))
    return message


@given(point_clouds())
def test_any_scan_is_read_or_refused(message):
    scan = only_our_errors(messages.read_scan, message, "robot_a")
    if scan is not None:
        assert len(scan.cells) == message.width * message.height
        assert np.isfinite(scan.cells.x).all()


@given(
    data=st.binary(max_size=30),
    width=small | uint32,
    height=small | uint32,
    resolution=number,
    place=st.tuples(number, number, number),
    quaternion=st.tuples(number, number, number, number) | st.just((0.0, 0.0, 0.0, 1.0)),
    whole=st.booleans(),
)
def test_any_occupancy_grid_is_read_or_refused(
    data, width, height, resolution, place, quaternion, whole
):
    if whole:
        width, height = len(data), 1
    message = occupancy_grid(
        np.frombuffer(data, dtype=np.int8), width=width, height=height, resolution=resolution,
        place=place, quaternion=quaternion,
    )  # fmt: skip
    grid = only_our_errors(messages.read_occupancy_grid, message, "map")
    if grid is not None:
        walls = Walls(grid, occupied_from=65)
        assert (walls.distance(np.array([place[:2], (0.0, 0.0)])) >= 0).all()


@given(fov=number, low=number, high=number, value=number)
def test_any_range_is_read_or_refused(fov, low, high, value):
    message = sonar(field_of_view=fov, min_range=low, max_range=high, range=value)
    measured = only_our_errors(messages.read_range, message)
    if measured is not None and measured.is_echo:
        assert 0 <= low <= measured.range <= high < math.inf


@given(first=number, step=number, low=number, high=number, ranges=st.lists(number, max_size=8))
def test_any_laser_scan_is_read_or_refused(first, step, low, high, ranges):
    message = laser_scan(
        angle_min=first, angle_increment=step, range_min=low, range_max=high, ranges=ranges
    )
    scan = only_our_errors(messages.read_laser_scan, message)
    if scan is not None:
        assert scan.ranges.shape == scan.angles.shape == (len(ranges),)
        assert (np.diff(scan.angles) > 0).all()
        assert not (scan.ranges > high).any()
