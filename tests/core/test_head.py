"""The head: calibration and images as messages in, views out."""

from types import SimpleNamespace

import numpy as np
import pytest

from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import CameraError, ImageError, StampError, WaitedError
from mrs_people_loc.head import Head

PIXELS = np.random.default_rng(0).integers(0, 255, (120, 160), dtype=np.uint8)


def image(n=1, encoding="mono8", camera="left") -> SimpleNamespace:
    pixels = PIXELS if encoding == "mono8" else np.repeat(PIXELS[:, :, np.newaxis], 3, axis=2)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=n, nanosec=0), frame_id=camera)
    return SimpleNamespace(
        header=header,
        width=160,
        height=120,
        encoding=encoding,
        step=pixels.size // 120,
        data=pixels.tobytes(),
    )


@pytest.fixture
def infos(camera_info):
    p = camera_info().p
    return {"left": camera_info(), "right": camera_info(p=[*p[:3], -20.0, *p[4:]])}


def calibrated(infos, **parameters) -> Head:
    head = Head("robot_a", RobotConfig.from_mapping(parameters))
    for camera, info in infos.items():
        assert head.take_camera_info(camera, info) is None
    return head


def take(head: Head, n=1, **encodings):
    assert head.take_image("left", image(n, encodings.get("left", "mono8"))) is None
    return head.take_image("right", image(n, encodings.get("right", "mono8"), "right"))


def test_pair_gives_a_view(infos):
    view = take(calibrated(infos), 7)
    assert view.images.stamp_ns == view.stages.scan.stamp_ns == 7_000_000_000
    assert view.header.frame_id == "left"
    assert view.stages.scan.robot == "robot_a"
    np.testing.assert_array_equal(view.images.right, PIXELS)


def test_images_wait_for_their_calibration(infos):
    head = Head("robot_a", RobotConfig())
    assert take(head, 1) is None
    assert head.take_camera_info("left", infos["left"]) is None
    with pytest.raises(ImageError, match="images are not used: no camera_info of right"):
        take(head, 2)
    view = head.take_camera_info("right", infos["right"])
    assert view is not None
    assert view.images.stamp_ns == 2_000_000_000


def test_images_that_do_not_fit_a_later_calibration_are_refused_as_images(infos, camera_info):
    """The calibration is usable, so the error is that of an image."""
    head = Head("robot_a", RobotConfig())
    assert take(head, 1) is None
    p = infos["right"].p
    head.take_camera_info("left", camera_info(width=168))
    with pytest.raises(
        WaitedError, match="image is 160x120; wanted as in camera_info: 168x120"
    ) as e:
        head.take_camera_info("right", camera_info(width=168, p=p))
    assert e.value.camera == "left"
    assert head.pipeline is not None

    head = Head("robot_a", RobotConfig())
    assert take(head, 1, right="bgr8") is None
    head.take_camera_info("left", infos["left"])
    with pytest.raises(WaitedError, match="wanted as left: 'mono8'") as e:
        head.take_camera_info("right", infos["right"])
    assert e.value.camera == "right"


def test_different_encodings_are_refused(infos):
    head = calibrated(infos)
    with pytest.raises(ImageError, match="right image is 'bgr8'; wanted as left: 'mono8'"):
        take(head, 1, right="bgr8")
    assert take(head, 2, left="bgr8", right="bgr8") is not None


def test_images_without_stamps_are_refused_at_once(infos):
    """Already the first one, not only the second one for not being newer."""
    head = calibrated(infos)
    for camera in ("left", "right"):
        with pytest.raises(StampError, match="its sender sets none"):
            head.take_image(camera, image(0, camera=camera))
    assert take(head, 1) is not None


def test_parameter_change_can_be_undone(infos):
    head = Head("robot_a", RobotConfig.from_mapping({"disparity": {"min_range": 0.1}}))
    head.take_camera_info("left", infos["left"])
    with pytest.raises(CameraError, match="raise min_range"):
        head.take_camera_info("right", infos["right"])
    assert take(head, 1) is None
    with pytest.raises(ImageError, match=r"images are not used: disparity.min_range = 0.1 m"):
        take(head, 2)
    head.configure(RobotConfig.from_mapping({"disparity": {"min_range": 0.12}}))  # no better
    head.configure(RobotConfig())
    assert take(head, 3) is not None


def test_unsuitable_parameter_is_refused(infos):
    head = calibrated(infos)
    with pytest.raises(CameraError, match="raise min_range"):
        head.configure(RobotConfig.from_mapping({"disparity": {"min_range": 0.1}}))
    assert take(head, 1) is not None  # as before


def test_changed_difference_of_stamps_applies_from_the_next_image(infos):
    def pair(n: int):
        """Images 30 ms apart."""
        assert head.take_image("left", image(n)) is None
        right = image(n, camera="right")
        right.header.stamp.nanosec = 30_000_000
        return head.take_image("right", right)

    head = calibrated(infos)
    assert pair(1) is None
    head.configure(RobotConfig.from_mapping({"images": {"max_stamp_difference": 0.05}}))
    assert pair(2).images.stamp_ns == 2_000_000_000
    head.configure(RobotConfig())
    assert pair(3) is None


def test_head_looking_steeply_down_is_refused_for_bodies(infos):
    for info in infos.values():
        info.p = [
            3.0 * info.p[0],
            0.0,
            info.p[2],
            3.0 * info.p[3],
            0.0,
            3.0 * info.p[5],
            *info.p[6:],
        ]
    down = {"mounting": {"pitch": 1.5}, "disparity": {"min_range": 2.0}}
    head = Head("robot_a", RobotConfig.from_mapping(down))
    head.take_camera_info("left", infos["left"])
    with pytest.raises(CameraError, match="bodies.search is true but the head looks steeply down"):
        head.take_camera_info("right", infos["right"])
    assert take(head, 1) is None
    with pytest.raises(ImageError, match="images are not used: bodies.search is true but"):
        take(head, 2)
    cells = RobotConfig.from_mapping(down | {"bodies": {"search": False}})
    head.configure(cells)
    assert take(head, 3) is not None
    with pytest.raises(CameraError, match="wanted: bodies.search false"):
        head.configure(RobotConfig.from_mapping(down))
    assert take(head, 4) is not None  # as before


def test_new_calibration_applies_from_the_next_image(infos, camera_info):
    head = calibrated(infos)
    before = head.pipeline
    assert head.take_camera_info("left", infos["left"]) is None
    assert head.pipeline is before
    p = camera_info().p
    head.take_camera_info("right", camera_info(p=[*p[:3], -40.0, *p[4:]]))
    assert head.pipeline.camera.baseline == pytest.approx(2 * before.camera.baseline, rel=0.01)
