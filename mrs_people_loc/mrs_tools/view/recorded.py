"""The messages of a bag for `playback`: those of any moment at once, in little memory."""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from mrs_people_loc import messages
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.head import Head
from mrs_people_loc.sensing.camera import CameraModel
from mrs_tools.bags.message_types import PEOPLE_TYPE, STATUS_TYPE
from mrs_tools.bags.reader import BagReader, RawMessage
from mrs_tools.bags.truth import TRUTH_TOPIC
from mrs_tools.plain import plain
from mrs_tools.view import protocol
from mrs_tools.view.moment import Found, MapCells, Moment, seconds
from mrs_tools.view.pictures import body_boxes, in_colours, jpeg, with_boxes
from mrs_tools.view.state import HeadView

#: What a message tells a moment, at a bag time [ns].
Told: TypeAlias = Callable[[Moment, int], None]

_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_POINTS = "sensor_msgs/msg/PointCloud2"
#: Topic of the fused cells, and NumPy's types of its fields by PointField's numbers.
_CELLS, _FIELD_TYPES = "short_term_map", {5: "<i4", 6: "<u4", 7: "<f4"}
#: What is read at once, and how many such parts are kept: of what moments show, of images.
_PART_NS, _PARTS = 1_000_000_000, 30
_IMAGES_NS, _IMAGE_PARTS = 250_000_000, 4
#: An image is shown for so long [ns].
_OLD_IMAGE_NS = 2_000_000_000
#: Events that are known at most, the first ones.
_MAX_EVENTS = 20_000

_T = TypeVar("_T")


class _Parts(Generic[_T]):
    """Messages of some topics, read in parts of equal duration, the last ones kept.

    Args:
        bag: The bag.
        topics: The topics.
        length_ns: Duration of a part [ns].
        kept: How many parts are kept.
        read: Makes something of a message; None: it is left out.
    """

    def __init__(
        self,
        bag: BagReader,
        topics: Sequence[str],
        length_ns: int,
        kept: int,
        read: Callable[[RawMessage], _T | None],
    ) -> None:
        self._bag, self._topics, self._length_ns, self._read = bag, topics, length_ns, read
        self._part = functools.lru_cache(kept)(self._read_part)

    def between(self, after_ns: int, until_ns: int) -> Iterator[tuple[int, _T]]:
        """Bag time [ns] and what was made, of messages after a bag time and until another one.

        Raises:
            BagError: The bag is damaged there.
        """
        for number in range((after_ns + 1) // self._length_ns, until_ns // self._length_ns + 1):
            for time_ns, made in self._part(number):
                if after_ns < time_ns <= until_ns:
                    yield time_ns, made

    def _read_part(self, number: int) -> list[tuple[int, _T]]:
        if not self._topics:
            return []
        start_ns = number * self._length_ns
        raw = self._bag.messages(self._topics, start_ns, start_ns + self._length_ns)
        return [(one.time_ns, made) for one in raw if (made := self._read(one)) is not None]


# ------------------------------------------------------------------------ people, robots, tours


class Recorded:
    """What a bag says of people, robots and tours.

    Args:
        bag: The bag, open. Nobody else may read it meanwhile.
        with_people: Whether people, cells and events that were recorded are told, too.

    Attributes:
        people_topic: Where a planner's people are in it; None: nowhere, or they are not told.
        unused: How many messages could not be used, by topic and reason.
    """

    def __init__(self, bag: BagReader, *, with_people: bool = True) -> None:
        self.unused: Counter[str] = Counter()
        self.people_topic = people_topic(bag) if with_people else None
        self._bag = bag
        self._readers = dict(self._find_readers())
        self._parts = _Parts(bag, list(self._readers), _PART_NS, _PARTS, self._told)

    def between(self, after_ns: int, until_ns: int) -> Iterator[tuple[int, Told]]:
        """Bag time [ns] and what was told, after a bag time and until another one.

        Raises:
            BagError: The bag is damaged there.
        """
        return self._parts.between(after_ns, until_ns)

    def first_people_ns(self) -> int | None:
        """Bag time of the first people [ns]; None: there are none.

        Raises:
            BagError: The bag is damaged.
        """
        if self.people_topic is None:
            return None
        return next((raw.time_ns for raw in self._bag.messages([self.people_topic])), None)

    def events(self) -> list[tuple[int, str]]:
        """Bag time [ns] and sentence of each event.

        Raises:
            BagError: The bag is damaged.
        """
        topics = [
            name
            for name, topic in self._bag.topics.items()
            if name.endswith("/events") and topic.type == "std_msgs/msg/String"
        ]
        decoded = self._bag.decoded(topics) if topics else iter(())
        return [(ns, plain(str(one.data))) for _, ns, one in islice(decoded, _MAX_EVENTS)]

    def _find_readers(self) -> Iterator[tuple[str, Callable[[Any], Told]]]:
        """By topic, what reads its messages."""
        for name, topic in self._bag.topics.items():
            space, _, last = name.strip("/").rpartition("/")
            if name == self.people_topic:
                yield name, _read_people
            elif topic.type == STATUS_TYPE:
                yield name, _as_it_is(Moment.take_status)
            elif topic.type == "diagnostic_msgs/msg/DiagnosticArray":
                yield name, _as_it_is(Moment.take_diagnostics)
            elif name == TRUTH_TOPIC and topic.type == "geometry_msgs/msg/PoseArray":
                yield name, _read_truth
            elif last == "pose" and space and topic.type == _POSE:
                yield name, functools.partial(_read_pose, space)
            elif last == _CELLS and topic.type == _POINTS and self.people_topic is not None:
                yield name, _read_cells

    def _told(self, raw: RawMessage) -> Told | None:
        try:
            return self._readers[raw.topic](self._bag.decode(raw))
        except (PeopleLocError, ValueError) as err:
            self.unused[f"{raw.topic}: {err}"] += 1
            return None


def people_topic(bag: BagReader) -> str | None:
    """The topic with a planner's people, whatever its name; of several, the one with most."""
    topics = [topic for topic in bag.topics.values() if topic.type == PEOPLE_TYPE and topic.count]
    return max(topics, key=lambda topic: topic.count).name if topics else None


def _as_it_is(take: Callable[[Moment, int, Any], None]) -> Callable[[Any], Told]:
    return lambda message: lambda moment, time_ns: take(moment, time_ns, message)


def read_found(message: Any, cells: MapCells | None = None) -> Found:
    """The people of a mrs_people_msgs/People, and where its robots were.

    Args:
        message: The message.
        cells: The cells that it was made from, if they are known already.

    Raises:
        PeopleLocError: A value cannot be used.
    """
    persons, groups = messages.read_people(message, message.header.frame_id.lstrip("/"))
    poses = messages.read_people_scans(message)
    return Found(messages.read_stamp(message), persons, groups, poses, cells)


def _read_people(message: Any) -> Told:
    found = read_found(message)
    return lambda moment, time_ns: moment.take_people(time_ns, found)


def _read_pose(robot: str, message: Any) -> Told:
    messages.read_pose(message)  # what cannot be used is refused here
    return lambda moment, time_ns: moment.take_pose(time_ns, robot, message)


def _read_truth(message: Any) -> Told:
    places = np.array([(one.position.x, one.position.y) for one in message.poses], np.float64)
    places = places.reshape(-1, 2)
    there = places[np.isfinite(places).all(axis=1)]
    return lambda moment, time_ns: moment.take_truth(time_ns, there)


def read_map_cells(message: Any) -> MapCells:
    """The cells of a `short_term_map`.

    Raises:
        ValueError: It has other fields than ours, or is damaged.
    """
    fields = {field.name: field for field in message.fields}
    missing = {"x", "y", "robot"} - fields.keys()
    if missing or any(one.datatype not in _FIELD_TYPES for one in fields.values()):
        raise ValueError("its fields are not those of our fused cells")
    layout = np.dtype(
        {
            "names": list(fields),
            "formats": [_FIELD_TYPES[one.datatype] for one in fields.values()],
            "offsets": [one.offset for one in fields.values()],
            "itemsize": message.point_step,
        }
    )
    records = np.frombuffer(message.data, layout)
    xy = np.stack([records["x"], records["y"]], axis=1).astype(np.float64)
    finite = np.isfinite(xy).all(axis=1)
    return MapCells(xy[finite], records["robot"][finite].astype(np.intp))


def _read_cells(message: Any) -> Told:
    cells = read_map_cells(message)
    return lambda moment, time_ns: moment.take_cells(time_ns, cells)


# ----------------------------------------------------------------------------------------- heads


class RecordedHead:
    """The images of a robot in a bag, and what its pipeline finds in them.

    Args:
        bag: The bag, open. Nobody else may read it meanwhile.
        robot: The robot's name.
        config: Its configuration.

    Attributes:
        view: What it sees, from above; None: not known.

    Raises:
        BagError: The bag is damaged.
        CameraError: The calibration cannot be used.
    """

    def __init__(self, bag: BagReader, robot: str, config: RobotConfig) -> None:
        images = dataclasses.replace(config.images, top=False)
        self._bag, self._robot = bag, robot
        self._config = dataclasses.replace(config, images=images)
        kind = "image_rect" if images.rectified else "image_raw"
        self._topics = {f"/{robot}/{camera}/{kind}": camera for camera in ("left", "right")}
        self._parts = _Parts(bag, self._there(), _IMAGES_NS, _IMAGE_PARTS, lambda raw: raw)
        self._head = Head(robot, self._config)
        self._model: CameraModel | None = None
        self.view: HeadView | None = None
        for camera in self._topics.values():
            info = f"/{robot}/{camera}/camera_info"
            first = next(bag.decoded([info]), None) if info in bag.topics else None
            if first is not None:
                self._head.take_camera_info(camera, first[2])
                if camera == "left":
                    self._take_left(messages.read_camera_info(first[2]))

    def _take_left(self, model: CameraModel) -> None:
        config = self._config
        output = model.scaled_to_fit(config.images.working_width, config.images.working_height)
        searched = config.bodies if config.bodies.search else config.disparity
        self._model = output
        self.view = HeadView.of(output, searched.max_range, config.mounting.yaw)

    def image(self, now_ns: int, shown_ns: int | None) -> tuple[int, protocol.Image] | None:
        """The robot's view at a bag time.

        Args:
            now_ns: Bag time [ns].
            shown_ns: Bag time of the left image that is shown [ns]; None: none is.

        Returns:
            Bag time of the left image [ns], and the view; None: that is shown already.

        Raises:
            BagError: The bag is damaged there.
        """
        recent = list(self._parts.between(now_ns - _OLD_IMAGE_NS, now_ns))
        lefts, rights = (
            [(ns, raw) for ns, raw in recent if self._topics[raw.topic] == camera][-2:]
            for camera in ("left", "right")
        )
        if not lefts:
            why = "no image at this time" if self._there() else "the bag has no images of it"
            return None if shown_ns == 0 else (0, no_image(self._robot, why))
        for time_ns, left in reversed(lefts):
            for _, right in reversed(rights):
                if time_ns == shown_ns:
                    return None
                made = self._made(left, right, now_ns)
                if made is not None:
                    return time_ns, made
        return None

    def _there(self) -> list[str]:
        return [topic for topic in self._topics if topic in self._bag.topics]

    def _made(self, left: RawMessage, right: RawMessage, now_ns: int) -> protocol.Image | None:
        """The view of two images; None: they are no pair."""
        self._head.reset()
        try:
            self._head.take_image("left", self._bag.decode(left))
            view = self._head.take_image("right", self._bag.decode(right))
        except PeopleLocError as err:
            return no_image(self._robot, str(err))
        if view is None:
            return None
        assert self._model is not None
        boxes = body_boxes(view.stages.scan.cells, self._model, self._config.mounting)
        camera, reach = self._head.pipeline.camera, self._config.disparity
        low, high = (camera.disparity_of(depth) for depth in (reach.max_range, reach.min_range))
        return protocol.Image(
            type="image",
            robot=self._robot,
            t=seconds(left.time_ns),
            age=round((now_ns - left.time_ns) / 1e9, 3),
            image=jpeg(with_boxes(view.images.left, boxes)),
            disparity=jpeg(in_colours(view.stages.disparity, low, high)),
            note="",
        )


def no_image(robot: str, why: str) -> protocol.Image:
    """What is shown of a robot that has no image, and why it has none."""
    return protocol.Image(
        type="image", robot=robot, t=None, age=None, image=None, disparity=None, note=why
    )
