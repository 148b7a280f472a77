"""Views of pictures as a robot's head would have them: small, grey, blurred, noisy, tilted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.sensing.images import Gray
from mrs_studies.training.pictures import BODY_HEIGHT, OTHER, UNKNOWN, Cutout, Picture

WIDTH, HEIGHT = 160, 120
#: Heights of the people that a view is centred on [px]: 8 m to 0.8 m away.
_SMALLEST, _TALLEST = 30.0, 310.0
#: People who walk past a near head are blurred by this much at most [px of a room's picture].
_WALK_BLUR = 12
#: A tilted body keeps the place of its middle, so far over the floor [m].
_HALF_BODY = BODY_HEIGHT / 2
#: No picture is enlarged more than this.
_LARGEST_SCALE = 3.0


def view_of(
    picture: Picture, rooms: Sequence[Picture], rng: np.random.Generator
) -> tuple[Gray, NDArray[np.uint8], Float]:
    """A part of a picture as a head's left image, its label, and places where bodies may stand.

    Shapes (`HEIGHT`, `WIDTH`), likewise, and (k, 4) as of `Picture`.

    Args:
        picture: The picture.
        rooms: Pieces of them stand in front of some views.
        rng: Draws the part and its distortion.
    """
    people, label = picture.people, picture.label
    grey: Any = picture.grey
    height, width = grey.shape
    if label is None:
        label = np.zeros(grey.shape, np.uint8)
    size = np.array([width, height])
    least = max(WIDTH / width, HEIGHT / height)  # fills the view
    aside = down = 0.0
    if len(people) and rng.random() < 0.85:
        left, top, right, bottom = people[rng.integers(len(people))]
        tall = max(bottom - top, 1.2 * (right - left), 4.0)
        scale = math.exp(rng.uniform(math.log(_SMALLEST), math.log(_TALLEST))) / tall
        middle = np.array([left + right, top + bottom]) / 2
        aside, down = rng.uniform(-0.52, 0.52) * WIDTH, rng.uniform(-0.4, 0.4) * HEIGHT
    else:
        scale = least * math.exp(rng.uniform(0.0, math.log(2.5)))
        middle = rng.uniform(0, size)
    scale = min(max(scale, 0.9 * least), _LARGEST_SCALE)
    if grey.shape == (HEIGHT, WIDTH) and rng.random() < 0.5:  # as it is
        scale, middle, aside, down = 1.0, size / 2, 0.0, 0.0
    angle = math.radians(rng.normal(0, 4) if rng.random() < 0.8 else rng.uniform(-14, 14))
    flip = -1.0 if rng.random() < 0.5 else 1.0
    stretch = math.exp(rng.normal(0.0, 0.06))
    middle = middle - np.array([aside, down]) / scale
    half = np.array([WIDTH, HEIGHT]) / (2 * scale)
    middle = np.clip(middle, np.minimum(half, size / 2), np.maximum(size - half, size / 2))
    cos, sin = scale * math.cos(angle), scale * math.sin(angle)
    linear = np.array([[flip * cos * stretch, -flip * sin], [sin * stretch, cos]])
    offset = np.array([WIDTH, HEIGHT]) / 2 - linear @ middle
    at = np.column_stack([linear, offset])
    if scale < 0.7:
        grey = cv2.GaussianBlur(grey, (0, 0), 0.45 / scale)
    seen: Any = cv2.warpAffine(grey, at, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    shown: Any = cv2.warpAffine(
        label, at, (WIDTH, HEIGHT), flags=cv2.INTER_NEAREST, borderValue=UNKNOWN
    )
    if rng.random() < 0.3:  # something in front
        left, top = rng.integers(0, WIDTH - 20), rng.integers(HEIGHT // 4, HEIGHT)
        columns = slice(left, left + rng.integers(15, 90))
        other = cv2.resize(_one_of(rooms, rng).grey, (WIDTH, HEIGHT))
        seen[top:, columns], shown[top:, columns] = other[top:, columns], OTHER
    up = picture.places[:, 2] * _HALF_BODY
    middles = (picture.places[:, :2] - np.column_stack([0 * up, up])) @ linear.T + offset
    places = np.column_stack([middles, scale * picture.places[:, 2:]])
    places[:, 1] += places[:, 2] * _HALF_BODY
    places[:, 3] = picture.places[:, 3]
    return _by_a_cheap_camera(seen, rng), shown, places


def _by_a_cheap_camera(image: Gray, rng: np.random.Generator) -> Gray:
    """Blur, gamma, contrast, brightness, gradients of light and noise."""
    values: Any = image.astype(np.float32)
    if rng.random() < 0.5:
        values = cv2.GaussianBlur(values, (0, 0), rng.uniform(0.2, 1.0))
    if rng.random() < 0.15:  # it turns
        values = cv2.blur(values, (int(rng.integers(2, 8)), 1))
    values = 255 * (values / 255).clip(0, 1) ** math.exp(rng.uniform(-0.5, 0.5))
    mean = values.mean()
    values = mean + (values - mean) * math.exp(rng.uniform(-0.7, 0.3)) + rng.uniform(-30, 30)
    across, down = np.linspace(-1, 1, WIDTH), np.linspace(-1, 1, HEIGHT)[:, np.newaxis]
    values = values * (1 + rng.uniform(-0.5, 0.5) * across + rng.uniform(-0.4, 0.4) * down)
    values = values + rng.normal(0, 1, values.shape) * 6 * rng.random() ** 2
    return np.clip(values.round(), 0, 255).astype(np.uint8)


def composite(
    rooms: Sequence[Picture], cutouts: Sequence[Cutout], rng: np.random.Generator
) -> Picture:
    """A room with people put into it, and with things of their shape that are none.

    Args:
        rooms: Rooms without people.
        cutouts: The people.
        rng: Draws who stands where.
    """
    room: Any = _one_of(rooms, rng).grey
    if rng.random() < 0.6:
        room = cv2.resize(room, (360, 360 * room.shape[0] // room.shape[1]))
    image: Float32 = room.astype(np.float32)
    height, width = image.shape
    label = np.zeros(image.shape, np.uint8)
    people, places = [], []
    for _ in range(rng.integers(1, 6)):
        cutout: Cutout = cutouts[int(rng.integers(len(cutouts)))]
        tall = math.exp(rng.uniform(math.log(0.22), math.log(1.9))) * height
        foot = height * rng.uniform(0.55, 0.8) + tall * rng.uniform(0.1, 0.6)
        at = rng.uniform(0, width)
        person = rng.random() < 0.65
        if cutout.body:
            low, high = foot - tall * (1.0 - cutout.body[1]), foot - tall * (1.0 - cutout.body[0])
            places.append([at, low, (low - high) / BODY_HEIGHT, float(person)])
        if person:
            half = 0.5 * tall * cutout.grey.shape[1] / cutout.grey.shape[0]
            people.append([at - half, foot - tall, at + half, foot])
        else:
            opaque = cutout.opaque[::-1] if rng.random() < 0.5 else cutout.opaque
            if rng.random() < 0.5:
                opaque = np.full(opaque.shape, 255, np.uint8)
            filling: Any = cv2.resize(_one_of(rooms, rng).grey, (opaque.shape[1], opaque.shape[0]))
            cutout = Cutout(filling, opaque, np.zeros(opaque.shape, np.uint8), None)
        _put(image, label, cutout, tall=tall, foot=foot, at=at, rng=rng)
        if rng.random() < 0.35:  # furniture before them
            other = cv2.resize(_one_of(rooms, rng).grey, (width, height))
            left, top = int(rng.uniform(0, width)), int(foot - tall * rng.uniform(0.1, 0.6))
            part = (
                slice(max(top, 0), None),
                slice(left, left + int(rng.uniform(0.1, 0.5) * width)),
            )
            image[part], label[part] = other[part], OTHER
    grey = np.clip(image, 0, 255).astype(np.uint8)
    boxes, found = (np.array(some, dtype=np.float64).reshape(-1, 4) for some in (people, places))
    return Picture(grey, label, boxes, found)


def _put(
    image: Float32,
    label: NDArray[np.uint8],
    cutout: Cutout,
    *,
    tall: float,
    foot: float,
    at: float,
    rng: np.random.Generator,
) -> None:
    """Puts somebody into a picture, more or less in its light; changes picture and label."""
    scale = tall / len(cutout.grey)
    size = max(int(cutout.grey.shape[1] * scale), 2), max(int(tall), 4)
    smooth = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    grey: Any = cv2.resize(cutout.grey, size, interpolation=smooth).astype(np.float32)
    opaque: Any = cv2.resize(cutout.opaque, size, interpolation=smooth).astype(np.float32) / 255
    shown: Any = cv2.resize(cutout.label, size, interpolation=cv2.INTER_NEAREST)
    if rng.random() < 0.5:
        grey, opaque, shown = (part[:, ::-1] for part in (grey, opaque, shown))
    opaque = cv2.GaussianBlur(np.ascontiguousarray(opaque), (0, 0), rng.uniform(0.3, 1.0))
    if rng.random() < 0.2:
        along = (int(rng.integers(2, _WALK_BLUR)), 1)
        grey, opaque = cv2.blur(np.ascontiguousarray(grey), along), cv2.blur(opaque, along)
    left, top = int(at - size[0] / 2), int(foot - size[1])
    rows = slice(max(top, 0), min(top + size[1], image.shape[0]))
    columns = slice(max(left, 0), min(left + size[0], image.shape[1]))
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return
    inside = (
        slice(rows.start - top, rows.stop - top),
        slice(columns.start - left, columns.stop - left),
    )
    grey, opaque, shown = grey[inside], opaque[inside], shown[inside]
    there = image[rows, columns]
    own = (grey * opaque).sum() / max(opaque.sum(), 1.0)
    contrast = ((there.std() + 5) / (grey.std() + 5)) ** rng.uniform(0, 0.7)
    grey = (grey - own) * contrast * math.exp(rng.normal(0, 0.2)) + own
    grey = grey + (there.mean() - own) * rng.uniform(0, 0.6)
    there[:] = there * (1 - opaque) + grey.clip(0, 255) * opaque
    part = label[rows, columns]
    part[opaque > 0.2] = UNKNOWN
    part[opaque > 0.5] = shown[opaque > 0.5]


def _one_of(rooms: Sequence[Picture], rng: np.random.Generator) -> Picture:
    return rooms[int(rng.integers(len(rooms)))]
