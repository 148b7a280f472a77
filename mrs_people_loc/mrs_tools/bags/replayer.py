"""Publishes the messages of a bag over ROS, in their timing.

    with Replayer("bags/paper_formation", clock=True) as player:
        player.wait_for_subscribers()
        player.play(on_progress=print)

A `stop` event (set by another thread, or by `mrs_tools.signals.stop_on_signals`) ends it.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, NamedTuple

from rosbags.interfaces import QosDurability

from mrs_people_loc.errors import BagError
from mrs_ros.closing import Closing
from mrs_ros.network import node_of
from mrs_tools.bags.reader import BagReader, Topic
from mrs_tools.tool_node import NO_NAME, message_class, node, wait_for_discovery

if TYPE_CHECKING:
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

# /clock ticks every 10 ms of bag time, but never more rarely than every 10 ms of real time.
_CLOCK_STEP_NS = 10_000_000
# /clock runs from this long before the first message until this long after the last [bag time],
# so that nodes have a time when the data begin and their timers fire when the data end.
_CLOCK_MARGIN_NS = 200_000_000
# Stamps farther than this from now are called old.
_OLD_S = 10.0
# How long the number of subscribers must stay the same to be taken for complete.
_SETTLED_S = 1.0
# How long messages under way may take to arrive, after the last one was published.
_FLUSH_S = 2.0
_PROGRESS_EVERY_NS = 100_000_000
# While the bag plays, others are looked for every so often.
_LOOK_AGAIN_S = 0.5
# What publishes is known a moment before its node's name is.
_NAMES_S = 0.3
# Many publish these, each of them frames of its own.
_SHARED = ("/tf", "/tf_static")
# Messages kept for subscribers that are slow or, for transient-local topics, late.
_DEPTH = 100


class Progress(NamedTuple):
    """Where a replay is."""

    position_s: float
    """Seconds of bag time since the first message; negative before it."""
    duration_s: float
    """Seconds from the first message to the last."""
    published: int
    """Messages published so far, in all rounds."""


class Replayed(NamedTuple):
    """What a replay did."""

    counts: dict[str, int]
    """Messages published, by topic."""
    rounds: int
    """How often the bag was played to its end."""
    latest_s: float
    """By how many seconds the latest message missed its time: what the machine was behind."""


class Replayer(Closing):
    """A bag and a publisher for each of its topics.

    A topic that somebody else on the network publishes is left out, also where that begins while
    the bag plays: two publishers would double every message, and a recording of everything holds
    what the nodes that it is replayed to publish themselves. Not so `/tf` and `/tf_static`.

    Every topic is offered as reliable, which suits reliable and best-effort subscribers alike, and
    as transient local where the bag says that it was. What else the bag says about quality of
    service (deadlines, lifespans) belongs to the recorded drivers and is left out.

    Attributes:
        bag: The open bag.
        skipped: Topics that are not published, and why.
        taken: Those among them that others publish, and the names of their nodes.
    """

    def __init__(
        self,
        bag: str | os.PathLike[str],
        *,
        rate: float = 1.0,
        clock: bool = False,
        topics: Collection[str] = (),
    ) -> None:
        """Open a bag and announce its topics.

        Args:
            bag: The bag.
            rate: Seconds of bag time per second, over 0.
            clock: Publish bag time on `/clock`. A bag that has its own `/clock` publishes that.
            topics: Names or shell patterns of the topics to publish; none: all. A name that
                cannot be published is an error then.

        Raises:
            BagError: The bag cannot be read, has no such topic, or none of its topics, or not one
                that was named, can be published.
            ValueError: The rate is not a positive number.
        """
        from rclpy.qos import QoSProfile
        from rosgraph_msgs.msg import Clock

        if not (rate > 0 and math.isfinite(rate)):
            raise ValueError(f"rate must be a positive number, not {rate}")
        self.rate = rate
        self.skipped: dict[str, str] = {}
        self.taken: dict[str, list[str]] = {}
        self._publishers: dict[str, Publisher] = {}
        self._clock: Publisher | None = None
        self._looked_s = 0.0
        with ExitStack() as stack:
            self.bag = stack.enter_context(BagReader(bag))
            self._node = stack.enter_context(node("mrs_replay"))
            wait_for_discovery(self._node)
            for name in self.bag.select(topics):
                self._announce(self.bag.topics[name], named=name in topics)
            if not self._publishers:
                reasons = "; ".join(f"{t}: {why}" for t, why in self.skipped.items())
                raise BagError(f"{self.bag.path}: no topic can be published. {reasons}")
            if clock and (others := self._others("/clock")):
                self._leave("/clock", others)
            elif clock and "/clock" not in self._publishers:
                self._clock = self._node.create_publisher(Clock, "/clock", QoSProfile(depth=10))
            self._open = stack.pop_all()

    def _announce(self, topic: Topic, named: bool) -> None:
        """Create the publisher of a topic, or note why not."""
        from rclpy.exceptions import InvalidTopicNameException
        from rclpy.validate_full_topic_name import validate_full_topic_name

        cls = message_class(topic.type)
        problem = f"its type {topic.type} is not installed"
        try:
            validate_full_topic_name(topic.name)
        except InvalidTopicNameException:
            cls, problem = None, NO_NAME
        else:
            if others := self._others(topic.name):
                self._leave(topic.name, others)
                cls, problem = None, self.skipped[topic.name]
        if cls is not None:
            publisher = self._node.create_publisher(cls, topic.name, _offered_qos(topic))
            if self._same_definition(topic):
                self._publishers[topic.name] = publisher
                return
            self._node.destroy_publisher(publisher)
            problem = f"{topic.type} is defined otherwise in the bag than here"
        if named:
            raise BagError(f"{self.bag.path}: cannot publish {topic.name}: {problem}")
        self.skipped[topic.name] = problem

    def _leave(self, topic: str, others: list[str]) -> None:
        """Note that a topic is left to others."""
        self.taken[topic] = others
        self.skipped[topic] = f"{listed(others)} publish{'es' if len(others) == 1 else ''} it"

    def _others(self, topic: str) -> list[str]:
        """The nodes of others that publish a topic; none, also where many are meant to."""
        own = int(topic in self._publishers or (topic == "/clock" and self._clock is not None))
        if topic in _SHARED or self._node.count_publishers(topic) <= own:
            return []
        end = time.monotonic() + _NAMES_S
        while True:
            names = {
                node_of(info)
                for info in self._node.get_publishers_info_by_topic(topic)
                if info.node_name != self._node.get_name()
            }
            unknown = any("_UNKNOWN_" in name for name in names)
            if not unknown or time.monotonic() > end:
                break
            time.sleep(0.02)
        return ["another node"] if unknown else sorted(names)

    def _leave_to_others(self, on_left_out: Callable[[list[str], str], None] | None = None) -> None:
        """Publish no more what somebody else publishes, too."""
        now = time.monotonic()
        if now - self._looked_s < _LOOK_AGAIN_S:
            return
        self._looked_s = now
        left = []
        for topic in [*self._publishers, *(["/clock"] if self._clock else [])]:
            others = self._others(topic)
            if not others:
                continue
            self._leave(topic, others)
            left.append(topic)
            if topic in self._publishers:
                self._node.destroy_publisher(self._publishers.pop(topic))
            elif self._clock is not None:
                clock, self._clock = self._clock, None
                self._node.destroy_publisher(clock)
        if on_left_out:
            for why, topics in by_reason({t: self.skipped[t] for t in left}).items():
                on_left_out(topics, why)

    def _same_definition(self, topic: Topic) -> bool:
        """Whether subscribers here will read the bytes as they were written.

        The bytes are published as they are: with another definition they would be misread.
        """
        recorded = self.bag.type_hash(topic.type)
        here = {
            str(info.topic_type_hash)
            for info in self._node.get_publishers_info_by_topic(topic.name)
            if info.node_name == self._node.get_name()
        }
        return recorded is None or here <= {recorded, "INVALID"}

    @property
    def is_old(self) -> bool:
        """Whether the bag's time is far from now and nothing publishes it on `/clock`.

        Nodes would then take every message for hopelessly late.
        """
        if self._clock or "/clock" in self._publishers:
            return False
        return abs(time.time() - self.bag.start_ns * 1e-9) > _OLD_S

    def wait_for_subscribers(
        self, timeout_s: float = 5.0, stop: threading.Event | None = None
    ) -> dict[str, int]:
        """Give subscribers time to be discovered, so that they get the first messages.

        Returns once there is a subscriber and their number has been the same for a second, or when
        the time is up. Topics that somebody else turns out to publish are left out.

        Args:
            timeout_s: The longest to wait, seconds.
            stop: When set, returns at once.

        Returns:
            Number of subscribers of each topic.
        """
        stop = stop or threading.Event()
        now = time.monotonic()
        end, changed, before = now + timeout_s, now, dict[str, int]()
        while True:
            self._leave_to_others()
            matched = {t: p.get_subscription_count() for t, p in self._publishers.items()}
            now = time.monotonic()
            if matched != before:
                before, changed = matched, now
            settled = now - changed >= _SETTLED_S and any(matched.values())
            if (settled and not self.mismatched()) or now >= end or stop.wait(0.05):
                return matched

    def mismatched(self) -> list[str]:
        """Topics with a subscriber that cannot be served: it asks for another quality of service.

        For example one that asks for transient local on a topic that was not recorded as such.
        """
        return [
            t
            for t, p in self._publishers.items()
            if self._node.count_subscribers(t) > p.get_subscription_count()
        ]

    def play(
        self,
        *,
        loop: bool = False,
        stop: threading.Event | None = None,
        on_progress: Callable[[Progress], None] | None = None,
        on_left_out: Callable[[list[str], str], None] | None = None,
    ) -> Replayed:
        """Publish the messages, each at its time; blocks.

        The schedule is absolute, so waiting never adds up to a drift. A message whose time has
        passed is published at once; none is left out.

        Args:
            loop: Begin again at the end, until stopped. Stamps stay as they are and `/clock` jumps
                back.
            stop: When set (from another thread or a signal handler), ends within 0.1 s.
            on_progress: Called about ten times a second.
            on_left_out: Called with topics that are left out from now on, and why.

        Returns:
            What was published.

        Raises:
            BagError: The bag turns out to be truncated or damaged.
        """
        stop = stop or threading.Event()
        counts = dict.fromkeys(self._publishers, 0)
        rounds, latest_ns = 0, 0

        def report(now_ns: int) -> None:
            self._leave_to_others(on_left_out)
            if on_progress:
                position_s = (min(now_ns, self.bag.end_ns) - self.bag.start_ns) * 1e-9
                on_progress(Progress(position_s, self.bag.duration_s, sum(counts.values())))

        while not stop.is_set():
            margin_ns = _CLOCK_MARGIN_NS if self._clock else 0
            pace = _Pace(self.bag.start_ns - margin_ns, self.rate, stop, report)
            self._play_once(pace, margin_ns, counts)
            latest_ns = max(latest_ns, pace.latest_ns)
            rounds += not stop.is_set()
            if not loop:
                break
        if not stop.is_set():
            self._flush()
            report(self.bag.end_ns)
        return Replayed(counts, rounds, latest_ns * 1e-9)

    def _play_once(self, pace: _Pace, margin_ns: int, counts: dict[str, int]) -> None:
        """Publish every message and, between them, the clock."""
        tick_ns = self.bag.start_ns - margin_ns
        for message in self.bag.messages(counts):
            tick_ns = self._run_clock(pace, tick_ns, message.time_ns)
            if not pace.wait_until(message.time_ns):
                return
            publisher = self._publishers.get(message.topic)
            if publisher is not None:
                publisher.publish(message.data)
                counts[message.topic] += 1
        self._run_clock(pace, tick_ns, self.bag.end_ns + margin_ns)

    def _run_clock(self, pace: _Pace, tick_ns: int, until_ns: int) -> int:
        """Publish the ticks that are due until a bag time; return the next one."""
        if self._clock is None:
            return tick_ns
        from builtin_interfaces.msg import Time
        from rosgraph_msgs.msg import Clock

        step_ns = max(1, int(_CLOCK_STEP_NS * min(1.0, self.rate)))
        while tick_ns <= until_ns and pace.wait_until(tick_ns):
            if self._clock is None:  # somebody else publishes it now
                return tick_ns
            sec, nanosec = divmod(tick_ns, 10**9)
            self._clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
            # Ticks that are overdue are left out, but the clock never overtakes the messages.
            overdue = (min(pace.now_ns(), until_ns) - tick_ns) // step_ns
            tick_ns += step_ns * max(1, overdue)
        return tick_ns

    def _flush(self) -> None:
        """Wait until the last messages have arrived, within bounds."""
        from rclpy.duration import Duration

        end = time.monotonic() + _FLUSH_S
        for publisher in self._publishers.values():
            left = max(0.0, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))
        time.sleep(0.1)  # best-effort subscribers acknowledge nothing

    def close(self) -> None:
        """Take the topics back and close the bag."""
        self._open.close()


class _Pace:
    """Maps bag time to real time, and waits.

    Attributes:
        latest_ns: By how much the latest call came too late.
    """

    def __init__(
        self,
        first_ns: int,
        rate: float,
        stop: threading.Event,
        report: Callable[[int], None],
    ) -> None:
        """Start at bag time `first_ns`, now."""
        self.latest_ns = 0
        self._first_ns, self._rate, self._stop, self._report = first_ns, rate, stop, report
        self._started_ns = self._reported_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """The bag time that it is now."""
        return self._first_ns + int((time.monotonic_ns() - self._started_ns) * self._rate)

    def wait_until(self, bag_ns: int) -> bool:
        """Wait for a bag time; False if stopped before."""
        due_ns = self._started_ns + int((bag_ns - self._first_ns) / self._rate)
        while not self._stop.is_set():
            now_ns = time.monotonic_ns()
            if now_ns - self._reported_ns >= _PROGRESS_EVERY_NS:
                self._reported_ns = now_ns
                self._report(min(self.now_ns(), bag_ns))
            if now_ns >= due_ns:
                self.latest_ns = max(self.latest_ns, now_ns - due_ns)
                return True
            self._stop.wait(min(due_ns - now_ns, _PROGRESS_EVERY_NS) * 1e-9)
        return False


def by_reason(skipped: Mapping[str, str]) -> dict[str, list[str]]:
    """Topics that are left out, by why: each reason once."""
    topics: dict[str, list[str]] = {}
    for topic, why in skipped.items():
        topics.setdefault(why, []).append(topic)
    return topics


def listed(names: Sequence[str]) -> str:
    """Names with commas, and "and" before the last."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _offered_qos(topic: Topic) -> QoSProfile:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    latched = any(q.durability == QosDurability.TRANSIENT_LOCAL for q in topic.qos)
    return QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
