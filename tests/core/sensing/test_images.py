import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.config import Images
from mrs_people_loc.errors import CameraError, ImageError
from mrs_people_loc.geometry import rotation_from_rpy
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.sensing.images import ImagePreparer, Pairer, StereoImages

GREY = np.zeros((120, 160), dtype=np.uint8)


# ------------------------------------------------------------------------ one view ----


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ({"left": GREY.astype(float)}, r"left image is float64 of shape \(120, 160\); wanted: uin"),
        ({"right": np.zeros((120, 160, 3), np.uint8)}, r"right image is uint8 of shape \(120, 1"),
        ({"right": GREY[:, :-1]}, "right image is 159x120; wanted as left: 160x120"),
        ({"top": GREY.T}, "top image is 120x160; wanted as left: 160x120"),
        ({"top": GREY.astype(np.int8)}, "top image is int8"),
    ],
)  # fmt: skip
def test_images_of_different_sizes_are_refused(images, message):
    with pytest.raises(ImageError, match=message):
        StereoImages(0, **{"left": GREY, "right": GREY} | images)


# --------------------------------------------------------------------- preparation ----


def calibration(width=320, height=240, *, f=200.0, d=(), model="plumb_bob", **changes):
    k = np.array([[f, 0.0, width / 2 + 3], [0.0, f, height / 2 - 2], [0.0, 0.0, 1.0]])
    p = np.array(
        [[0.8 * f, 0.0, width / 2 - 0.5, 0.0], [0.0, 0.8 * f, height / 2 - 0.5, 0.0], [0, 0, 1, 0]]
    )
    values = {"k": k, "d": d, "r": np.eye(3), "p": p, "distortion_model": model}
    return CameraModel(width, height, **values | changes)


def test_raw_images_above_the_size_limit_are_refused():
    """A camera_info of some hundred bytes would take 400 MB."""
    large = calibration(8192, 8192)
    with pytest.raises(CameraError, match="raw images are 8192x8192; allowed, .* 16777216 pixels"):
        ImagePreparer(large, rectified=False, width=160, height=120)
    ImagePreparer(large, rectified=True, width=160, height=120)


def test_rectified_image_of_working_size_is_unchanged():
    image = np.random.default_rng(0).integers(0, 256, (120, 160)).astype(np.uint8)
    prepare = ImagePreparer(calibration(160, 120), rectified=True, width=160, height=120)
    np.testing.assert_array_equal(prepare(image), image)
    assert prepare.output == prepare.model


def test_scaling_averages_areas():
    image = np.kron([[10, 20], [30, 41]], np.ones((2, 2))).astype(np.uint8)
    image[0, 0] += 3
    prepare = ImagePreparer(calibration(4, 4), rectified=True, width=2, height=2)
    np.testing.assert_array_equal(prepare(image), [[11, 20], [30, 41]])


def test_output_model_and_image_have_the_same_size():
    prepare = ImagePreparer(calibration(333, 250), rectified=False, width=160, height=120)
    assert (prepare.output.width, prepare.output.height) == (160, 120)
    assert prepare(np.zeros((250, 333), dtype=np.uint8)).shape == (120, 160)


@pytest.mark.parametrize("shape", [(120, 160), (240, 321), (320, 240), (0, 0), (240, 320, 3)])
def test_image_that_does_not_fit_its_calibration_is_refused(shape):
    prepare = ImagePreparer(calibration(), rectified=True, width=160, height=120)
    message = f"image is {shape[1]}x{shape[0]}; wanted as in camera_info: 320x240"
    with pytest.raises(ImageError, match=message):
        prepare(np.zeros(shape, dtype=np.uint8))


def test_a_calibration_that_cannot_be_rectified_is_refused():
    model = calibration(d=(0.1,) * 5, model="omni")
    ImagePreparer(model, rectified=True, width=160, height=120)
    with pytest.raises(CameraError, match="distortion_model is 'omni'"):
        ImagePreparer(model, rectified=False, width=160, height=120)


def test_calibration_refused_by_opencv_is_an_error(monkeypatch):
    def refuse(*_):
        raise cv2.error("Bad argument")

    monkeypatch.setattr(cv2, "initUndistortRectifyMap", refuse)
    with pytest.raises(CameraError, match="OpenCV cannot rectify with this camera_info: Bad arg"):
        ImagePreparer(calibration(), rectified=False, width=160, height=120)


DISTORTIONS = {
    "none": ("plumb_bob", ()),
    "none, of a fisheye": ("equidistant", ()),
    "plumb_bob 4": ("plumb_bob", (-0.25, 0.06, 0.002, -0.001)),
    "plumb_bob 5": ("plumb_bob", (-0.25, 0.06, 0.002, -0.001, 0.01)),
    "rational 8": ("rational_polynomial", (0.4, 0.1, 1e-3, -1e-3, 0.02, 0.7, 0.15, 0.03)),
    "rational 12": (
        "rational_polynomial",
        (0.4, 0.1, 1e-3, -1e-3, 0.02, 0.7, 0.15, 0.03, 2e-3, -1e-3, 1e-3, 5e-4),
    ),
    "rational 14": (
        "rational_polynomial",
        (0.4, 0.1, 1e-3, -1e-3, 0.02, 0.7, 0.15, 0.03, 2e-3, -1e-3, 1e-3, 5e-4, 0.02, -0.015),
    ),
    "equidistant": ("equidistant", (-0.03, 0.01, -0.004, 0.001)),
    "fisheye": ("fisheye", (0.05, -0.02, 0.003, -0.001)),
}


def project(model: CameraModel, rays: np.ndarray) -> np.ndarray:
    """Raw pixels of rays in the raw camera's frame, by OpenCV's own projection."""
    d = np.array(model.d or (0.0,) * 4)
    if model.distortion_model in ("plumb_bob", "rational_polynomial"):
        pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), model.k, d)
    else:
        pixels, _ = cv2.fisheye.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), model.k, d)
    return pixels.reshape(-1, 2)


def draw_dots(size: tuple[int, int], centres: np.ndarray, sigma: float) -> np.ndarray:
    """Round dots, centred between pixels where they have to be; pixel centres are whole numbers."""
    v, u = np.mgrid[: size[1], : size[0]]
    image = np.zeros((size[1], size[0]))
    for x, y in centres:
        image += 250 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * sigma**2))
    return np.rint(np.minimum(image, 255)).astype(np.uint8)


def dot_near(image: np.ndarray, u: float, v: float, reach: int) -> np.ndarray:
    """Centre of the grey values around a pixel."""
    column, row = round(u), round(v)
    rows, columns = np.mgrid[row - reach : row + reach + 1, column - reach : column + reach + 1]
    grey = image[rows, columns].astype(float)
    return np.array([(grey * columns).sum(), (grey * rows).sum()]) / grey.sum()


@pytest.mark.parametrize("working", [(320, 240), (160, 120), (128, 96)], ids=str)
@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_distorted_points_map_to_their_rectified_pixels(distortion, working):
    kind, d = DISTORTIONS[distortion]
    rotation = rotation_from_rpy(0.03, -0.04, 0.02)  # a camera that is mounted askew
    model = calibration(d=d, model=kind, r=rotation)
    wanted = np.array([(u, v) for u in range(40, 300, 60) for v in range(30, 230, 45)], dtype=float)
    # Where the rectified camera sees them, and the same rays in the raw camera: r turns raw to
    # rectified.
    rays = np.column_stack([wanted, np.ones(len(wanted))]) @ np.linalg.inv(model.p[:, :3]).T
    raw = project(model, rays @ rotation)
    size = np.array([model.width, model.height])
    inside = ((raw > 10) & (raw < size - 10)).all(axis=1)
    assert inside.sum() > 0.6 * len(wanted)
    assert np.abs(raw - wanted)[inside].max() > 8  # there is something to undo

    prepare = ImagePreparer(model, rectified=False, width=working[0], height=working[1])
    image = prepare(draw_dots((model.width, model.height), raw[inside], sigma=1.5))
    assert image.shape == working[::-1]
    scale = working[0] / model.width
    for u, v in (wanted[inside] + 0.5) * scale - 0.5:
        found = dot_near(image, u, v, reach=math.ceil(10 * scale))
        np.testing.assert_allclose(found, (u, v), atol=0.12)


# -------------------------------------------------------------------------- pairing ----

MS = 1_000_000
TWO = ("left", "right")
THREE = ("left", "right", "top")


def feed(pairer: Pairer, *arrivals: tuple[str, float]) -> list[dict[str, float]]:
    """Adds images (camera, stamp in ms), and returns the stamps of the sets they complete."""
    sets = []
    for camera, stamp_ms in arrivals:
        found = pairer.add(camera, round(stamp_ms * MS), f"{camera} {stamp_ms:g}")
        if found is not None:
            assert list(found) == list(pairer.cameras)
            assert all(found[c][1] == f"{c} {found[c][0] / MS:g}" for c in found)
            sets.append({name: stamp / MS for name, (stamp, _) in found.items()})
    return sets


def same(stamp: float, cameras=TWO) -> dict[str, float]:
    return dict.fromkeys(cameras, stamp)


def test_images_of_equal_stamps_form_a_pair():
    pairer = Pairer(TWO)
    arrivals = [("left", 0), ("right", 0), ("right", 100), ("left", 100), ("left", 200)]
    assert feed(pairer, *arrivals) == [same(0), same(100)]
    assert feed(pairer, ("right", 200.000001)) == []
    assert pairer.unpaired == 0
    assert pairer.queue_size == 8


def test_three_cameras_pair_in_any_order():
    pairer = Pairer(THREE)
    arrivals = [("top", 0), ("right", 0), ("left", 0), ("left", 9), ("top", 9), ("right", 9)]
    assert feed(pairer, *arrivals) == [same(0, THREE), same(9, THREE)]


@pytest.mark.parametrize(
    ("allowed_ms", "stamp_ms", "pairs"),
    [(0, 0.000001, False), (5, 5, True), (5, -5, True), (5, 5.000001, False), (5, -6, False)],
)
def test_the_allowed_difference_is_inclusive(allowed_ms, stamp_ms, pairs):
    pairer = Pairer(TWO, max_difference_ns=allowed_ms * MS)
    sets = feed(pairer, ("left", 100), ("right", 100 + stamp_ms))
    assert sets == ([{"left": 100, "right": 100 + stamp_ms}] if pairs else [])


def test_nearest_image_is_paired():
    pairer = Pairer(TWO, max_difference_ns=20 * MS)
    assert feed(pairer, ("right", 85), ("right", 98), ("right", 110), ("left", 100)) == [
        {"left": 100, "right": 98}
    ]
    assert pairer.unpaired == 1  # that of 85
    assert feed(pairer, ("left", 125)) == [{"left": 125, "right": 110}]
    pairer = Pairer(TWO, max_difference_ns=20 * MS)
    assert feed(pairer, ("left", 85), ("left", 98), ("right", 100)) == [{"left": 98, "right": 100}]
    pairer = Pairer(TWO, max_difference_ns=20 * MS)
    assert feed(pairer, ("left", 98), ("left", 110), ("right", 100)) == [{"left": 98, "right": 100}]
    assert feed(pairer, ("right", 115)) == [{"left": 110, "right": 115}]
    # Of two equally near ones the earlier is taken: the later may pair yet.
    pairer = Pairer(TWO, max_difference_ns=20 * MS)
    assert feed(pairer, ("left", 90), ("left", 110), ("right", 100)) == [{"left": 90, "right": 100}]
    assert feed(pairer, ("right", 115)) == [{"left": 110, "right": 115}]
    assert pairer.unpaired == 0


def test_all_cameras_must_be_near_the_first():
    pairer = Pairer(THREE, max_difference_ns=5 * MS)
    assert feed(pairer, ("left", 100), ("right", 105), ("top", 94)) == []
    assert feed(pairer, ("top", 95)) == [{"left": 100, "right": 105, "top": 95}]  # 10 apart: fine


def test_waiting_images_are_bounded_and_counted():
    pairer = Pairer(TWO, queue_size=3)
    assert feed(pairer, *(("left", 10 * i) for i in range(5))) == []
    assert pairer.unpaired == 2  # those of 0 and 10
    assert feed(pairer, ("right", 10)) == []
    assert feed(pairer, ("right", 20)) == [same(20)]
    assert pairer.unpaired == 3
    assert feed(pairer, ("right", 40)) == [same(40)]
    assert pairer.unpaired == 4


def test_smallest_difference_of_unpaired_images_is_reported():
    pairer = Pairer(TWO, queue_size=2)
    assert pairer.smallest_difference_ns is None
    feed(pairer, ("left", 0), ("left", 100), ("left", 200))
    assert pairer.smallest_difference_ns is None  # there was no other camera's image
    feed(pairer, ("right", 130), ("left", 300), ("right", 207), ("left", 400))
    assert pairer.smallest_difference_ns == 7 * MS
    feed(pairer, ("left", 500))  # that of 300 was farther from any
    assert pairer.smallest_difference_ns == 7 * MS
    pairer.reset()
    assert pairer.smallest_difference_ns is None
    assert pairer.unpaired == 4


DEFAULT_NS = round(Images().max_stamp_difference * 1e9)


@pytest.mark.parametrize("rate_hz", [5, 30, 60, 100])
def test_by_default_pairs_are_of_one_exposure(rate_hz):
    """Left and right are stamped separately, images get lost; no image pairs with a neighbour."""
    rng = np.random.default_rng(rate_hz)
    pairer = Pairer(TWO, max_difference_ns=DEFAULT_NS)
    sets, lost = [], 0
    for frame in range(200):
        sent = {c: 1000 + 1000 / rate_hz * frame + rng.uniform(0, 0.8) for c in TWO}
        missing = TWO[frame % 2] if rng.random() < 0.1 else None
        lost += missing is not None
        sets += feed(pairer, *((c, stamp) for c, stamp in sent.items() if c != missing))
    assert len(sets) == 200 - lost
    assert 0 < lost < 50
    assert all(abs(found["left"] - found["right"]) < 0.9 for found in sets)


def test_for_unsynchronized_cameras_the_value_to_set_is_reported():
    """Half a frame apart at 30 Hz; with the reported value, each image has its pair."""
    arrivals = [(c, 1000 + 33.0 * k + (0 if c == "left" else 16.0)) for k in range(20) for c in TWO]
    pairer = Pairer(TWO, max_difference_ns=DEFAULT_NS)
    assert feed(pairer, *arrivals) == []
    why = pairer.why_unpaired()
    assert why == (
        "smallest difference of stamps seen: 0.0160 s; allowed by images.max_stamp_difference: "
        "0.005 s; trigger the cameras together, or, where nothing moves fast, set "
        "images.max_stamp_difference: 0.017 (half of the time between images)"
    )
    assert len(feed(Pairer(TWO, max_difference_ns=17 * MS), *arrivals)) == 20


def test_stamps_too_far_apart_are_attributed_to_different_clocks():
    pairer = Pairer(TWO, max_difference_ns=DEFAULT_NS, queue_size=2)
    for k in range(6):
        feed(pairer, ("left", 1000 + 33.0 * k), ("right", 6000 + 33.0 * k))
    assert pairer.why_unpaired().endswith(
        "of different clocks, or one of them is late by a constant"
    )
    assert "0.0330 s between images" in pairer.why_unpaired()


def test_no_difference_is_reported_for_a_single_camera():
    pairer = Pairer(TWO, queue_size=1)
    feed(pairer, ("left", 0), ("left", 100))
    assert "no image of the other camera that can be used" in pairer.why_unpaired()


def test_reset_drops_waiting_images():
    pairer = Pairer(TWO)
    feed(pairer, ("left", 100))
    pairer.reset()
    assert feed(pairer, ("right", 100)) == []
    assert feed(pairer, ("left", 50), ("left", 100)) == [same(100)]  # and the newest stamp


@pytest.mark.parametrize("late_ms", [0, 0.000001, 50, 1000])
def test_repeated_and_late_images_are_refused(late_ms):
    pairer = Pairer(TWO)
    feed(pairer, ("left", 2000))
    stamp_ns = 2000 * MS - round(late_ms * MS)
    with pytest.raises(ImageError, match=f"stamp is {stamp_ns} ns; wanted: newer than 2000000000"):
        feed(pairer, ("left", 2000 - late_ms))
    assert pairer.resets == 0
    assert feed(pairer, ("right", 2000)) == [same(2000)]


def test_used_stamp_is_refused():
    pairer = Pairer(TWO)
    feed(pairer, ("left", 100), ("right", 100))
    with pytest.raises(ImageError, match="wanted: newer than"):
        feed(pairer, ("left", 100))


def test_stamps_that_jump_back_reset_the_state():
    pairer = Pairer(TWO)
    feed(pairer, ("left", 5000), ("right", 4999))
    for late in (("left", 3900), ("right", 3900), ("left", 3950), ("right", 3950)):
        with pytest.raises(ImageError, match="wanted: newer than"):  # they may be late
            feed(pairer, late)
    assert feed(pairer, ("left", 3999), ("right", 3999), ("left", 4999)) == [same(3999)]
    assert pairer.resets == 1
    assert feed(pairer, ("right", 4999)) == [same(4999)]


@given(
    st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans()), max_size=12),
    st.randoms(use_true_random=False),
)
def test_every_complete_set_is_returned_once(arrived, random):
    """Stamps in order per camera, cameras interleaved at random, some images lost."""
    queues = {
        camera: [10.0 * i for i, row in enumerate(arrived) if row[c]]
        for c, camera in enumerate(THREE)
    }
    order = [camera for camera, stamps in queues.items() for _ in stamps]
    random.shuffle(order)
    pairer = Pairer(THREE, queue_size=100)
    sets = feed(pairer, *((camera, queues[camera].pop(0)) for camera in order))
    assert sets == [same(10.0 * i, THREE) for i, row in enumerate(arrived) if all(row)]
