"""Pictures of the network's training, and the views that are made of them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy", reason="outlines are read with scipy")

from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import BagError
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_studies.training import pictures
from mrs_studies.training.pictures import OTHER, PERSON, UNKNOWN, Cutout, Picture, label_of
from mrs_studies.training.renderings import _labelled
from mrs_studies.training.views import HEIGHT, WIDTH, composite, view_of

NOBODY = np.empty((0, 4))


def flat(level: int, shape: tuple[int, int] = (240, 320)) -> Picture:
    return Picture(np.full(shape, level, np.uint8), None, NOBODY)


def test_box_shows_a_person_in_its_middle_and_nothing_outside() -> None:
    label = label_of((120, 160), np.array([[50.0, 10.0, 90.0, 110.0]]), NOBODY)
    assert (label[:, :50] == OTHER).all()
    assert (label[:, 90:] == OTHER).all()
    assert label[45, 70] == PERSON
    assert label[12, 52] == UNKNOWN
    assert 0.2 < (label == PERSON)[10:110, 50:90].mean() < 0.6


def test_box_beyond_the_border_and_what_nobody_knows() -> None:
    boxes, unknown = np.array([[-40.0, -20.0, 40.0, 200.0]]), np.array([[100.0, 0.0, 120.0, 30.0]])
    label = label_of((120, 160), boxes, unknown)
    assert label.shape == (120, 160)
    assert (label[:31, 100:121] == UNKNOWN).all()
    assert (label[:, 45:100] == OTHER).all()
    assert (label == PERSON).any()


def test_views_show_what_the_picture_shows() -> None:
    # White people on black: as bright as their label says, whatever part is seen.
    label = label_of((240, 320), np.array([[100.0, 40.0, 160.0, 200.0]]), NOBODY)
    label[label == UNKNOWN] = OTHER
    people = np.array([[100.0, 40.0, 160.0, 200.0]])
    picture = Picture((200 * (label == PERSON)).astype(np.uint8), label, people)
    contrasts = []
    for seed in range(40):
        grey, shown, _ = view_of(picture, [flat(0)], np.random.default_rng(seed))
        assert grey.shape == shown.shape == (HEIGHT, WIDTH)
        if (shown == PERSON).sum() > 200:
            level = grey.astype(float)
            contrasts.append(level[shown == PERSON].mean() - level[shown == OTHER].mean())
    assert len(contrasts) > 20
    assert min(contrasts) > 10.0


def test_view_is_the_same_for_the_same_draw() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (240, 320), dtype=np.uint8)
    first, second = (
        view_of(Picture(noise, None, NOBODY), [flat(0)], np.random.default_rng(5)) for _ in range(2)
    )
    np.testing.assert_array_equal(first[0], second[0])
    assert not np.array_equal(
        first[0], view_of(Picture(noise, None, NOBODY), [flat(0)], np.random.default_rng(6))[0]
    )


def test_people_of_a_composite_are_where_its_label_says() -> None:
    opaque = np.zeros((100, 40), np.uint8)
    opaque[10:90, 10:30] = 255
    person = Cutout(
        np.full(opaque.shape, 255, np.uint8), opaque, (opaque > 0).astype(np.uint8), None
    )
    seen = 0
    for seed in range(20):
        made = composite([flat(20)], [person], np.random.default_rng(seed))
        assert made.label is not None
        shown = made.label == PERSON
        if shown.any():
            assert made.grey[shown].mean() > made.grey[made.label == OTHER].mean() + 20
            assert len(made.people)
            seen += 1
    assert seen > 10


@pytest.mark.parametrize(
    ("box", "stands"),
    [
        ((100, 40, 150, 200), True),
        ((100, 40, 190, 200), False),  # sits
        ((100, 40, 150, 239), False),  # the feet are not seen
    ],
)
def test_who_stands_has_a_place(box, stands) -> None:
    places = pictures.standing(np.array([box], dtype=float), 240)
    assert len(places) == stands
    if stands:
        np.testing.assert_allclose(places[0], [125, 200, 160 / 1.7, 1])


def test_places_move_with_the_view() -> None:
    # A bright bar as high as a body: it is seen from the foot to the head of its place.
    label = np.zeros((240, 320), np.uint8)
    label[60:180, 150:170] = PERSON
    people = np.array([[150.0, 60.0, 170.0, 180.0]])
    picture = Picture(200 * label, label, people, pictures.standing(people, 240))
    persons = []
    for seed in range(40):
        _, shown, places = view_of(picture, [flat(0)], np.random.default_rng(seed))
        u, foot, size, person = places[0]
        assert person == 1
        for height, wanted in ((0.3, PERSON), (1.4, PERSON), (2.1, OTHER), (-0.4, OTHER)):
            column, row = round(u), round(foot - size * height)
            seen = 0 <= column < WIDTH and 0 <= row < HEIGHT
            if seen and (kind := shown[row, column]) != UNKNOWN:
                if wanted == OTHER:
                    assert kind == OTHER
                else:
                    persons.append(kind == PERSON)
    assert len(persons) > 40
    assert np.mean(persons) > 0.8  # something stands before the others


def test_people_who_stand_in_a_composite_have_places() -> None:
    opaque = np.full((100, 40), 255, np.uint8)
    person = Cutout(opaque, opaque, np.full(opaque.shape, PERSON, np.uint8), (0.1, 0.9))
    kinds = []
    for seed in range(30):
        made = composite([flat(20)], [person], np.random.default_rng(seed))
        kinds += made.places[:, 3].tolist()
        boxes = made.people
        people = made.places[made.places[:, 3] == 1]
        np.testing.assert_allclose(people[:, 0], boxes[:, [0, 2]].mean(axis=1))
        tall = boxes[:, 3] - boxes[:, 1]
        np.testing.assert_allclose(people[:, 1], boxes[:, 3] - 0.1 * tall)
        np.testing.assert_allclose(people[:, 2], 0.8 * tall / 1.7)
    assert set(kinds) == {0.0, 1.0}  # things of a person's shape are asked about, too


def test_rendered_people_hide_who_is_behind_them() -> None:
    camera = StereoCamera(
        width=160, height=120, fx=140, fy=140, cx=79.5, cy=59.5, baseline=0.1,
        mounting=Mounting(height=1.0),
    )  # fmt: skip
    image = np.zeros((120, 160), np.uint8)
    people, robots = np.array([[3.0, 0.0], [4.0, 1.5], [9.0, -2.0]]), np.array([[2.0, 0.0]])
    view = _labelled(image, camera, people, np.empty((0, 2)))
    assert view.label is not None
    assert view.label[50, 80] == PERSON
    assert len(view.people) == 2  # the third one is too far to be looked for
    hidden = _labelled(image, camera, people, robots)
    assert hidden.label is not None
    assert hidden.label[50, 80] == UNKNOWN
    at = round(79.5 - 140 * 1.5 / 4.0)
    assert hidden.label[50, at] == PERSON


def test_missing_source_is_named_with_its_commit(tmp_path) -> None:
    with pytest.raises(BagError, match=r"yolox_people_detection at 3f1a88b"):
        pictures.Teacher(tmp_path)
