"""`mrs replay` and `mrs record` over real DDS: the bytes that were recorded are those that arrive.

The commands run as processes of their own, as a person starts them.
"""

import contextlib
import itertools
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import CompressedImage, Image, PointCloud2  # noqa: E402
from std_msgs.msg import Int32, String  # noqa: E402
from stereo_msgs.msg import DisparityImage  # noqa: E402
from typer.testing import CliRunner  # noqa: E402

from mrs_people_loc.errors import BagError  # noqa: E402
from mrs_tools.bags import replayer as replay  # noqa: E402
from mrs_tools.bags.message_types import default_typestore  # noqa: E402
from mrs_tools.bags.reader import BagReader  # noqa: E402
from mrs_tools.bags.recorder import Recorder  # noqa: E402
from mrs_tools.bags.replayer import Progress, Replayer  # noqa: E402
from mrs_tools.bags.writer import BagWriter  # noqa: E402
from mrs_tools.cli import app  # noqa: E402
from mrs_tools.tool_node import message_class, node  # noqa: E402
from ros.harness import own_domain  # noqa: E402

# Of lark, which the ROS wheels load on the way.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

PAPER = Path(__file__).parents[3] / "bags" / "paper_formation"
START_NS = 1_700_000_000_000_000_000
RELIABLE = QoSProfile(depth=1000)
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LIMIT_S = 60.0
#: What a recorder or a replay in another process gets to catch up [s]: nothing shows when it has.
CATCH_UP_S = 2.0


@pytest.fixture(scope="module", autouse=True)
def _own_domain():
    """Runs side by side never hear each other."""
    with own_domain() as number, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(number))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        # No shared memory, which loses messages for a process that gets no time; but for this
        # range rmw_fastrtps adds it all the same.
        patch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
        yield


@contextlib.contextmanager
def mrs(*args):
    """The command as a process; its messages come with both streams in one."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mrs_tools", *map(str, args)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def finish(process, number=None):
    """Exit code and output, after a signal if one is given."""
    if number is not None:
        process.send_signal(number)
    output, _ = process.communicate(timeout=LIMIT_S)
    assert "Traceback" not in output
    return process.returncode, output


def run(*args):
    with mrs(*args) as process:
        return finish(process)


def until(condition, message="it did not happen"):
    end = time.monotonic() + LIMIT_S
    while not (value := condition()):
        assert time.monotonic() < end, message
        time.sleep(0.02)
    return value


@pytest.fixture
def ros():
    """A node, spun in a thread."""
    with node("mrs_test") as made:
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        ending = threading.Event()

        def spin():
            while not ending.is_set():
                executor.spin_once(timeout_sec=0.05)

        thread = threading.Thread(target=spin)
        thread.start()
        yield made
        ending.set()
        thread.join()
        executor.shutdown()


@contextlib.contextmanager
def running(function, **options):
    """A function in a thread that ends when its `stop` is set, as it is here at the end."""
    stop = threading.Event()
    thread = threading.Thread(target=function, kwargs={"stop": stop, **options})
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(LIMIT_S)


def raw_subscription(ros, cls, topic, qos=RELIABLE):
    arrived = []
    ros.create_subscription(cls, topic, arrived.append, qos, raw=True)
    return arrived


def talk_bag(path, texts, step_s=0.1, topic="/talk", qos=()):
    with BagWriter(path) as bag:
        bag.add_topic(topic, "std_msgs/msg/String", qos)
        for k, text in enumerate(texts):
            bag.write_raw(
                topic, START_NS + int(k * step_s * 1e9), serialize_message(String(data=text))
            )
    return path


def messages_of(bag, topic):
    return [m.data for m in bag.messages([topic])]


def assert_same_bytes(got, sent):
    """Equal, but for what DDS adds behind a message on its way: up to three bytes of padding."""
    assert len(got) == len(sent)
    for arrived, message in zip(got, sent, strict=True):
        assert arrived[: len(message)] == message
        assert len(arrived) - len(message) in (0, -len(message) % 4)


def texts_of(arrived):
    return [deserialize_message(data, String).data for data in arrived]


# ----------------------------------------------------------------------------- replay and record


@pytest.mark.slow
def test_recording_equals_the_replayed_bag(tmp_path):
    """Every byte of the starter bag, through two processes."""
    out = tmp_path / "out.mcap"
    with mrs("record", out) as recording, mrs("replay", PAPER, "--rate", 2, "--wait", 50) as source:
        code, reported = finish(source)
        assert code == 0, reported
        assert "published 678 messages on 18 topics" in reported
        assert "--clock" in reported
        assert "use_sim_time:=true" in reported
        time.sleep(CATCH_UP_S)
        code, reported = finish(recording, signal.SIGINT)
    assert code == 0, reported
    assert "678 messages in" in reported
    with BagReader(PAPER) as sent, BagReader(out) as got:
        for topic in sent.topics.values():
            assert got.topics[topic.name].type == topic.type
            assert got.type_hash(topic.type) == sent.type_hash(topic.type)
            assert_same_bytes(messages_of(got, topic.name), messages_of(sent, topic.name))
        assert got.topics.keys() == sent.topics.keys()
        assert abs(got.end_ns * 1e-9 - time.time()) < LIMIT_S
        assert 1.0 < got.duration_s < 30.0
        assert {q.reliability for t in got.topics.values() for q in t.qos} == {
            QosReliability.RELIABLE
        }
    # another reader, and the values
    with AnyReader([out]) as reader:
        connections = [c for c in reader.connections if c.topic == "/robot_b/odom"]
        odometry: list[Any] = [
            reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)
        ]
    positions = [o.pose.pose.position for o in odometry]
    assert [(p.x, p.y) for p in positions] == [(0.2, 2.0)] * 151
    # and round again
    with mrs("record", tmp_path / "again") as recording, Replayer(out, rate=4.0) as player:
        player.wait_for_subscribers(50.0)
        player.play()
        time.sleep(CATCH_UP_S)
        assert finish(recording, signal.SIGTERM)[0] == 0
    with BagReader(out) as sent, BagReader(tmp_path / "again") as got:
        assert_same_bytes(messages_of(got, "/robot_a/odom"), messages_of(sent, "/robot_a/odom"))


# ---------------------------------------------------------------------------------------- replay


@pytest.mark.slow
@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT], ids=["reliable", "best effort"])
def test_reliable_and_best_effort_subscribers_get_everything(ros, qos):
    arrived = raw_subscription(ros, Odometry, "/robot_a/odom", qos)
    others = raw_subscription(ros, Odometry, "/robot_b/odom", qos)
    code, reported = run("replay", PAPER, "-t", "/robot_a/odom,/robot_c/*", "--rate", 2)
    assert code == 0, reported
    assert "published 362 messages on 6 topics" in reported
    until(lambda: len(arrived) == 151)
    with BagReader(PAPER) as bag:
        assert_same_bytes(arrived, messages_of(bag, "/robot_a/odom"))
    assert others == []


@pytest.mark.slow
def test_messages_keep_their_timing(ros, tmp_path):
    """Times of arrival against bag time, with bounds for a loaded machine."""
    bag = talk_bag(tmp_path / "b.mcap", [str(k) for k in range(11)], step_s=0.2)
    arrived = []
    ros.create_subscription(
        String, "/talk", lambda m: arrived.append((m.data, time.monotonic())), RELIABLE
    )
    with Replayer(bag, rate=2.0) as player:
        assert player.wait_for_subscribers() == {"/talk": 1}
        began = time.monotonic()
        done = player.play()
    assert done.counts == {"/talk": 11}
    assert done.rounds == 1
    until(lambda: len(arrived) == 11)
    assert [text for text, _ in arrived] == [str(k) for k in range(11)]
    elapsed = arrived[-1][1] - began
    assert 0.99 < elapsed < 10.0  # 2 s of bag time at twice the speed: 1 s


class FakeTime:
    """Time that passes only while waiting, and a millisecond more each time than was asked for."""

    def __init__(self):
        self.now_ns = 5_000

    def monotonic_ns(self):
        return self.now_ns

    def wait(self, seconds):
        self.now_ns += int(seconds * 1e9) + 1_000_000
        return False

    def is_set(self):
        return False


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_waiting_causes_no_drift(monkeypatch, rate):
    fake = FakeTime()
    monkeypatch.setattr(replay, "time", fake)
    pace = replay._Pace(START_NS, rate, fake, lambda position: None)
    for k in range(1, 2001):
        assert pace.wait_until(START_NS + k * 20_000_000)
        late_ns = fake.now_ns - 5_000 - k * 20_000_000 / rate
        assert 0 <= late_ns <= 1_000_001
    assert 900_000 < pace.latest_ns <= 1_000_001
    fake.now_ns += 3_000_000_000  # a hiccup: what is overdue comes at once
    before = fake.now_ns
    assert pace.wait_until(START_NS + 2001 * 20_000_000)
    assert fake.now_ns == before
    assert pace.latest_ns > 2_000_000_000


@pytest.mark.slow
def test_clock_is_published_with_bag_time(ros, tmp_path):
    bag = talk_bag(tmp_path / "b.mcap", [str(k) for k in range(6)], step_s=0.2)
    seen = []  # clock ticks [ns] and texts in the order of their arrival

    def on_clock(message):
        seen.append(message.clock.sec * 10**9 + message.clock.nanosec)

    ros.create_subscription(Clock, "/clock", on_clock, RELIABLE)
    ros.create_subscription(String, "/talk", lambda m: seen.append(m.data), RELIABLE)
    code, reported = run("replay", bag, "--clock", "--rate", 2)
    assert code == 0, reported
    assert "--clock" not in reported
    end_ns = START_NS + 1_000_000_000
    until(lambda: seen and seen[-1] == end_ns + 200_000_000)
    ticks = [s for s in seen if isinstance(s, int)]
    assert ticks[0] == START_NS - 200_000_000
    assert ticks == sorted(set(ticks))
    steps = sorted(b - a for a, b in itertools.pairwise(ticks))
    assert steps[0] == 10_000_000
    assert all(step % 10_000_000 == 0 for step in steps)  # more: the machine was behind
    assert [s for s in seen if isinstance(s, str)] == [str(k) for k in range(6)]


@pytest.mark.slow
def test_slow_clock_still_ticks_a_hundred_times_a_second(ros, tmp_path):
    bag = talk_bag(tmp_path / "b.mcap", ["a", "b"], step_s=0.02)
    ticks = []
    ros.create_subscription(Clock, "/clock", lambda m: ticks.append(m.clock.nanosec), RELIABLE)
    with Replayer(bag, rate=0.25, clock=True) as player:
        player.wait_for_subscribers()
        player.play()
    until(lambda: ticks and ticks[-1] == 220_000_000)
    steps = sorted((b - a) % 10**9 for a, b in itertools.pairwise(ticks))
    assert steps[0] == 2_500_000  # 10 ms of real time
    assert all(step % 2_500_000 == 0 for step in steps)


def test_clock_of_an_overloaded_machine_omits_ticks(monkeypatch):
    """Ticks are omitted, stay on the grid, and never overtake the next message."""
    fake = FakeTime()
    monkeypatch.setattr(replay, "time", fake)
    ticks = []
    publisher = SimpleNamespace(
        publish=lambda m: ticks.append(m.clock.sec * 10**9 + m.clock.nanosec - START_NS)
    )
    player = SimpleNamespace(_clock=publisher, rate=1.0)
    pace = replay._Pace(START_NS, 1.0, fake, lambda position: None)
    fake.now_ns += 1_003_000_000
    tick_ns = Replayer._run_clock(player, pace, START_NS, START_NS + 500_000_000)
    assert ticks == [0, 500_000_000]
    assert tick_ns == START_NS + 510_000_000
    Replayer._run_clock(player, pace, tick_ns, START_NS + 1_020_000_000)
    assert ticks == [0, 500_000_000, 510_000_000, 1_000_000_000, 1_010_000_000, 1_020_000_000]


def test_recorded_clock_is_replayed(ros, tmp_path):
    with BagWriter(tmp_path / "b.mcap") as bag:
        bag.add_topic("/clock", "rosgraph_msgs/msg/Clock")
        own = Clock()
        own.clock.sec = 77
        bag.write_raw("/clock", START_NS, serialize_message(own))
    arrived = raw_subscription(ros, Clock, "/clock")
    with Replayer(tmp_path / "b.mcap", clock=True) as player:
        assert not player.is_old
        player.wait_for_subscribers()
        player.play()
    until(lambda: arrived)
    assert [deserialize_message(a, Clock).clock.sec for a in arrived] == [77]


@pytest.mark.slow
def test_loop_repeats_the_bag(ros, tmp_path):
    """Each pass has the same stamps; the clock jumps back."""
    bag = talk_bag(tmp_path / "b.mcap", ["one", "two", "three"])
    arrived = raw_subscription(ros, String, "/talk")
    ticks = []
    ros.create_subscription(
        Clock, "/clock", lambda m: ticks.append((m.clock.sec, m.clock.nanosec)), RELIABLE
    )
    with mrs("replay", bag, "--loop", "--clock") as process:
        until(lambda: len(arrived) >= 7)
        code, reported = finish(process, signal.SIGINT)
    assert code == 0, reported
    assert texts_of(arrived[:7]) == ["one", "two", "three"] * 2 + ["one"]
    back = [k for k in range(1, len(ticks)) if ticks[k] < ticks[k - 1]]
    assert len(back) >= 2
    assert all(ticks[k] == ticks[0] for k in back)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stopped_replay_ends_in_order(ros, tmp_path, number, code):
    bag = talk_bag(tmp_path / "b.mcap", ["now", "in ten minutes"], step_s=600.0)
    arrived = raw_subscription(ros, String, "/talk")
    with mrs("replay", bag) as process:
        until(lambda: arrived)
        assert finish(process, number)[0] == code
    assert texts_of(arrived) == ["now"]


def test_late_subscriber_gets_latched_messages(ros, tmp_path):
    """Transient local only for topics that were recorded so."""
    with BagWriter(tmp_path / "b.mcap") as bag:
        bag.add_topic("/map", "std_msgs/msg/String", [latched_offer()])
        bag.add_topic("/talk", "std_msgs/msg/String")
        bag.write_raw("/map", START_NS, serialize_message(String(data="the map")))
        bag.write_raw("/talk", START_NS, serialize_message(String(data="missed")))
        bag.write_raw("/talk", START_NS + 600 * 10**9, serialize_message(String(data="never")))
    progress: list[Progress] = []
    with Replayer(tmp_path / "b.mcap") as player, running(player.play, on_progress=progress.append):
        until(lambda: progress and progress[-1].published == 2)
        arrived = raw_subscription(ros, String, "/map", LATCHED)
        missed = raw_subscription(ros, String, "/talk", LATCHED)
        until(lambda: arrived)
    assert texts_of(arrived) == ["the map"]
    assert missed == []
    assert progress[-1].duration_s == 600.0
    assert 0.0 <= progress[-1].position_s < LIMIT_S


def latched_offer():
    from mrs_tools.bags.recorder import _recorded

    return _recorded(LATCHED)


@pytest.mark.slow
def test_incompatible_subscriber_is_named(ros, tmp_path):
    bag = talk_bag(tmp_path / "b.mcap", ["a"])
    arrived = raw_subscription(ros, String, "/talk", LATCHED)
    code, reported = run("replay", bag, "--wait", 3)
    assert code == 0
    assert "a subscriber of /talk gets nothing" in reported
    assert arrived == []


def test_replay_without_subscribers_reports_it(tmp_path):
    code, reported = run("replay", talk_bag(tmp_path / "b.mcap", ["a"]), "--wait", 0)
    assert code == 0
    assert "nobody listens yet" in reported
    assert "published 1 messages on 1 topics" in reported


def odd_bag(path, definition, msgtype="odd_msgs/msg/Odd"):
    """A topic of a foreign type beside /talk."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, msgtype))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        odd = writer.add_connection("/odd", msgtype, typestore=store)
        talk = writer.add_connection("/talk", "std_msgs/msg/Int32", typestore=default_typestore())
        writer.write(odd, START_NS, b"\x00\x01\x00\x00\x00\x00\x00\x00")
        writer.write(talk, START_NS, serialize_message(Int32(data=5)))
    return path


@pytest.mark.parametrize("name", ["/robot-a/odom", "odom", "/", "/1st", "/a//b", "/ä", ""])
def test_topic_with_an_invalid_ros_name_is_omitted(ros, tmp_path, name):
    with BagWriter(tmp_path / "b") as bag:
        for topic in (name, "/talk"):
            bag.add_topic(topic, "std_msgs/msg/String")
            bag.write_raw(topic, START_NS, serialize_message(String(data="a")))
    with Replayer(tmp_path / "b") as player:
        assert player.skipped.keys() == {name}
        assert "no ROS 2 name; allowed: / before each part" in player.skipped[name]
        assert player.play().counts == {"/talk": 1}


@pytest.mark.parametrize("msgtype", ["", "/msg/Odd", "..x/msg/Odd", "std_msgs/msg/__doc__", "os"])
def test_invalid_types_have_no_message_class(msgtype):
    assert message_class(msgtype) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("msgtype", "why"),
    [
        ("odd_msgs/msg/Odd", "is not installed"),
        ("std_msgs/msg/Odd", "is not installed"),
        ("std_msgs/msg/Float32", "is defined otherwise in the bag than here"),
    ],
)
def test_topic_without_a_usable_definition_is_omitted(ros, tmp_path, msgtype, why):
    bag = odd_bag(tmp_path / "b", "int32 number", msgtype)
    arrived = raw_subscription(ros, Int32, "/talk")
    with Replayer(bag) as player:
        assert player.skipped.keys() == {"/odd"}
        assert why in player.skipped["/odd"]
        player.wait_for_subscribers()
        assert player.play().counts == {"/talk": 1}
    until(lambda: arrived)
    assert deserialize_message(arrived[0], Int32).data == 5
    with pytest.raises(BagError, match=f"cannot publish /odd: .*{why}"):
        Replayer(bag, topics=["/odd"])
    with pytest.raises(BagError, match=f"no topic can be published.*{why}"):
        Replayer(bag, topics=["/od*"])


def test_replay_names_omitted_topics(tmp_path):
    code, reported = run("replay", odd_bag(tmp_path / "b", "int32 number"), "--wait", 0)
    assert code == 0
    assert "/odd is left out: its type odd_msgs/msg/Odd is not installed" in reported


def test_damage_found_during_replay_is_reported(tmp_path):
    """Errors found only during the replay are reported like the others."""
    bag = talk_bag(tmp_path / "b", ["a", "b"])
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 2", "message_count: 3"))
    code, reported = run("replay", bag, "--wait", 0)
    assert code == 1
    assert "truncated or damaged" in reported
    assert reported.count("\n") == reported.count("note:") + 1


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_invalid_rates_are_refused(rate):
    with pytest.raises(ValueError, match="rate must be a positive number"):
        Replayer(PAPER, rate=rate)
    assert run("replay", PAPER, f"--rate={rate}")[0] == 2


def two_topics(path):
    with BagWriter(path) as bag:
        for topic in ("/live", "/free"):
            bag.add_topic(topic, "std_msgs/msg/String")
        for k in range(20):
            for topic in ("/live", "/free"):
                text = serialize_message(String(data=f"recorded {k}"))
                bag.write_raw(topic, START_NS + k * 200_000_000, text)
    return path


@pytest.mark.slow
def test_topics_of_live_nodes_are_omitted(ros, tmp_path):
    """None of its messages is doubled; the node is named."""
    ros.create_publisher(String, "/live", RELIABLE)
    arrived = {topic: raw_subscription(ros, String, topic) for topic in ("/live", "/free")}
    bag = two_topics(tmp_path / "b.mcap")
    code, reported = run("replay", bag, "--rate", 8, "--clock")
    assert code == 0, reported
    assert f"note: /live is left out: /{ros.get_name()} publishes it" in reported
    assert "published 20 messages on 1 topics" in reported
    until(lambda: len(arrived["/free"]) == 20)
    assert arrived["/live"] == []

    def is_refused():
        """On a busy machine a node may not have been discovered at the first try."""
        try:
            Replayer(bag, topics=["/live"]).close()
        except BagError as err:
            assert re.search("cannot publish /live: .* publishes it", str(err))  # noqa: PT017
            return True
        return False

    until(is_refused)


def test_topics_of_the_same_nodes_are_omitted_in_one_line(monkeypatch, tmp_path):
    others = ["/camera", "/robot_a/robot_node"]
    monkeypatch.setattr(Replayer, "_others", lambda _, topic: others if topic != "/three" else [])
    with BagWriter(tmp_path / "b.mcap") as bag:
        for topic in ("/one", "/two", "/three"):
            bag.add_topic(topic, "std_msgs/msg/String")
            bag.write_raw(topic, START_NS, serialize_message(String()))
    done = CliRunner().invoke(app, ["replay", str(tmp_path / "b.mcap"), "--clock", "--wait", "0"])
    wanted = (
        "note: /one, /two and /clock are left out: /camera and /robot_a/robot_node publish them"
    )
    assert wanted in done.stderr.replace("\n", " ")
    assert done.stderr.count("left out") == 1


@pytest.mark.slow
def test_node_that_starts_during_replay_takes_over_its_topic(ros, tmp_path):
    arrived = {topic: raw_subscription(ros, String, topic) for topic in ("/live", "/free")}
    left_out = {}
    with Replayer(two_topics(tmp_path / "b.mcap"), clock=True) as player:
        player.wait_for_subscribers()
        with running(player.play, on_left_out=lambda topics, why: left_out.update({why: topics})):
            until(lambda: arrived["/live"])
            ros.create_publisher(String, "/live", RELIABLE)
            until(lambda: left_out)
            assert ros.count_publishers("/live") <= 2  # its own, and the one that is ending
            until(lambda: len(arrived["/free"]) == 20)
    assert len(arrived["/live"]) < 20
    assert left_out == {f"/{ros.get_name()} publishes it": ["/live"]}


def test_replay_omits_the_clock_if_another_node_publishes_it(ros, tmp_path):
    ros.create_publisher(Clock, "/clock", RELIABLE)
    ticks = raw_subscription(ros, Clock, "/clock")
    with Replayer(talk_bag(tmp_path / "b.mcap", ["a", "b"]), clock=True) as player:
        assert player.skipped == {"/clock": f"/{ros.get_name()} publishes it"}
        assert player.play().counts == {"/talk": 2}
    assert ticks == []


# ---------------------------------------------------------------------------------------- record


@pytest.mark.slow
def test_record_takes_inputs_and_outputs_and_names_omitted_topics(ros, tmp_path):
    """Inputs by name or subscription, outputs of the nodes; no debug image."""
    kinds = {
        "/robot_a/left/image_rect": Image,
        "/robot_a/odom": Odometry,
        "/robot_a/points": PointCloud2,
        "/robot_a/pose": PoseWithCovarianceStamped,
        "/zed/left_color": Image,
    }
    large = {
        "/robot_a/debug/cloud": PointCloud2,
        "/robot_a/debug/disparity": DisparityImage,
        "/robot_a/left/image_rect/compressed": CompressedImage,
        "/camera/depth/points": PointCloud2,
        "/camera/color/image_raw": Image,
    }
    publishers = [
        ros.create_publisher(kind, topic, RELIABLE) for topic, kind in {**kinds, **large}.items()
    ]
    with node("other") as other, mrs("record", tmp_path / "out.mcap") as process:
        other = rclpy.create_node("robot_node", context=other.context, enable_rosout=False)
        other.create_subscription(Image, "/zed/left_color", lambda m: None, RELIABLE)
        heard = [p for p in publishers if p.topic_name in kinds]
        until(lambda: all(p.get_subscription_count() >= 1 for p in heard))
        until(lambda: publishers[4].get_subscription_count() == 2)
        time.sleep(CATCH_UP_S)
        assert [p.topic_name for p in publishers if p.get_subscription_count() == 0] == [*large]
        for publisher in publishers:
            publisher.publish(publisher.msg_type())
        time.sleep(CATCH_UP_S)
        code, reported = finish(process, signal.SIGINT)
        other.destroy_node()
    assert code == 0, reported
    with BagReader(tmp_path / "out.mcap") as bag:
        assert {t.name: t.count for t in bag.topics.values()} == dict.fromkeys(kinds, 1)
    assert "left out, as no node takes them in: " + ", ".join(sorted(large)) in reported
    assert re.search(r"^ +1 +0\.00 MB  /robot_a/odom$", reported, re.MULTILINE)
    assert re.search(r"^ +5 messages in .*out\.mcap, 0\.0 MB$", reported, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["out.mcap", "a bag"])
def test_killed_recorder_leaves_recoverable_data(ros, tmp_path, name):
    """All but the last second; the next command that opens the bag names the recovery option."""
    out = tmp_path / name
    publisher = ros.create_publisher(String, "/talk", RELIABLE)
    with mrs("record", out, "/talk") as process:
        publish_until([publisher], publisher.get_subscription_count)
        time.sleep(CATCH_UP_S)
        for k in range(1000, 1020):
            publisher.publish(String(data=f"- {k}"))
        time.sleep(CATCH_UP_S)
        code, reported = run("record", "--recover", out)
        assert (code, "is being written at the moment" in reported) == (1, True)
        process.kill()
        process.wait()
    assert not out.exists()
    for command in (["replay", out], ["replay", f"{out}.part"], ["record", out]):
        code, reported = run(*command)
        assert code == 1
        assert f"mrs record --recover {shlex.quote(str(out))}" in reported
    with next((tmp_path / f"{name}.part").glob("*/*.mcap")).open("ab") as file:
        file.write(b"\x06\x99\x99")  # the beginning of a chunk
    code, reported = run("record", "--recover", out)
    assert code == 0, reported
    assert "of the end 3 bytes are lost" in reported
    with BagReader(out) as bag:
        assert numbers(bag, "/talk")[-20:] == list(range(1000, 1020))
        assert bag.topics["/talk"].qos[0].reliability == QosReliability.RELIABLE
    assert list(tmp_path.iterdir()) == [out]
    code, reported = run("record", "--recover", out)
    assert (code, "nothing to recover" in reported) == (1, True)


def publish_until(publishers, condition):
    """Publish counting texts on each until a condition holds; return how many."""
    count = 0
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end
        for publisher in publishers:
            publisher.publish(String(data=f"{publisher.topic_name} {count}"))
        count += 1
        time.sleep(0.02)
    return count


def numbers(bag, topic):
    return [int(m.data.split()[1]) for _, _, m in bag.decoded([topic])]


@pytest.mark.slow
def test_record_adapts_to_the_qos_of_each_publisher(ros, tmp_path):
    """Best effort, reliable, latched before the start, and a topic that appears later."""
    latched = ros.create_publisher(String, "/latched", LATCHED)
    latched.publish(String(data="/latched 0"))
    plain = ros.create_publisher(String, "/plain", RELIABLE)
    sensor = ros.create_publisher(String, "/sensor", BEST_EFFORT)
    hidden = ros.create_publisher(String, "/_hidden", RELIABLE)
    started_ns = time.time_ns()
    with mrs("record", tmp_path / "out.mcap") as process:
        publish_until([plain], plain.get_subscription_count)
        until(sensor.get_subscription_count)
        until(latched.get_subscription_count)
        late = ros.create_publisher(String, "/late", RELIABLE)
        publish_until([plain, sensor, hidden], late.get_subscription_count)
        time.sleep(CATCH_UP_S)  # the recorder's side of the match
        for k in range(1000, 1010):
            for publisher in (plain, sensor, late):
                publisher.publish(String(data=f"- {k}"))
        time.sleep(CATCH_UP_S)
        code, reported = finish(process, signal.SIGINT)
    assert code == 0, reported
    ended_ns = time.time_ns()
    with BagReader(tmp_path / "out.mcap") as bag:
        assert set(bag.topics) == {"/latched", "/plain", "/sensor", "/late"}
        for topic in ("/plain", "/sensor", "/late"):
            assert numbers(bag, topic)[-10:] == list(range(1000, 1010))
        assert numbers(bag, "/latched") == [0]
        assert started_ns < bag.start_ns <= bag.end_ns < ended_ns
        ((offer,),) = ([*bag.topics["/latched"].qos],)
        assert offer.durability == QosDurability.TRANSIENT_LOCAL
        assert bag.topics["/sensor"].qos[0].reliability == QosReliability.BEST_EFFORT
        assert bag.topics["/plain"].qos[0].reliability == QosReliability.RELIABLE


@pytest.mark.slow
def test_record_adapts_to_a_later_publisher_with_weaker_qos(ros, tmp_path):
    """The initial reliable subscription would never receive from the second publisher."""
    first = ros.create_publisher(String, "/talk", RELIABLE)
    with mrs("record", tmp_path / "out.mcap", "/talk") as process:
        publish_until([first], first.get_subscription_count)
        second = ros.create_publisher(String, "/talk", BEST_EFFORT)
        until(second.get_subscription_count)
        time.sleep(CATCH_UP_S)  # the recorder's side of the match
        for k in range(1000, 1005):
            first.publish(String(data=f"first {k}"))
            second.publish(String(data=f"second {k}"))
        time.sleep(CATCH_UP_S)
        assert finish(process, signal.SIGTERM)[0] == 0
    with BagReader(tmp_path / "out.mcap") as bag:
        reported = [m.data for _, _, m in bag.decoded(["/talk"])]
    for who in ("first", "second"):
        assert [s for s in reported if s.startswith(who)] == [
            f"{who} {k}" for k in range(1000, 1005)
        ]


def test_record_takes_only_requested_topics(ros, tmp_path):
    publishers = [ros.create_publisher(String, t, RELIABLE) for t in ("/a/x", "/a/y", "/b/x")]
    seen = []
    with Recorder(tmp_path / "out", ["/a/*", "b/z"]) as recorder:
        with running(recorder.run, on_status=seen.append):
            publish_until(publishers, lambda: seen and seen[-1].messages > 20)
        assert recorder.silent() == ["b/z"]
        assert recorder.counts.keys() == {"/a/x", "/a/y"}
    assert seen[-1].topics == 2
    assert seen[-1].size_bytes > 20 * 10
    with BagReader(tmp_path / "out") as bag:
        assert set(bag.topics) == {"/a/x", "/a/y"}
        for topic in bag.topics:
            got = numbers(bag, topic)
            assert got == list(range(got[0], got[0] + len(got)))


@pytest.mark.slow
def test_record_ends_after_the_given_time(ros, tmp_path):
    publisher = ros.create_publisher(String, "/talk", RELIABLE)
    with mrs("record", tmp_path / "out.mcap", "--duration", 4) as process:
        publish_until([publisher], lambda: process.poll() is not None)
        code, reported = finish(process)
    assert code == 0, reported
    with BagReader(tmp_path / "out.mcap") as bag:
        assert bag.duration_s < 10.0


def test_record_overwrites_nothing(tmp_path):
    path = talk_bag(tmp_path / "b.mcap", ["precious"])
    before = path.read_bytes()
    code, reported = run("record", path)
    assert code == 1
    assert "exists already" in reported
    assert path.read_bytes() == before


@pytest.mark.parametrize("name", ["/bad topic!", "/a//b", "/1st", "/robot_*/"])
def test_record_refuses_invalid_topic_names(tmp_path, name):
    with pytest.raises(BagError, match="fits no topic: it is no ROS 2 name; allowed: / before"):
        Recorder(tmp_path / "z.mcap", ["*", "/robot_[ab]/*", "talk", "*/image_*", "/?", name])
    assert not list(tmp_path.iterdir())


def test_record_without_messages_leaves_no_file(tmp_path):
    code, reported = run("record", tmp_path / "out.mcap", "/nope", "--duration", 0.5)
    assert code == 1
    assert "no message came on /nope" in reported
    assert "ROS_DOMAIN_ID" in reported
    assert list(tmp_path.iterdir()) == []


# --------------------------------------------------------------------------------------- command

WITHOUT = """
import sys
for name in {missing!r}:
    sys.modules[name] = None
from mrs_tools.cli import main
sys.argv = ["mrs", *{args!r}]
try:
    main()
finally:
    print("LOADED", sorted({{"rclpy", "rosbags", "numpy", "cv2"}} & {{
        name for name, module in sys.modules.items() if module}}))
"""


def run_without(missing, *args):
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT.format(missing=missing, args=[str(a) for a in args])],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout + done.stderr


def test_help_needs_neither_ros_nor_heavy_libraries():
    code, reported = run_without(["rclpy", "rosbags", "numpy"], "--help")
    assert code == 0
    assert "replay" in reported
    assert "record" in reported
    assert "LOADED []" in reported


@pytest.mark.parametrize("name", ["replay", "record"])
def test_help_of_a_command_needs_no_ros(name):
    code, reported = run_without(["rclpy"], name, "--help")
    assert code == 0
    assert "Usage: mrs" in reported


@pytest.mark.parametrize(
    ("missing", "args", "extra"),
    [
        ("rclpy", ["replay", PAPER], "'mrs-people-loc[ros]'"),
        ("rosgraph_msgs", ["replay", PAPER], "'mrs-people-loc[ros]'"),
        ("rosbags", ["replay", PAPER], "'mrs-people-loc[tools]'"),
        ("typer", ["replay", PAPER], "'mrs-people-loc[tools]'"),
        ("rclpy", ["record", "/tmp/never.mcap"], "'mrs-people-loc[ros]'"),
    ],
)
def test_missing_libraries_are_named(missing, args, extra):
    code, reported = run_without([missing], *args)
    assert code == 1
    assert f"needs {missing}" in reported
    assert extra in reported
    assert not Path("/tmp/never.mcap").exists()
    assert not Path("/tmp/never.mcap.part").exists()


@pytest.mark.parametrize(
    ("args", "code", "text"),
    [
        (["nope"], 2, "No such command 'nope'"),
        (["replay"], 2, "Missing argument"),
        (["replay", "nope.mcap"], 1, "error: nope.mcap: there is no such bag"),
        (["replay", PAPER, "-t", "/nope"], 1, "no topic /nope"),
        (["--version"], 0, "mrs 0."),
    ],
)
def test_exit_codes(args, code, text):
    result, reported = run(*args)
    assert result == code
    assert text in reported


def test_message_classes_are_found_by_type():
    assert message_class("std_msgs/msg/String") is String
    assert message_class("std_msgs/msg/Nope") is None
    assert message_class("nope_msgs/msg/String") is None
    assert message_class("nonsense") is None


def test_progress_of_a_replay_is_reported(tmp_path):
    bag = talk_bag(tmp_path / "b.mcap", ["a", "b", "c"], step_s=0.25)
    seen: list[Progress] = []
    with Replayer(bag, clock=True) as player:
        done = player.play(on_progress=seen.append)
    assert done.counts == {"/talk": 3}
    assert seen[-1] == Progress(0.5, 0.5, 3)
    assert seen[0].position_s < 0.0
    assert [p.position_s for p in seen] == sorted(p.position_s for p in seen)
