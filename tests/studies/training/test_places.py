"""Places at which a network is asked whether a person stands there."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy", reason="outlines are read with scipy")

from mrs_people_loc.bodies.network import (
    WINDOW_ACROSS,
    WINDOW_HEIGHTS,
    PersonNetwork,
    window_input,
)
from mrs_people_loc.bodies.patches import upright_pixels
from mrs_people_loc.config import Mounting
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_studies.training.pictures import OTHER, PERSON, UNKNOWN
from mrs_studies.training.places import COUNT, asked
from mrs_studies.training.views import HEIGHT, WIDTH

#: A person 3 m away: foot, pixels of a metre.
PERSON_PLACE = np.array([[80.0, 100.0, 47.0, 1.0]])


def drawn(seed: int, told=PERSON_PLACE, kind=PERSON):
    label = np.full((HEIGHT, WIDTH), OTHER, np.uint8)
    for u, foot, size, _ in told:
        rows = slice(max(int(foot - 1.7 * size), 0), int(foot))
        label[rows, int(u - 0.25 * size) : int(u + 0.25 * size)] = kind
    return asked(told, label, np.random.default_rng(seed))


def across(places) -> np.ndarray:
    """Of the person who is told of [m]."""
    return np.abs(places[:, 0] - PERSON_PLACE[0, 0]) / PERSON_PLACE[0, 2]


def test_people_are_asked_for_nearly_where_they_are() -> None:
    for seed in range(50):
        places = drawn(seed)
        assert places.shape == (COUNT, 5)
        people = places[places[:, 3] > 0]
        assert len(people) == 1
        assert people[0, 4] == 1
        assert across(people)[0] < 0.35
        assert abs(np.log(people[0, 2] / PERSON_PLACE[0, 2])) < 0.45


def test_nobody_is_where_no_person_is_shown() -> None:
    known = []
    for seed in range(50):
        places = drawn(seed)
        nobody = places[(places[:, 3] == 0) & (places[:, 4] > 0)]
        alike = np.abs(np.log(nobody[:, 2] / PERSON_PLACE[0, 2])) < np.log(1.6)
        assert (across(nobody)[alike] > 0.19).all()
        known.append(len(nobody))
    assert 3 < np.mean(known) < COUNT


def test_a_wrong_range_of_a_person_is_nobody() -> None:
    at_axis = 0
    for seed in range(50):
        places = drawn(seed)
        nobody = places[(places[:, 3] == 0) & (places[:, 4] > 0)]
        ratio = np.exp(np.abs(np.log(nobody[across(nobody) < 0.02, 2] / PERSON_PLACE[0, 2])))
        assert (ratio > 1.6).all()
        at_axis += len(ratio)
    assert at_axis > 20


def test_hidden_people_and_what_nobody_knows_are_not_asked_for() -> None:
    assert not any(drawn(seed, kind=OTHER)[0, 4] for seed in range(20))
    unknown = np.full((HEIGHT, WIDTH), UNKNOWN, np.uint8)
    told = np.empty((0, 4))
    assert not asked(told, unknown, np.random.default_rng(0))[:, 4].any()


def test_windows_of_training_are_those_of_the_robots() -> None:
    torch = pytest.importorskip("torch", reason="networks are trained with torch")
    pytest.importorskip("onnx", reason="networks are written with onnx")
    from mrs_studies.train_network import windows

    camera = StereoCamera(
        width=160, height=120, fx=140, fy=140, cx=79.5, cy=59.5, baseline=0.1,
        mounting=Mounting(height=1.0),
    )  # fmt: skip
    features = np.random.default_rng(0).uniform(size=(32, 40, 5)).astype(np.float32)
    away = 3.0
    place = [79.5, 59.5 + 140 / away, 140 / away, 1.0, 1.0]
    places = torch.tensor([[place]], dtype=torch.float32)
    trained = windows(torch.from_numpy(features.transpose(2, 0, 1)[None]), places).numpy()
    u, v, _, inside = upright_pixels(
        camera, np.zeros(1), np.array([away]), WINDOW_HEIGHTS, WINDOW_ACROSS
    )
    seen = PersonNetwork(camera)._sampled(features, u, v)
    robots = window_input(seen, inside, np.array([140 / away]))
    np.testing.assert_allclose(trained, robots, atol=0.02)
