"""Pictures with what they show: people, something else, or what nobody knows."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import scipy.io
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.sensing.images import Gray
from mrs_studies.training import sources

#: What pixels show.
OTHER, PERSON, UNKNOWN = 0, 1, 2
#: Longest side of pictures, and height of outlined people [px].
SIDE, TALL = 480, 300
#: A picture shows people where the teacher is surer than the first, and nobody where it is less
#: sure than the last; of a picture with people, what it gives less than the first and more than the
#: second is unknown.
_SURE, _PERHAPS, _NOBODY = 0.55, 0.15, 0.2
#: A box of people that views are centred on has this height at least [px].
_LEAST_BOX = 30
#: Fewer pixels than this are no outlined person.
_LEAST_OUTLINE = 800
_SIDES = "xmin", "ymin", "xmax", "ymax"
_NO_BOXES = np.empty((0, 4))
#: Boxes around people who stand are so many times as high as wide; height of people [m].
_STANDING, BODY_HEIGHT = 2.1, 1.7
#: What is nearer to the lower border of a picture is not seen whole [px].
_BORDER = 3


class Picture(NamedTuple):
    """A picture and what it shows.

    Attributes:
        grey: uint8, shape (height, width).
        label: `OTHER`, `PERSON` or `UNKNOWN` by pixel, uint8, likewise; None: `OTHER` everywhere.
        people: Left, upper, right and lower border of boxes around people [px], shape (n, 4).
        places: Where bodies may stand, shape (k, 4): column and row of the foot [px], pixels of a
            metre, 1 for a person and 0 for none.
    """

    grey: Gray
    label: NDArray[np.uint8] | None
    people: Float
    places: Float = _NO_BOXES


class Cutout(NamedTuple):
    """A person who can be put into another picture.

    Attributes:
        grey: uint8, shape (height, width).
        opaque: From 0 to 255, uint8, likewise.
        label: As of `Picture`.
        body: Rows of head and feet, as shares of the height; None: they are not seen whole.
    """

    grey: Gray
    opaque: NDArray[np.uint8]
    label: NDArray[np.uint8]
    body: tuple[float, float] | None


def figure(tall: bool) -> NDArray[np.uint8]:
    """What a box around a person shows, shape (64, 33): `PERSON` where hardly anything else is."""
    down, aside = np.linspace(0, 1, 64)[:, np.newaxis], np.abs(np.linspace(-1, 1, 33))
    if tall:  # head, trunk, legs
        person = (down > 0.04) & (down < 0.15) & (aside < 0.22)
        person |= (down >= 0.15) & (down < 0.6) & (aside < 0.45)
        person |= (down >= 0.6) & (down < 0.9) & (aside < 0.3)
    else:
        person = ((down - 0.5) / 0.42) ** 2 + (aside / 0.5) ** 2 < 1
    return np.where(person, PERSON, UNKNOWN).astype(np.uint8)


def standing(boxes: Float, rows: int) -> Float:
    """Places of people who stand, as of `Picture`.

    Args:
        boxes: Around people [px], shape (n, 4).
        rows: Height of the picture [px].
    """
    left, top, right, bottom = boxes.T
    tall = bottom - top
    whole = (tall > _STANDING * (right - left)) & (bottom < rows - _BORDER)
    places = [(left + right) / 2, bottom, tall / BODY_HEIGHT, np.ones(len(boxes))]
    return np.column_stack(places)[whole]


def label_of(shape: tuple[int, ...], people: Float, unknown: Float) -> NDArray[np.uint8]:
    """The label of a picture with boxes around people, and boxes of what nobody knows."""
    label = np.zeros(shape, np.uint8)
    for left, top, right, bottom in unknown.clip(0).astype(int):
        label[top : bottom + 1, left : right + 1] = UNKNOWN
    person = np.zeros(shape, dtype=bool)
    size = shape[1], shape[0], shape[1], shape[0]
    for left, top, right, bottom in np.clip(people.round().astype(int), 0, size):
        wide, tall = right - left, bottom - top
        if wide < 2 or tall < 2:
            continue
        shown = cv2.resize(figure(tall > 1.5 * wide), (wide, tall), interpolation=cv2.INTER_NEAREST)
        part = label[top:bottom, left:right]
        part[:] = UNKNOWN
        person[top:bottom, left:right] |= shown == PERSON
    label[person] = PERSON
    return label


def reduced(
    image: Any, boxes: Float, label: NDArray[np.uint8] | None = None
) -> tuple[Gray, Float, NDArray[np.uint8] | None]:
    """A picture in grey with `SIDE` as its longest side, and what belongs to it."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    scale = min(1.0, SIDE / max(grey.shape))
    size = round(grey.shape[1] * scale), round(grey.shape[0] * scale)
    if scale < 1.0:
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    if label is not None:
        label = np.asarray(cv2.resize(label, size, interpolation=cv2.INTER_NEAREST))
    return grey, boxes.reshape(-1, 4) * scale, label


class Teacher:
    """Boxes around people by a larger detector (YOLOX).

    Args:
        folder: Holds the checkouts of all sources.

    Raises:
        BagError: That of the teacher is missing.
    """

    def __init__(self, folder: Path) -> None:
        path = sources.TEACHER.within(folder) / "weights/model.onnx"
        import onnxruntime

        self._network = onnxruntime.InferenceSession(str(path))
        _, _, rows, columns = self._network.get_inputs()[0].shape
        self._size = 2 * columns, 2 * rows
        cells = []
        for stride in (8, 16, 32):
            row, column = np.indices([-(-side // stride) for side in self._size[::-1]])
            cells.append(
                np.stack([column, row, np.full(row.shape, stride)], axis=-1).reshape(-1, 3)
            )
        self._cells = np.concatenate(cells)

    def __call__(self, image: Any) -> tuple[Float, Float]:
        """Boxes [px], shape (n, 4), and how sure they are, from 0 to 1, shape (n,)."""
        scale = min(self._size[0] / image.shape[1], self._size[1] / image.shape[0])
        small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        whole: Any = np.full((*self._size[::-1], 3), 114, np.float32)
        small = small[: whole.shape[0], : whole.shape[1]]
        whole[: small.shape[0], : small.shape[1]] = small
        parts = [whole[row::2, column::2] for column in (0, 1) for row in (0, 1)]
        given = np.concatenate(parts, axis=-1).transpose(2, 0, 1)[np.newaxis]
        (found,) = self._network.run(None, {self._network.get_inputs()[0].name: given})
        score = found[0, :, 4] * found[0, :, 5]
        some = np.flatnonzero(score > 0.5 * _PERHAPS)
        (values, cells), score = (found[0, some], self._cells[some]), score[some]
        size = np.exp(values[:, 2:4]) * cells[:, 2:]
        corner = (values[:, :2] + cells[:, :2]) * cells[:, 2:] - 0.5 * size
        kept: Any = cv2.dnn.NMSBoxes(np.hstack([corner, size]).tolist(), score.tolist(), 0.0, 0.5)
        kept = np.asarray(kept, dtype=int).ravel()
        boxes = np.hstack([corner, corner + size])[kept] / scale
        return boxes.astype(np.float64), score[kept].astype(np.float64)


def _read(path: Path, mode: int = cv2.IMREAD_COLOR) -> Any:
    """A picture; None: it cannot be read."""
    return cv2.imread(str(path), mode)


def _box_of(mask: Bool) -> Float | None:
    """The box around what is marked [px], shape (4,); None: nothing is."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float64)


def _cutout(image: Any, mask: Bool) -> Cutout | None:
    """The person who is marked; None: they are too small."""
    box = _box_of(mask)
    if box is None or mask.sum() < _LEAST_OUTLINE:
        return None
    left, top, right, bottom = box.astype(int)
    grey: Any = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[top:bottom, left:right]
    opaque: Any = 255 * mask[top:bottom, left:right].astype(np.uint8)
    if (scale := TALL / len(grey)) < 1.0:
        size = max(round(grey.shape[1] * scale), 1), TALL
        grey, opaque = (
            cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in (grey, opaque)
        )
    label = np.where(opaque > 127, PERSON, np.where(opaque > 50, UNKNOWN, OTHER))
    whole = len(standing(box[np.newaxis], len(mask))) > 0
    return Cutout(grey, opaque, label.astype(np.uint8), (0.0, 1.0) if whole else None)


def fashion(folder: Path) -> Iterator[tuple[Picture, Cutout | None]]:
    """Of `FASHION`; whoever is beside the one who is outlined is not marked."""
    root = sources.FASHION.within(folder)
    for path in sorted((root / "annotations/pixel-level").glob("*.mat")):
        image = _read(root / "photos" / f"{path.stem}.jpg")
        mask = scipy.io.loadmat(str(path))["groundtruth"] > 0
        rows, columns = np.minimum(image.shape[:2], mask.shape)
        image, mask = image[:rows, :columns], mask[:rows, :columns]
        if (box := _box_of(mask)) is None:
            continue
        label = mask.astype(np.uint8)
        beside = np.ones(mask.shape, dtype=bool)
        half = int((box[2] - box[0]) / 2)
        beside[:, max(int(box[0]) - half, 0) : int(box[2]) + half] = False
        label[beside & ~mask] = UNKNOWN
        grey, boxes, label_ = reduced(image, box, label)
        yield Picture(grey, label_, boxes, standing(boxes, len(grey))), _cutout(image, mask)


def outlines(folder: Path) -> Iterator[tuple[Picture, list[Cutout]]]:
    """Of `OUTLINES` and `PENN_FUDAN`."""
    root = sources.OUTLINES.within(folder)
    for path in sorted((root / "Ground_Truth").glob("*.png")):
        images = sorted((root / "Training_Images").glob(f"{path.stem}.*"))
        if not images:
            continue
        image, mask = _read(images[0]), _read(path, cv2.IMREAD_GRAYSCALE)
        mask = cv2.resize(mask, (image.shape[1], image.shape[0])) > 127
        if (box := _box_of(mask)) is not None:
            grey, boxes, label = reduced(image, box, mask.astype(np.uint8))
            yield Picture(grey, label, boxes), []
    root = sources.PENN_FUDAN.within(folder) / "data/PennFudanPed"
    for path in sorted((root / "PedMasks").glob("*.png")):
        number = _read(path, cv2.IMREAD_UNCHANGED)
        image = _read(root / "PNGImages" / path.name.replace("_mask", ""))
        masks = [number == k for k in range(1, number.max() + 1)]
        found = [box for mask in masks if (box := _box_of(mask)) is not None]
        grey, boxes, label = reduced(image, np.array(found), (number > 0).astype(np.uint8))
        cutouts = [_cutout(image, mask) for mask in masks]
        places = standing(boxes, len(grey))
        yield Picture(grey, label, boxes, places), [one for one in cutouts if one is not None]


def meetings(folder: Path) -> Iterator[Picture]:
    """Halves of every third panorama of `MEETINGS` and `GESTURES`: neighbours are alike."""
    for source in (sources.MEETINGS, sources.GESTURES):
        root = source.within(folder)
        for path in sorted((root / "Annotations").glob("*.xml"))[::3]:
            image = _read(root / "JPEGImages" / f"{path.stem}.jpg")
            if image is None:
                continue
            sides = [
                [float(one.findtext(f"bndbox/{side}", "nan")) for side in _SIDES]
                for one in ElementTree.parse(path).iter("object")
                if one.findtext("name") == "person"
            ]
            boxes = np.array(sides).reshape(-1, 4)
            half = image.shape[1] // 2
            for left in (0, half):
                mine = boxes - [left, 0, left, 0]
                mine = mine[(mine[:, 2] > 0) & (mine[:, 0] < half)]
                yield _with_boxes(image[:, left : left + half], mine)


def watched(folder: Path) -> Iterator[Picture]:
    """Of `WATCHED`, those with people."""
    root = sources.WATCHED.within(folder) / "Assets/dataset"
    for path in sorted(root.glob("*/labels/*.txt")):
        image = _read(path.parents[1] / "images" / f"{path.stem}.jpg")
        rows = [[float(v) for v in line.split()[:5]] for line in path.read_text().splitlines()]
        boxes = np.array([row for row in rows if len(row) == 5 and row[0] == 0.0])
        if image is None or not len(boxes):
            continue
        middle, half = boxes[:, 1:3], 0.5 * boxes[:, 3:]
        corners = np.hstack([middle - half, middle + half])
        yield _with_boxes(image, corners * [*image.shape[1::-1], *image.shape[1::-1]])


def taught(folder: Path) -> Iterator[Picture]:
    """Every second picture of `ROOMS`, where the teacher is sure of people, or of nobody."""
    teacher = Teacher(folder)
    for path in sorted((sources.ROOMS.within(folder) / "dataset/train").glob("*/*.jpg"))[::2]:
        image = _read(path)
        boxes, score = teacher(image)
        best = score.max(initial=0.0)
        if best < _NOBODY:
            yield Picture(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), None, _NO_BOXES)
        elif best > _SURE:
            sure = score > _SURE
            yield _with_boxes(image, boxes[sure], boxes[~sure & (score > _PERHAPS)])


def _with_boxes(image: Any, people: Float, unknown: Float = _NO_BOXES) -> Picture:
    """A picture with boxes around people, and around what nobody knows."""
    grey, boxes, _ = reduced(image, np.vstack([people, unknown]))
    people, unknown = boxes[: len(people)], boxes[len(people) :]
    tall = people[:, 3] - people[:, 1] > _LEAST_BOX
    label, places = label_of(grey.shape, people, unknown), standing(people[tall], len(grey))
    return Picture(grey, label, people[tall], places)


def windows(folder: Path) -> Iterator[Cutout]:
    """Of `INRIA`, without their mirror images: whole windows with the person in the middle."""
    root = sources.INRIA.within(folder) / "INRIAPerson/96X160H96/Train/pos"
    person = np.array([[28.0, 32.0, 68.0, 128.0]])
    for path in sorted(root.glob("*.png"))[::2]:
        grey = _read(path, cv2.IMREAD_GRAYSCALE)
        label = label_of(grey.shape, person, _NO_BOXES)
        body = person[0, 1] / len(grey), person[0, 3] / len(grey)
        yield Cutout(grey, np.full(grey.shape, 255, np.uint8), label, body)
