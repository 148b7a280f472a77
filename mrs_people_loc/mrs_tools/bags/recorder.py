"""Records ROS topics into a bag.

    with Recorder("out.mcap", ["/robot_a/*"]) as recorder:
        recorder.run(duration_s=10.0)

A `stop` event (set by another thread, or by `mrs_tools.signals.stop_on_signals`) ends it.
"""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NamedTuple

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from mrs_people_loc.errors import BagError
from mrs_people_loc.messages import stamp_ns_of
from mrs_ros.closing import Closing
from mrs_tools.bags.message_types import default_typestore, require_types
from mrs_tools.bags.reader import matching
from mrs_tools.bags.writer import BagWriter
from mrs_tools.tool_node import NO_NAME, message_class, node

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

# How often the messages that have arrived are taken, how often new topics are looked for, and how
# often all is handed to the system: so much is lost of a recorder that is killed.
_TAKE_EVERY_S = 0.005
_LOOK_EVERY_S = 0.2
_FLUSH_EVERY_S = 1.0
# Topics of these types are large. Unless told otherwise only those are recorded that the nodes take
# in (by name, or because they do), and the scans and the map that they give out.
_LARGE = {
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/PointCloud2",
    "stereo_msgs/msg/DisparityImage",
    "theora_image_transport/msg/Packet",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
}
_IMAGES = re.compile(r".*/(left|right|top)/image_(rect|raw)")
_OUR_NODES = {"robot_node", "planner_node", "guide_node"}
# Recorded only if asked for: a node that gets an old event of its own name, as happens in a replay,
# takes it for its own use_sim_time.
_PARAMETER_EVENTS = "/parameter_events"
# Messages of one topic that may arrive in between.
_DEPTH = 500


class Status(NamedTuple):
    """Where a recording is."""

    elapsed_s: float
    topics: int
    messages: int
    size_bytes: int
    sizes: dict[str, int]
    """By topic [bytes]."""


class Recorder(Closing):
    """A bag that is being recorded.

    Subscribes to what the publishers of each topic offer: reliable if all of them are, transient
    local if all of them are. Topics and publishers that come later are taken in. Messages are
    written as the bytes that arrive (DDS may have added up to three bytes of padding at the end);
    their bag time is when they arrived.

    Attributes:
        counts: Number of messages written so far, by topic.
        sizes: Their bytes, by topic.
        skipped: Topics that cannot be recorded, and why.
        left_out: Topics that nobody asked for and that reproduce nothing: images and clouds that
            no node takes in.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        topics: Collection[str] = (),
        *,
        simulated: bool = False,
    ) -> None:
        """Begin a bag and join ROS.

        Args:
            path: `NAME.mcap` for one file, any other name for a folder with `metadata.yaml`.
            topics: Names or shell patterns such as `/robot_a/*`; none: every visible topic but
                `/parameter_events` and what is `left_out`.
            simulated: Bag times are those of `/clock`, and nothing is recorded before it comes.

        Raises:
            BagError: The bag exists already or cannot be written, or a name or pattern fits none
                that a topic can have.
        """
        self.patterns = tuple(topics)
        for pattern in self.patterns:
            if not _may_exist(pattern):
                raise BagError(f"{pattern!r} fits no topic: it is {NO_NAME}; and * ? [abc]")
        self._clock: Subscription | None = None
        self._clock_ns = 0
        self.sizes: dict[str, int] = {}
        self.skipped: dict[str, str] = {}
        self.left_out: set[str] = set()
        self._subscriptions: dict[str, Subscription] = {}
        self._fits: dict[str, _Fit] = {}
        self._bag = BagWriter(path)
        self._open = ExitStack()
        try:
            self._node = self._open.enter_context(node("mrs_record"))
        except BaseException:
            self._bag.abort()
            raise
        if simulated:
            self._follow_clock()

    def _follow_clock(self) -> None:
        from rclpy.qos import qos_profile_sensor_data
        from rosgraph_msgs.msg import Clock

        self._clock = self._node.create_subscription(
            Clock, "/clock", lambda _: None, qos_profile_sensor_data
        )

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages written so far, by topic."""
        return self._bag.counts

    def run(
        self,
        *,
        duration_s: float | None = None,
        stop: threading.Event | None = None,
        on_status: Callable[[Status], None] | None = None,
    ) -> None:
        """Record; blocks.

        Args:
            duration_s: For so long, seconds; None: until stopped.
            stop: When set (from another thread or a signal handler), ends at once.
            on_status: Called about five times a second.

        Raises:
            BagError: The disk does not take it.
        """
        stop = stop or threading.Event()
        started = time.monotonic()
        end = started + duration_s if duration_s is not None else float("inf")
        look = flush = started
        while (now := time.monotonic()) < end and not stop.is_set():
            if now >= look:
                look = now + _LOOK_EVERY_S
                self._look_for_topics()
                if on_status:
                    on_status(self._status(now - started))
            if now >= flush:
                flush = now + _FLUSH_EVERY_S
                self._bag.flush()
            self._take()
            stop.wait(min(_TAKE_EVERY_S, end - now))
        self._take()

    def silent(self) -> list[str]:
        """Patterns that were asked for and that no message came for."""
        heard = [topic for topic, count in self.counts.items() if count]
        return [p for p in self.patterns if not matching(heard, [p])]

    def _status(self, elapsed_s: float) -> Status:
        messages, size_bytes = sum(self.counts.values()), sum(self.sizes.values())
        return Status(elapsed_s, len(self._subscriptions), messages, size_bytes, self.sizes)

    def _look_for_topics(self) -> None:
        """Subscribe to what is new, and again where a subscription no longer fits."""
        from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

        types = dict(self._node.get_topic_names_and_types())
        for name in matching(types, self.patterns):
            unasked = not self.patterns
            if unasked and (topic_or_service_is_hidden(name) or name == _PARAMETER_EVENTS):
                continue
            if name in self.skipped:
                continue
            offers = self._node.get_publishers_info_by_topic(name)
            if unasked and offers and not self._is_needed(name, types):
                self.left_out.add(name)
            elif offers:
                self.left_out.discard(name)
                self._subscribe(name, offers)

    def _is_needed(self, name: str, types: Mapping[str, list[str]]) -> bool:
        """Whether a topic is small, is taken in by nodes, or is a scan or the map of cells."""
        if name in self._subscriptions or _LARGE.isdisjoint(types[name]):
            return True
        if _IMAGES.fullmatch(name):
            return True
        namespace, _, last = name.rpartition("/")
        # As the planner knows a robot: cameras have points, too.
        is_robot = "geometry_msgs/msg/PoseWithCovarianceStamped" in types.get(
            f"{namespace}/pose", []
        )
        if last == "short_term_map" or (last == "points" and is_robot):
            return True
        takers = self._node.get_subscriptions_info_by_topic(name)
        return any(taker.node_name in _OUR_NODES for taker in takers)

    def _subscribe(self, name: str, offers: list[TopicEndpointInfo]) -> None:
        """Subscribe to a topic if that is new, or if a publisher came that offers less."""
        fit = _Fit.of(offers)
        msgtype = offers[0].topic_type
        if name in self._subscriptions:
            known, subscription = self._fits[name], self._subscriptions[name]
            fit = _Fit(known.reliable and fit.reliable, known.latched and fit.latched)
            if fit == known:
                return
            self._take()
            self._node.destroy_subscription(subscription)
        else:
            problem = _problem(offers)
            if problem:
                self.skipped[name] = problem
                return
            self._bag.add_topic(name, msgtype, [_recorded(o.qos_profile) for o in offers])
            self.sizes[name] = 0
        self._fits[name] = fit
        self._subscriptions[name] = self._node.create_subscription(
            message_class(msgtype), name, lambda _: None, fit.profile(), raw=True
        )

    def _take(self) -> None:
        """Write what has arrived since the last time.

        Takes from the subscriptions directly: an executor needs four times the CPU for that.
        """
        if self._clock is not None and not self._read_clock():
            return
        arrived = [
            (info["received_timestamp"] or time.time_ns(), name, data)
            for name, subscription in self._subscriptions.items()
            for data, info in _taken(subscription, raw=True)
        ]
        self._read_clock()  # after the messages: they do not come before they were sent
        for time_ns, name, data in sorted(arrived, key=lambda message: message[0]):
            self._bag.write_raw(name, self._clock_ns or time_ns, data)
            self.sizes[name] += len(data)

    def _read_clock(self) -> int:
        """The time of `/clock` [ns]; 0: none has come, or it is not wanted."""
        if self._clock is not None:
            for message, _ in _taken(self._clock, raw=False):
                self._clock_ns = stamp_ns_of(message.clock)
        return self._clock_ns

    def close(self) -> None:
        """Write the index; the bag is complete then.

        Raises:
            BagError: No message came (nothing is left behind), or the disk does not take it.
        """
        self._open.close()
        if not any(self.counts.values()):
            self._bag.abort()
            asked = f" on {', '.join(self.patterns)}" if self.patterns else ""
            raise BagError(
                f"{self._bag.path}: not written, no message came{asked}. Are the publishers "
                "running, with the same ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE?"
            )
        self._bag.close()

    def __exit__(self, kind: object, *_: object) -> None:
        """Close the bag; also after an exception what came before it is kept."""
        if kind is None or any(self.counts.values()):
            self.close()
        else:
            self._open.close()
            self._bag.abort()


def _taken(subscription: Subscription, *, raw: bool) -> Iterator[tuple[Any, Any]]:
    """What has arrived on a subscription, and what is known of its arrival."""
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, raw)) is not None:
            yield taken


class _Fit(NamedTuple):
    """What a subscription may ask for so that every publisher of a topic can serve it."""

    reliable: bool
    latched: bool

    @classmethod
    def of(cls, offers: list[TopicEndpointInfo]) -> _Fit:
        from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

        return cls(
            all(o.qos_profile.reliability == ReliabilityPolicy.RELIABLE for o in offers),
            all(o.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers),
        )

    def profile(self) -> QoSProfile:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        return QoSProfile(
            depth=_DEPTH,
            reliability=(
                ReliabilityPolicy.RELIABLE if self.reliable else ReliabilityPolicy.BEST_EFFORT
            ),
            durability=(
                DurabilityPolicy.TRANSIENT_LOCAL if self.latched else DurabilityPolicy.VOLATILE
            ),
        )


def _may_exist(pattern: str) -> bool:
    """Whether a topic can have a name that fits."""
    from rclpy.exceptions import InvalidTopicNameException
    from rclpy.validate_full_topic_name import validate_full_topic_name

    name = re.sub(r"\*|\?|\[[^]]+\]", "a", pattern)
    try:
        validate_full_topic_name(name if name.startswith("/") else f"/{name}")
    except InvalidTopicNameException:
        return False
    return True


def _problem(offers: list[TopicEndpointInfo]) -> str | None:
    """Why a topic cannot be recorded, None if it can."""
    types = sorted({o.topic_type for o in offers})
    if len(types) > 1:
        return f"it has several types: {', '.join(types)}"
    if message_class(types[0]) is None:
        return f"its type {types[0]} is not installed"
    store = default_typestore()
    require_types(store, types)
    published = {str(o.topic_type_hash) for o in offers} - {"INVALID"}
    try:
        here = store.hash_rihs01(types[0])
    except KeyError:  # the library cannot hash wide strings
        return None
    return None if published <= {here} else f"{types[0]} is defined otherwise there than here"


def _recorded(profile: QoSProfile) -> Qos:
    """A publisher's quality of service as bags have it: the numbers mean the same."""

    def time(duration: Any) -> QosTime:
        return QosTime(*divmod(duration.nanoseconds, 10**9))

    return Qos(
        history=QosHistory(int(profile.history)),
        depth=profile.depth,
        reliability=QosReliability(int(profile.reliability)),
        durability=QosDurability(int(profile.durability)),
        deadline=time(profile.deadline),
        lifespan=time(profile.lifespan),
        liveliness=QosLiveliness(int(profile.liveliness)),
        liveliness_lease_duration=time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )
