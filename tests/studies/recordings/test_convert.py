"""Foreign recordings as bags: calibration, geometry, time and errors, on made-up inputs."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import BagError, CameraError, ConfigError
from mrs_people_loc.messages import read_camera_info, read_image, read_pose, stamp_ns_of
from mrs_people_loc.sensing.camera import StereoCamera

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_studies.commands.convert import app
from mrs_studies.recordings.frames import EPOCH_NS, parse_frames
from mrs_studies.recordings.oak import convert_oak, read_oak_calibration
from mrs_studies.recordings.pcd import read_rgbd
from mrs_studies.recordings.pcl import (
    PCL_FLOOR_NORMAL,
    convert_pcl,
    pcl_pitch,
    torsos_in_map,
)
from mrs_studies.recordings.right_view import fill_depth, render_right
from mrs_tools.bags.reader import BagReader

NAN = math.nan
WIDTH, HEIGHT = 128, 80
FRAMES = 7


# ---------------------------------------------------------------------------------- frames ----


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("::", range(10)),
        (":", range(10)),
        ("2:8:3", range(2, 8, 3)),
        ("7:", range(7, 10)),
        (":3", range(3)),
        ("::4", range(0, 10, 4)),
        ("5", range(5, 6)),
        ("8:99", range(8, 10)),
    ],
)
def test_frames_are_parsed(text: str, wanted: range) -> None:
    assert range(10)[parse_frames(text)] == wanted


@pytest.mark.parametrize("text", ["", "a", "1:b", "-3:", "::-1", "::0", "1:2:3:4", "1.5"])
def test_invalid_frames_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"frames is .*allowed: START:STOP:STEP"):
        parse_frames(text)


# ------------------------------------------------------------------------------------- OAK ----


def _camera(cx: float) -> dict[str, Any]:
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "intrinsicMatrix": [[100.0, 0.0, cx], [0.0, 101.0, 39.0], [0.0, 0.0, 1.0]],
        "distortionCoeff": [0.02, -0.01, 0.0005, -0.0005, 0.001, 0.01, *[0.0] * 8],
        "extrinsics": {},
    }


#: The right camera is turned a little and 7.5 cm to the right, as `x_right = R x_left + t`.
ROTATION = cv2.Rodrigues(np.array([0.01, -0.02, 0.015]))[0]
TRANSLATION_CM = (-7.5, 0.2, -0.1)


def _calibration() -> dict[str, Any]:
    left, right = _camera(63.0), _camera(66.0)
    left["extrinsics"] = {
        "rotationMatrix": ROTATION.tolist(),
        "translation": dict(zip("xyz", TRANSLATION_CM, strict=True)),
        "toCameraSocket": 2,
    }
    return {
        "cameraData": [[1, left], [2, right]],
        "stereoRectificationData": {"leftCameraSocket": 1, "rightCameraSocket": 2},
    }


def _write_json(path: Path, document: object) -> Path:
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    return _write_json(tmp_path / "calib.json", _calibration())


def test_oak_baseline_is_in_metres_and_right_of_the_left_camera(calibration: Path) -> None:
    left, right = read_oak_calibration(calibration)
    baseline = float(np.linalg.norm(TRANSLATION_CM)) * 0.01
    assert left.p[0, 3] == 0.0
    assert right.p[0, 3] == pytest.approx(-right.p[0, 0] * baseline)
    assert StereoCamera.from_models(left, right).baseline == pytest.approx(baseline)
    assert (left.distortion_model, len(left.d)) == ("rational_polynomial", 14)
    left.check_raw()


@pytest.mark.parametrize("reduce", [1, 2, 4])
def test_oak_rectification_gives_equal_rows_and_the_depth(calibration: Path, reduce: int) -> None:
    left, right = read_oak_calibration(calibration, reduce)
    assert (left.width, left.height) == (WIDTH // reduce, HEIGHT // reduce)
    points = np.array([[0.1, -0.2, 2.0], [-0.5, 0.3, 3.0], [0.4, 0.1, 1.5]])
    rectified = []
    for model, rotation, shift in (
        (left, np.eye(3), np.zeros(3)),
        (right, ROTATION, np.array(TRANSLATION_CM) * 0.01),
    ):
        raw, _ = cv2.projectPoints(
            points, cv2.Rodrigues(rotation)[0], shift, model.k, np.array(model.d)
        )
        undistorted = cv2.undistortPoints(
            raw, model.k, np.array(model.d), R=model.r, P=model.p[:, :3]
        )
        rectified.append(undistorted.reshape(-1, 2))
    np.testing.assert_allclose(rectified[0][:, 1], rectified[1][:, 1], atol=0.02)
    disparity = rectified[0][:, 0] - rectified[1][:, 0]
    depth = (points @ left.r.T)[:, 2]
    np.testing.assert_allclose(disparity, -right.p[0, 3] / depth, atol=0.02)
    assert (disparity > 0).all()


def test_oak_left_camera_at_the_right_is_refused(tmp_path: Path) -> None:
    document = _calibration()
    document["cameraData"][0][1]["extrinsics"]["translation"]["x"] = 7.5
    with pytest.raises(CameraError, match=r"-0.075 m to the right.*sockets swapped"):
        read_oak_calibration(_write_json(tmp_path / "calib.json", document))


def _without(*path: Any) -> dict[str, Any]:
    document = copy.deepcopy(_calibration())
    inner = document
    for key in path[:-1]:
        inner = inner[key]
    del inner[path[-1]]
    return document


@pytest.mark.parametrize(
    "document",
    [
        {},
        [],
        _without("stereoRectificationData"),
        _without("cameraData", 1),
        _without("cameraData", 0, 1, "intrinsicMatrix"),
        _without("cameraData", 0, 1, "distortionCoeff", 0),
        _without("cameraData", 0, 1, "extrinsics", "translation", "x"),
    ],
)
def test_oak_incomplete_calibration_is_refused(tmp_path: Path, document: object) -> None:
    with pytest.raises(CameraError, match="is not an OAK calibration"):
        read_oak_calibration(_write_json(tmp_path / "calib.json", document))


def test_oak_extrinsics_to_another_camera_are_refused(tmp_path: Path) -> None:
    document = _calibration()
    document["cameraData"][0][1]["extrinsics"]["toCameraSocket"] = 0
    with pytest.raises(CameraError, match="do not lead to the right camera"):
        read_oak_calibration(_write_json(tmp_path / "calib.json", document))


def test_oak_calibration_that_is_not_json_is_refused(tmp_path: Path) -> None:
    (tmp_path / "calib.json").write_text("{", encoding="utf-8")
    with pytest.raises(BagError, match=r"calib\.json cannot be read"):
        read_oak_calibration(tmp_path / "calib.json")
    with pytest.raises(BagError, match=r"missing\.json: there is no such file"):
        read_oak_calibration(tmp_path / "missing.json")


def test_endlessly_nested_oak_calibration_is_refused(tmp_path: Path) -> None:
    for text in ("[" * 200_000, '{"a":' * 200_000):
        (tmp_path / "calib.json").write_text(text, encoding="utf-8")
        with pytest.raises(BagError, match=r"calib\.json cannot be read: .*recursion"):
            read_oak_calibration(tmp_path / "calib.json")


@pytest.mark.parametrize(
    ("key", "value", "hint"),
    [
        ("width", 10**9, "image size is 1000000000x80; allowed: .* up to 8192x8192"),
        ("width", math.inf, "is not an OAK calibration"),
        ("height", 0, "image size is 128x0"),
        ("intrinsicMatrix", [[NAN] * 3] * 3, "k holds NaN"),
        ("intrinsicMatrix", [[0] * 3] * 3, "focal length"),
        ("intrinsicMatrix", [[10**400] * 3] * 3, "is not an OAK calibration"),
        ("distortionCoeff", [math.inf] * 14, "d holds NaN or infinite"),
    ],
)
def test_implausible_oak_numbers_are_refused(
    tmp_path: Path, key: str, value: object, hint: str
) -> None:
    document = _calibration()
    document["cameraData"][0][1][key] = value
    document["cameraData"][1][1][key] = value
    with pytest.raises(CameraError, match=hint):
        read_oak_calibration(_write_json(tmp_path / "calib.json", document))


@pytest.mark.parametrize("reduce", [0, 3, 256])
def test_oak_reduce_must_divide_the_size(calibration: Path, reduce: int) -> None:
    with pytest.raises(ConfigError, match=f"reduce is {reduce}; allowed: a divisor of 128 and 80"):
        read_oak_calibration(calibration, reduce)


def _write_video(path: Path, greys: list[int], rate_hz: float = 30.0) -> None:
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, (WIDTH, HEIGHT), True
    )
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no mp4")
    for grey in greys:
        writer.write(np.full((HEIGHT, WIDTH, 3), grey, np.uint8))
    writer.release()


@pytest.fixture
def recording(tmp_path: Path, calibration: Path) -> Path:
    """A recording whose frame i has grey 30 i + 20 at the left, 15 more at the right."""
    _write_video(tmp_path / "left.mp4", [30 * i + 20 for i in range(FRAMES)])
    _write_video(tmp_path / "right.mp4", [30 * i + 35 for i in range(FRAMES)])
    return tmp_path


def test_oak_bag_has_the_expected_messages(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "bag"
    assert convert_oak(recording, out, robot="eye", frames=slice(1, 6, 2), reduce=2) == 3
    models = read_oak_calibration(recording / "calib.json", 2)
    frames = {1: EPOCH_NS + 33_333_333, 3: EPOCH_NS + 100_000_000, 5: EPOCH_NS + 166_666_667}
    with BagReader(out) as bag:
        assert {topic.name: topic.count for topic in bag.topics.values()} == {
            "/eye/left/camera_info": 3,
            "/eye/left/image_raw": 3,
            "/eye/odom": 5,
            "/eye/right/camera_info": 3,
            "/eye/right/image_raw": 3,
        }
        for side, model, more in (("left", models[0], 0), ("right", models[1], 15)):
            images = list(bag.decoded([f"/eye/{side}/image_raw"]))
            infos = list(bag.decoded([f"/eye/{side}/camera_info"]))
            for (i, ns), (_, at, image), (_, _, info) in zip(
                frames.items(), images, infos, strict=True
            ):
                assert at == ns == stamp_ns_of(image.header.stamp) == stamp_ns_of(info.header.stamp)
                assert image.header.frame_id == info.header.frame_id == f"eye/{side}_camera_optical"
                grey = read_image(image)
                assert grey.shape == (HEIGHT // 2, WIDTH // 2)
                assert abs(float(grey.mean()) - (30 * i + 20 + more)) < 5
                read = read_camera_info(info)
                for name in ("k", "r", "p", "d"):
                    np.testing.assert_array_equal(getattr(read, name), getattr(model, name))
        stamps = []
        for _, at, odom in bag.decoded(["/eye/odom"]):
            assert (odom.header.frame_id, odom.child_frame_id) == ("map", "eye/base_link")
            pose = read_pose(odom)
            assert (pose.x, pose.y, pose.yaw) == (0.0, 0.0, 0.0)
            assert pose.stamp_ns == at
            stamps.append(at)
        # One pose at each pair, one before the first and one after the last.
        assert stamps == [EPOCH_NS, *frames.values(), EPOCH_NS + 200_000_000]


def test_oak_frames_keep_their_full_size(recording: Path, tmp_path: Path) -> None:
    assert convert_oak(recording, tmp_path / "bag", reduce=1) == FRAMES
    with BagReader(tmp_path / "bag") as bag:
        _, _, image = next(bag.decoded(["/robot_a/right/image_raw"]))
    assert read_image(image).shape == (HEIGHT, WIDTH)


def test_failed_oak_conversion_leaves_no_files(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "bag"
    with pytest.raises(BagError, match=f"no frame is left of the {FRAMES}"):
        convert_oak(recording, out, frames=slice(90, None))
    with pytest.raises(ConfigError, match="ROS namespaces"):
        convert_oak(recording, out, robot="robot a")
    _write_video(recording / "right.mp4", [0] * (FRAMES - 1))
    with pytest.raises(BagError, match="no stereo pair: 7 and 6 frames"):
        convert_oak(recording, out)
    _write_video(recording / "right.mp4", [0] * FRAMES, rate_hz=15.0)
    with pytest.raises(BagError, match=r"no stereo pair.*30 and 15 Hz"):
        convert_oak(recording, out)
    (recording / "right.mp4").unlink()
    with pytest.raises(BagError, match=r"right\.mp4 cannot be read as a video"):
        convert_oak(recording, out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["calib.json", "left.mp4"]


def test_oak_does_not_overwrite(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(BagError, match="exists already"):
        convert_oak(recording, tmp_path / "bag")


# ------------------------------------------------------------------------------ depth, warp ----


@pytest.mark.parametrize(
    ("row", "filled"),
    [
        ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
        ([1.0, NAN, NAN, 3.0], [1.0, 3.0, 3.0, 3.0]),
        ([4.0, NAN, 2.0, NAN, 3.0], [4.0, 4.0, 2.0, 3.0, 3.0]),
        # At the border: the 90th percentile of 1, 1, 1, 5, 5 is 5.
        ([NAN, 1.0, 1.0, 1.0, 5.0, 5.0, NAN], [5.0, 1.0, 1.0, 1.0, 5.0, 5.0, 5.0]),
    ],
)
def test_fill_depth_uses_the_background(row: list[float], filled: list[float]) -> None:
    np.testing.assert_allclose(fill_depth(np.array([row])), [filled])


def test_fill_depth_copies_the_nearest_row() -> None:
    depth = np.array([[NAN, NAN], [NAN, NAN], [2.0, 3.0], [NAN, NAN], [NAN, NAN], [4.0, NAN]])
    wanted = [[2.0, 3.0], [2.0, 3.0], [2.0, 3.0], [2.0, 3.0], [4.0, 4.0], [4.0, 4.0]]
    np.testing.assert_allclose(fill_depth(depth), wanted)


def test_fill_depth_needs_a_depth() -> None:
    with pytest.raises(BagError, match="no pixel has a depth"):
        fill_depth(np.full((3, 4), NAN))


def _texture(height: int, width: int) -> np.ndarray:
    image = np.random.default_rng(1).integers(0, 256, (height, width)).astype(np.uint8)
    return cv2.GaussianBlur(image, (0, 0), 1.0)


def test_render_right_moves_a_wall_to_the_left_by_its_disparity() -> None:
    left = _texture(6, 40)
    right = render_right(left, np.full(left.shape, 2.0), 10.0)  # 5 px
    np.testing.assert_array_equal(right[:, :35], left[:, 5:])
    # The right border, which the left camera did not see, is the mirrored wall.
    np.testing.assert_array_equal(right[:, 35:], left[:, 38:33:-1])


def test_render_right_between_pixels_is_linear() -> None:
    left = np.tile(np.arange(0, 200, 10, dtype=np.uint8), (2, 1))
    right = render_right(left, np.full(left.shape, 4.0), 10.0)  # 2.5 px
    np.testing.assert_array_equal(right[:, :17], left[:, 2:19] + 5)


def test_render_right_near_hides_far_and_background_fills_the_gap() -> None:
    left = _texture(4, 60)
    left[:, 30:40] = 255  # a near body on a wall
    depth = np.full(left.shape, 5.0)
    depth[:, 30:40] = 1.0
    right = render_right(left, depth, 10.0)  # body 10 px, wall 2 px
    np.testing.assert_array_equal(right[:, 20:29], 255)  # the body hides the wall
    np.testing.assert_array_equal(right[:, :19], left[:, 2:21])
    np.testing.assert_array_equal(right[:, 38:58], left[:, 40:60])
    # What the body hid from the left camera, 30 to 37, mirrors the wall to the right of it (to a
    # fraction of a pixel, since the edge lies between pixels).
    np.testing.assert_allclose(right[:, 31:38].astype(int), left[:, 46:39:-1], atol=15)


def test_render_right_matches_the_disparity_of_stereobm() -> None:
    left = _texture(60, 160)
    depth = np.full(left.shape, 5.0)
    depth[15:45, 60:100] = 2.0
    right = render_right(left, depth, 18.0)  # 3.6 and 9 px
    bm = cv2.StereoBM.create(numDisparities=16, blockSize=9)
    disparity = bm.compute(left, right) / 16.0
    assert np.median(disparity[22:38, 70:90]) == pytest.approx(9.0, abs=0.1)
    assert np.median(disparity[22:38, 120:150]) == pytest.approx(3.6, abs=0.1)


# ------------------------------------------------------------------------------------- PCL ----


def test_pcl_mounting_makes_the_floor_level() -> None:
    assert pcl_pitch() == pytest.approx(0.0738, abs=1e-4)  # nose down
    mounting = Mounting(height=1.259, pitch=pcl_pitch())
    camera = StereoCamera(160, 120, 131.0, 131.0, 79.5, 59.5, 0.12, mounting=mounting)
    rotation, translation = camera.robot_from_optical
    normal = np.array(PCL_FLOOR_NORMAL)
    np.testing.assert_allclose(rotation @ normal, [0.0, 0.0, 1.0], atol=0.0025)
    # A torso at the height of the optical axis, by the camera's own geometry.
    for (x, z), wanted in zip([(-0.90, 1.97), (0.77, 1.80)], torsos_in_map()[[0, 4]], strict=True):
        point = rotation @ [x, 0.0, z] + translation
        np.testing.assert_allclose(point[:2], wanted, atol=1e-3)
        assert 1.0 < point[2] < 1.3


def _write_pcd(path: Path, depth: np.ndarray, grey: int = 100) -> Path:
    """An organised ASCII file; a pixel without depth is NaN in x, y and z."""
    height, width = depth.shape
    color = grey << 16 | grey << 8 | grey
    rows = [f"{z:g} {z:g} {z:g} {color}" for z in depth.reshape(-1)]
    path.write_text(
        "VERSION 0.7\nFIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {depth.size}\nDATA ascii\n" + "\n".join(rows) + "\n",
        encoding="ascii",
    )
    return path


@pytest.fixture
def pcd(tmp_path: Path) -> Path:
    pytest.importorskip("pypcd4", reason="reading PCD files needs pypcd4")
    depth = np.full((12, 64), 3.0)
    depth[3:6, 10:20] = NAN
    return _write_pcd(tmp_path / "frame.pcd", depth)


def test_pcl_reads_grey_and_depth(pcd: Path) -> None:
    grey, depth = read_rgbd(pcd)
    np.testing.assert_array_equal(grey, np.full((12, 64), 100))
    assert np.isnan(depth[3:6, 10:20]).all()
    assert np.isnan(depth).sum() == 30
    assert np.nanmax(depth) == np.nanmin(depth) == 3.0


def test_pcl_bag_has_the_expected_messages(pcd: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    assert convert_pcl(pcd, out, robot="eye", repeat=3, rate_hz=10.0, baseline_m=0.2) == 3
    with BagReader(out) as bag:
        assert {topic.name: topic.count for topic in bag.topics.values()} == {
            "/eye/left/camera_info": 3,
            "/eye/left/image_rect": 3,
            "/eye/odom": 5,
            "/eye/right/camera_info": 3,
            "/eye/right/image_rect": 3,
            "/ground_truth/people_poses": 3,
        }
        stamps = [EPOCH_NS, EPOCH_NS + 100_000_000, EPOCH_NS + 200_000_000]
        lefts = list(bag.decoded(["/eye/left/image_rect"]))
        assert [at for _, at, _ in lefts] == stamps
        images = [read_image(message).astype(float) for _, _, message in lefts]
        assert np.std(images[0] - 100.0) == pytest.approx(2.0, rel=0.15)
        assert not np.array_equal(images[0], images[1])  # noise of its own
        infos = {
            side: read_camera_info(next(bag.decoded([f"/eye/{side}/camera_info"]))[2])
            for side in ("left", "right")
        }
        camera = StereoCamera.from_models(infos["left"], infos["right"])
        assert (camera.fx, camera.cx, camera.cy) == (525.0, 319.5, 239.5)
        assert camera.baseline == pytest.approx(0.2)
        assert camera.disparity_offset_px == 0.0
        for _, at, truth in bag.decoded(["/ground_truth/people_poses"]):
            assert truth.header.frame_id == "map"
            assert stamp_ns_of(truth.header.stamp) == at
            found = [(pose.position.x, pose.position.y) for pose in truth.poses]
            np.testing.assert_allclose(found, torsos_in_map())
            assert all(pose.position.z == 0.0 for pose in truth.poses)


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ({"repeat": 0}, "repeat is 0; allowed: at least 1"),
        ({"rate_hz": 0.0}, "rate is 0"),
        ({"rate_hz": NAN}, "rate is nan"),
        ({"baseline_m": -0.1}, "baseline is -0.1"),
        ({"noise_grey": math.inf}, "noise is inf"),
        ({"reduce": 5}, "reduce is 5; allowed: a divisor of 64 and 12"),
    ],
)
def test_pcl_refuses_numbers(
    pcd: Path, tmp_path: Path, option: dict[str, float], text: str
) -> None:
    with pytest.raises(ConfigError, match=text):
        convert_pcl(pcd, tmp_path / "out", **option)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_pcl_refuses_files(tmp_path: Path) -> None:
    pytest.importorskip("pypcd4", reason="reading PCD files needs pypcd4")
    with pytest.raises(BagError, match=r"missing\.pcd is no file"):
        read_rgbd(tmp_path / "missing.pcd")
    junk = tmp_path / "junk.pcd"
    junk.write_bytes(b"\x00\x01 no point cloud")
    with pytest.raises(BagError, match=r"junk\.pcd cannot be read as a PCD file"):
        read_rgbd(junk)
    line = _write_pcd(tmp_path / "line.pcd", np.full((1, 9), 2.0))
    with pytest.raises(BagError, match="9x1 points; wanted: an organised cloud"):
        read_rgbd(line)
    empty = _write_pcd(tmp_path / "empty.pcd", np.full((4, 8), NAN))
    with pytest.raises(BagError, match="no pixel has a depth"):
        convert_pcl(empty, tmp_path / "out")


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        ("COUNT 1 1 1 1", "COUNT 1 1 1 1000000000", "1000000003 values per point, 768 points"),
        (
            "POINTS 768\nDATA ascii",
            "POINTS 99999999999\nDATA binary",
            "1599999999984 bytes; allowed",
        ),
        (
            "DATA ascii\n",
            "DATA binary_compressed\n\n\0\0\0\xff\xff\xff\xff",
            "4294967295 bytes; all",
        ),
        ("WIDTH 64", "WIDTH 63", "768 points with colours of 4 bytes; wanted: 63x12 points"),
        ("SIZE 4 4 4 4", "SIZE 4 4 4 8", "colours of 8 bytes"),
        ("DATA ascii\n", "", "cannot be read as a PCD file"),
        ("VERSION", "VERSION" + 2000 * " ", "its header has no end"),
        ("COUNT 1 1 1 1", "COUNT 1 1 1", "its header is no header"),
        ("FIELDS x y z rgba", "FIELDS x y\nPOINTS", "cannot be read as a PCD file"),
    ],
)
def test_pcl_headers_above_the_size_limit_are_refused(
    pcd: Path, old: str, new: str, hint: str
) -> None:
    data = pcd.read_bytes()
    assert old.encode() in data
    pcd.write_bytes(data.replace(old.encode(), new.encode("latin-1")))
    with pytest.raises(BagError, match=hint) as caught:
        read_rgbd(pcd)
    assert "\n" not in str(caught.value)


# ---------------------------------------------------------------------------- command line ----


def test_oak_refuses_videos_of_another_size(recording: Path, tmp_path: Path) -> None:
    document = _calibration()
    for _, camera in document["cameraData"]:
        camera.update(width=8192, height=8192)
    _write_json(recording / "calib.json", document)
    with pytest.raises(BagError, match="the images are 128x80; calib.json is of 8192x8192"):
        convert_oak(recording, tmp_path / "bag")


def test_command_line_converts_and_reports_errors(recording: Path, tmp_path: Path) -> None:
    runner = CliRunner()
    out = tmp_path / "bag"
    result = runner.invoke(
        app, ["oak", str(recording), str(out), "--frames", "0:4:2", "--robot", "eye"]
    )
    assert result.exit_code == 0, result.output
    assert "2 stereo pairs of eye" in result.output
    assert out.is_dir()
    refused = runner.invoke(app, ["oak", str(recording), str(tmp_path / "x"), "--frames", "x"])
    assert isinstance(refused.exception, ConfigError)
