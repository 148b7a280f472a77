"""Bags: what is written is read, by us and by others; whatever is wrong is a BagError."""

import contextlib
import errno
import functools
import os
import random
import re
import shutil
import sqlite3
import sys
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from mrs_people_loc.errors import BagError
from mrs_tools.bags import checks as bag_checks
from mrs_tools.bags.checks import CheckedWriter, zstd
from mrs_tools.bags.message_types import MAX_PARTS, OUR_MESSAGES, default_typestore, require_types
from mrs_tools.bags.reader import BagReader, matching
from mrs_tools.bags.recovery import recover
from mrs_tools.bags.writer import BagWriter

REPOSITORY = Path(__file__).parents[3]
BAGS = REPOSITORY / "bags"
START_NS = 1_700_000_000_000_000_000
FOREVER = QosTime(9223372036, 854775807)
LATCHED = Qos(
    QosHistory.UNKNOWN,
    0,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    FOREVER,
    FOREVER,
    QosLiveliness.AUTOMATIC,
    FOREVER,
    False,
)


def text(data):
    return default_typestore().types["std_msgs/msg/String"](data=data)


def image(step):
    types = default_typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=step, nanosec=5)
    return types["sensor_msgs/msg/Image"](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="eye"),
        height=3,
        width=4,
        encoding="mono8",
        is_bigendian=0,
        step=4,
        data=np.arange(12, dtype=np.uint8) + step,
    )


def write_sample(path, words=1):
    """Ten texts and ten images, taking turns every 100 ms."""
    with BagWriter(path) as bag:
        for step in range(10):
            bag.write("/talk", START_NS + step * 200_000_000, text("word " * step * words))
            bag.write("/eye/image", START_NS + step * 200_000_000 + 100_000_000, image(step))
    return path


def write_foreign(
    path, plugin, compression=CompressionMode.NONE, *, words=1, chunks=None, indexed=True
):
    """The sample as another program writes it: with rosbags itself, or nearly."""
    source = write_sample(path.with_name("source.mcap"), words)
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with BagReader(source) as bag, writer:
        if chunks:
            storage: Any = writer.storage
            storage.compression, storage.compressor = chunks
        connections = {
            t.name: writer.add_connection(t.name, t.type, typestore=bag.typestore)
            for t in bag.topics.values()
        }
        for m in bag.messages():
            writer.write(connections[m.topic], m.time_ns, m.data)
    source.unlink()
    if not indexed:
        file = path / f"{path.name}.mcap"
        data = file.read_bytes()
        file.write_bytes(data[:-28] + bytes(16) + data[-12:])
    return path


FORMATS = {
    "file": lambda folder: write_sample(folder / "sample.mcap"),
    "folder": lambda folder: write_sample(folder / "sample"),
    "sqlite folder": lambda folder: write_foreign(folder / "sample", StoragePlugin.SQLITE3),
    "sqlite file": lambda folder: (
        write_foreign(folder / "sample", StoragePlugin.SQLITE3) / "sample.db3"
    ),
    "zstd chunks": lambda folder: write_foreign(
        folder / "sample", StoragePlugin.MCAP, CompressionMode.STORAGE
    ),
    "zstd file": lambda folder: write_foreign(
        folder / "sample", StoragePlugin.MCAP, CompressionMode.FILE
    ),
}


@pytest.fixture(params=FORMATS)
def sample(request, tmp_path):
    return FORMATS[request.param](tmp_path)


# ------------------------------------------------------------------------------------- reading


def test_values_are_read_in_time_order(sample):
    with BagReader(sample) as bag:
        assert {t.name: (t.type, t.count) for t in bag.topics.values()} == {
            "/eye/image": ("sensor_msgs/msg/Image", 10),
            "/talk": ("std_msgs/msg/String", 10),
        }
        assert bag.message_count == 20
        assert bag.start_ns == START_NS
        assert bag.end_ns == START_NS + 1_900_000_000
        assert bag.duration_s == pytest.approx(1.9)
        read = list(bag.decoded())
    assert [topic for topic, _, _ in read] == ["/talk", "/eye/image"] * 10
    assert [at for _, at, _ in read] == [START_NS + k * 100_000_000 for k in range(20)]
    for step in range(10):
        assert read[2 * step][2].data == "word " * step
        seen = read[2 * step + 1][2]
        assert (seen.header.stamp.sec, seen.header.stamp.nanosec) == (step, 5)
        assert seen.header.frame_id == "eye"
        np.testing.assert_array_equal(seen.data, np.arange(12) + step)


def test_time_order_is_independent_of_the_order_of_writing(tmp_path):
    with BagWriter(tmp_path / "b.mcap") as bag:
        for at in (5, 3, 9, 1):
            bag.write("/talk", START_NS + at, text(str(at)))
    with BagReader(tmp_path / "b.mcap") as bag:
        assert [m.data for _, _, m in bag.decoded()] == ["1", "3", "5", "9"]


def test_only_requested_topics_are_read(sample):
    with BagReader(sample) as bag:
        assert {m.topic for m in bag.messages(["/talk"])} == {"/talk"}
        assert {m.topic for m in bag.messages(["talk"])} == {"/talk"}
        assert {m.topic for m in bag.messages(["/eye/*"])} == {"/eye/image"}
        assert len(list(bag.messages(["/eye/*", "/talk"]))) == 20
        # a second and an interleaved reading start from the beginning
        assert next(bag.messages()).time_ns == START_NS


def test_only_messages_of_the_requested_time_are_read(sample):
    with BagReader(sample) as bag:
        every = [raw.time_ns for raw in bag.messages()]
        middle_ns = every[len(every) // 2]
        early = [raw.time_ns for raw in bag.messages(stop_ns=middle_ns)]
        late = [raw.time_ns for raw in bag.messages(start_ns=middle_ns)]
        at_once = [raw.time_ns for raw in bag.messages((), middle_ns, middle_ns + 1)]
    assert early + late == every
    assert early[-1] < middle_ns == late[0] == at_once[0] == at_once[-1]


def test_patterns_select_topics():
    names = ["/a/left", "/a/odom", "/b/odom"]
    assert matching(names, []) == names
    assert matching(names, ["/a/*"]) == names[:2]
    assert matching(names, ["*/odom", "a/left"]) == names
    assert matching(names, ["/a"]) == []


def test_unknown_topic_is_an_error(sample):
    with BagReader(sample) as bag:
        with pytest.raises(BagError, match=r"no topic /nope\. It has: /eye/image, /talk"):
            list(bag.messages(["/talk", "/nope"]))
        with pytest.raises(BagError, match="no topic /nope"):
            bag.select(["/nope"])


def test_type_hashes_equal_those_of_ros(sample):
    with BagReader(sample) as bag:
        assert bag.type_hash("sensor_msgs/msg/Image") == (
            "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
        )


# -------------------------------------------------------------------------------------- damage


def error_of(path):
    with pytest.raises(BagError) as caught, BagReader(path) as bag:
        list(bag.decoded())
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def test_missing_bag_is_an_error(tmp_path):
    assert "there is no such bag" in error_of(tmp_path / "nope.mcap")


def test_folder_without_metadata_is_an_error(tmp_path):
    write_sample(tmp_path / "b")
    (tmp_path / "b" / "metadata.yaml").unlink()
    message = error_of(tmp_path / "b")
    assert "no metadata.yaml" in message
    assert str(tmp_path / "b" / "b.mcap") in message
    shutil.rmtree(tmp_path / "b")
    (tmp_path / "b").mkdir()
    assert "no bag" in error_of(tmp_path / "b")


def test_metadata_without_its_file_is_an_error(tmp_path):
    write_sample(tmp_path / "b")
    (tmp_path / "b" / "b.mcap").unlink()
    assert "b.mcap" in error_of(tmp_path / "b")


@pytest.mark.parametrize("name", ["b.mcap", "b.db3"])
def test_empty_file_is_an_error(tmp_path, name):
    (tmp_path / name).touch()
    assert "the file is empty" in error_of(tmp_path / name)


@pytest.mark.parametrize(("name", "hint"), [("b.txt", "not a bag"), ("b.bag", "rosbags-convert")])
def test_files_of_other_formats_are_refused_with_a_hint(tmp_path, name, hint):
    (tmp_path / name).write_text("hello")
    assert hint in error_of(tmp_path / name)


@pytest.mark.parametrize("name", ["b", "b.mcap"])
def test_bag_without_messages_is_read(tmp_path, name):
    with BagWriter(tmp_path / name) as bag:
        bag.add_topic("/talk", "std_msgs/msg/String")
    assert "the bag is empty" in error_of(tmp_path / name)


def test_topic_of_two_types_is_refused(tmp_path):
    with Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for msgtype in ("std_msgs/msg/String", "std_msgs/msg/Empty"):
            c = writer.add_connection("/talk", msgtype, typestore=default_typestore())
            writer.write(c, START_NS, b"\x00\x01\x00\x00\x00")
    assert "topic /talk has two types" in error_of(tmp_path / "b")


def test_bytes_that_are_not_the_stated_type_are_refused(tmp_path):
    with BagWriter(tmp_path / "b.mcap") as bag:
        bag.add_topic("/talk", "std_msgs/msg/String")
        bag.write_raw("/talk", START_NS, b"\x00\x01\x00\x00\xff\xff\x00\x00ab")
    with BagReader(tmp_path / "b.mcap") as bag:
        assert len(list(bag.messages())) == 1
    assert f"message on /talk at {START_NS} ns is no std_msgs/msg/String" in error_of(
        tmp_path / "b.mcap"
    )


def test_index_with_too_many_messages_is_refused(tmp_path):
    """Damage that rosbags ignores without an error."""
    write_sample(tmp_path / "b")
    metadata = tmp_path / "b" / "metadata.yaml"
    metadata.write_text(
        metadata.read_text()
        .replace("message_count: 10", "message_count: 11")
        .replace("message_count: 20", "message_count: 22")
    )
    assert "its index promises 22 messages, 20 found" in error_of(tmp_path / "b")


def data_files(bag):
    return [bag] if bag.is_file() else sorted(bag.iterdir())


def test_file_truncated_at_any_length_is_refused(sample):
    """Every file of every format, cut anywhere: a BagError; the complete file is read."""
    chance = random.Random(1)
    for file in data_files(sample):
        whole = file.read_bytes()
        size = len(whole)
        lengths = {*range(0, 30, 3), *range(size - 9, size), *chance.choices(range(size), k=15)}
        for length in sorted(lengths):
            file.write_bytes(whole[:length])
            # YAML cut in its last lines can still say everything that counts
            if file.name == "metadata.yaml" and length > 0.9 * size:
                continue
            assert "\n" not in error_of(sample)
        file.write_bytes(whole)
    with BagReader(sample) as bag:
        assert len(list(bag.messages())) == 20


def test_flipped_bytes_give_messages_or_bag_errors(sample):
    """Any change gives the messages or a BagError; no other exception, no endless loop."""
    chance = random.Random(2)
    refused = 0
    for file in data_files(sample):
        whole = file.read_bytes()
        for _ in range(60):
            broken = bytearray(whole)
            for _ in range(chance.choice([1, 3, 30])):
                broken[chance.randrange(len(broken))] ^= 1 << chance.randrange(8)
            file.write_bytes(broken)
            try:
                with BagReader(sample) as bag:
                    list(bag.decoded())
            except BagError:
                refused += 1
        file.write_bytes(whole)
    assert refused > 10


def all_of(bag):
    with BagReader(bag) as reader:
        return reader.topics, list(reader.messages())


def test_damage_never_changes_messages_of_our_bags(tmp_path):
    """One bit, or 5,000 zeros, anywhere in a file: an error, unless these bytes are never read."""
    chance = random.Random(3)
    file = tmp_path / "b.mcap"
    with BagWriter(file) as bag:
        for step in range(200):
            bag.write("/talk", START_NS + step, text(f"{step} " * 4000))
    whole = file.read_bytes()
    assert len(whole) > 2_000_000  # several chunks
    expected = all_of(file)
    refused = 0
    for trial in range(60):
        broken = bytearray(whole)
        # the last bytes are the index, of which there is little
        at = chance.randrange(len(whole)) if trial % 2 else len(whole) - 1 - 70 * trial
        if trial % 4 < 2:
            broken[at] ^= 1 << chance.randrange(8)
        else:
            broken[at : at + 5000] = bytes(len(broken[at : at + 5000]))
        file.write_bytes(broken)
        try:
            read = all_of(file)
        except BagError:
            refused += 1
        else:
            assert read == expected
    assert refused >= 50


def test_lost_checksum_is_detected(tmp_path):
    """In files of rosbags no chunk has one; where other chunks have, a 0 is damage."""
    file = tmp_path / "b.mcap"
    with BagWriter(file) as bag:
        for step in range(200):
            bag.write("/talk", START_NS + step, text(f"{step} " * 4000))
    broken = bytearray(file.read_bytes())
    at = broken.index(b"\x06", 30)  # the first chunk's opcode
    broken[at + 9 + 24 : at + 9 + 28] = bytes(4)
    file.write_bytes(broken)
    assert "lost their checksums" in error_of(file)


def test_lz4_chunks_are_read(tmp_path):
    sample = write_foreign(
        tmp_path / "sample", StoragePlugin.MCAP, chunks=("lz4", lz4.frame.compress)
    )
    assert len(all_of(sample)[1]) == 20


@pytest.mark.parametrize(
    ("table", "column", "value", "hint"),
    [
        ("messages", "data", "text", "on /talk is no message"),
        ("messages", "timestamp", "today", "damaged"),
        ("topics", "type_description_hash", 5, "5 where a text belongs"),
        ("topics", "type_description_hash", None, "None where a text belongs"),
        ("topics", "name", b"/talk", "where a text belongs"),
        ("message_definitions", "encoded_message_definition", 7, "damaged"),
    ],
)
def test_sqlite_values_of_wrong_types_are_refused(tmp_path, table, column, value, hint):
    """SQLite takes any value in any column."""
    file = write_foreign(tmp_path / "sample", StoragePlugin.SQLITE3) / "sample.db3"
    with contextlib.closing(sqlite3.connect(file)) as database, database:
        database.execute("PRAGMA ignore_check_constraints = ON")
        made = database.execute(
            "SELECT sql FROM sqlite_master WHERE name = ?", (table,)
        ).fetchone()[0]
        loose = re.sub(r"(TEXT|BLOB) NOT NULL", "", made)
        rows = database.execute(f"SELECT * FROM {table}").fetchall()
        database.execute(f"DROP TABLE {table}")
        database.execute(loose)
        database.executemany(f"INSERT INTO {table} VALUES ({','.join('?' * len(rows[0]))})", rows)
        database.execute(f"UPDATE {table} SET {column} = ?", (value,))
    assert hint in error_of(file)


def laughs(depth=8):
    """Lists of nine times the list before: 9 ** depth words in some hundred bytes."""
    lists = ["a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    for n in range(1, depth):
        lists.append(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]")
    return "\n".join(lists) + "\n"


@pytest.mark.parametrize("key", ["compression_format", "name", "serialization_format"])
def test_alias_bombs_in_metadata_are_refused(tmp_path, key):
    """rosbags includes the value in its message: 250 MB."""
    write_sample(tmp_path / "b")
    metadata = tmp_path / "b" / "metadata.yaml"
    text = metadata.read_text().replace("compression_mode: ''", "compression_mode: MESSAGE")
    text, found = re.subn(rf"{key}: .*", f"{key}: *a7", text)
    assert found
    metadata.write_text(laughs() + text)
    tracemalloc.start()
    assert "found an alias" in error_of(tmp_path / "b")
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


def test_endlessly_nested_metadata_is_refused(tmp_path):
    write_sample(tmp_path / "b")
    (tmp_path / "b" / "metadata.yaml").write_text("[" * 100_000)
    assert "recursion" in error_of(tmp_path / "b")


# ------------------------------------------------------------------------------------- bounds


@pytest.fixture
def small_limit(monkeypatch):
    """64 MiB would take a while to write."""
    monkeypatch.setattr(bag_checks, "MAX_BYTES", 1_000_000)
    monkeypatch.setattr(bag_checks, "MAX_GROWTH", 2)


def streamed(data):
    """zstd as a program writes it that does not know the length in advance."""
    compressor = zstd.ZstdCompressor()
    return compressor.compress(data) + compressor.flush()


@pytest.mark.parametrize(
    ("name", "compress"),
    [("zstd", zstd.compress), ("zstd", streamed), ("lz4", lz4.frame.compress)],
)
@pytest.mark.parametrize("indexed", [True, False])
def test_expanding_chunks_are_refused(tmp_path, small_limit, name, compress, indexed):
    write = functools.partial(write_foreign, plugin=StoragePlugin.MCAP, indexed=indexed)
    assert len(all_of(write(tmp_path / "good", chunks=(name, compress)))[1]) == 20
    long = write(tmp_path / "long", chunks=(name, compress), words=300_000)
    assert re.search(r"the chunk at byte \d+ grows to \d+ bytes; allowed: 1000000", error_of(long))
    lying = write(tmp_path / "lying", chunks=(name, lambda _: compress(bytes(100_000_000))))
    tracemalloc.start()
    assert "but has others" in error_of(lying)
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


def test_unknown_compression_is_refused(tmp_path):
    bag = write_foreign(tmp_path / "bag", StoragePlugin.MCAP, chunks=("zip", zlib.compress))
    assert "compression is b'zip'; wanted: zstd, lz4 or none" in error_of(bag)


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_expanding_messages_are_refused(tmp_path, small_limit, plugin):
    write = functools.partial(write_foreign, plugin=plugin, compression=CompressionMode.MESSAGE)
    assert len(all_of(write(tmp_path / "good"))[1]) == 20
    message = error_of(write(tmp_path / "long", words=300_000))
    assert "a message on /talk grows to more than 1000000 bytes, which are allowed" in message


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_expanding_files_are_refused(tmp_path, small_limit, plugin):
    write = functools.partial(write_foreign, plugin=plugin, compression=CompressionMode.FILE)
    assert len(all_of(write(tmp_path / "good"))[1]) == 20
    message = error_of(write(tmp_path / "long", words=300_000))
    assert ".zstd: grows to more than 1000000 bytes, which are allowed" in message


@pytest.mark.parametrize(
    ("definition", "parts"),
    [
        ("string[300000] x", 300_000),
        ("Inner[200] x\n" + "=" * 80 + "\nMSG: odd_msgs/Inner\nstring[200] x", 40_000),
        ("Odd[] x", MAX_PARTS + 1),
    ],
)
def test_definition_with_too_many_parts_is_refused(tmp_path, definition, parts):
    """Some 30 bytes would take 5 GB."""
    with Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        c = writer.add_connection("/odd", "odd_msgs/msg/Odd", msgdef=definition, rihs01="RIHS01_0")
        writer.write(c, START_NS, b"\x00\x01\x00\x00\x00")
    message = error_of(tmp_path / "b")
    assert f"message type odd_msgs/msg/Odd has {parts} parts" in message
    assert "allowed: 10000" in message


def test_arrays_of_numbers_may_be_long(tmp_path):
    with Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        c = writer.add_connection(
            "/long", "odd_msgs/msg/Long", msgdef="uint8[300000] x", rihs01="RIHS01_0"
        )
        writer.write(c, START_NS, b"\x00\x01\x00\x00" + bytes(300_000))
    with BagReader(tmp_path / "b") as bag:
        assert next(bag.decoded())[2].x.size == 300_000


# ------------------------------------------------------------------------------------- writing


@pytest.mark.parametrize("name", ["out.mcap", "out"])
def test_our_bags_are_read_by_other_libraries(tmp_path, name):
    path = write_sample(tmp_path / name)
    with AnyReader([path]) as reader:
        read: list[tuple[str, int, Any]] = [
            (c.topic, at, reader.deserialize(raw, c.msgtype)) for c, at, raw in reader.messages()
        ]
    assert [m.data for topic, _, m in read if topic == "/talk"] == ["word " * k for k in range(10)]
    assert [at for _, at, _ in read] == [START_NS + k * 100_000_000 for k in range(20)]
    assert sorted(p.name for p in tmp_path.iterdir()) == [name]


@pytest.mark.parametrize("name", ["out.mcap", "out"])
def test_bytes_and_quality_of_service_round_trip(tmp_path, name):
    with BagReader(BAGS / "paper_formation") as bag, BagWriter(tmp_path / name) as out:
        for topic in bag.topics.values():
            out.add_topic(topic.name, topic.type, [LATCHED])
        source = list(bag.messages())
        for m in source:
            out.write_raw(m.topic, m.time_ns, m.data)
        assert out.counts == {t.name: t.count for t in bag.topics.values()}
    with BagReader(tmp_path / name) as bag:
        assert list(bag.messages()) == source
        assert {t.qos for t in bag.topics.values()} == {(LATCHED,)}


def test_nothing_is_overwritten(tmp_path):
    path = write_sample(tmp_path / "out.mcap")
    before = path.read_bytes()
    with pytest.raises(BagError, match=r"out\.mcap: exists already"):
        BagWriter(path)
    assert path.read_bytes() == before


def test_files_created_meanwhile_are_not_overwritten(tmp_path):
    writer = BagWriter(tmp_path / "out.mcap")
    writer.write("/talk", START_NS, text("mine"))
    (tmp_path / "out.mcap").write_text("theirs")
    with pytest.raises(BagError, match="was left in"):
        writer.close()
    assert (tmp_path / "out.mcap").read_text() == "theirs"
    with BagReader(tmp_path / "out.mcap.part" / "out") as bag:
        assert [m.data for _, _, m in bag.decoded()] == ["mine"]


def test_leftover_of_a_killed_recording_is_named(tmp_path):
    (tmp_path / "out.mcap.part").mkdir()
    with pytest.raises(BagError, match=r"out\.mcap\.part: exists already"):
        BagWriter(tmp_path / "out.mcap")


def write_and_fail(path):
    with BagWriter(path) as bag:
        bag.write("/talk", START_NS, text("half"))
        raise KeyError("in between")


@pytest.mark.parametrize("name", ["out.mcap", "out"])
def test_exception_while_writing_leaves_no_file(tmp_path, name):
    with pytest.raises(KeyError):
        write_and_fail(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_unwritable_target_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=r"out\.mcap: cannot be written"):
        BagWriter(tmp_path / "file" / "out.mcap")
    with pytest.raises(BagError, match="only mcap is written"):
        BagWriter(tmp_path / "out.db3")


def test_wrong_use_of_the_writer_is_an_error(tmp_path):
    with BagWriter(tmp_path / "out.mcap") as bag:
        bag.write("/talk", START_NS, text("a"))
        with pytest.raises(BagError, match="topic /other was not announced"):
            bag.write_raw("/other", START_NS, b"")
        with pytest.raises(BagError, match="topic /talk was announced before"):
            bag.add_topic("/talk", "std_msgs/msg/String")
        with pytest.raises(BagError, match=r"/talk is std_msgs/msg/String, not sensor_msgs/msg/Im"):
            bag.write("/talk", START_NS, image(1))
        with pytest.raises(BagError, match="str on /talk is no message"):
            bag.write("/talk", START_NS, "hello")
        with pytest.raises(BagError, match="for /talk has a bad value"):
            bag.write("/talk", START_NS, text(5))
        with pytest.raises(BagError, match="nope_msgs/msg/Nope is unknown"):
            bag.add_topic("/nope", "nope_msgs/msg/Nope")
    with BagReader(tmp_path / "out.mcap") as bag:
        assert [m.data for _, _, m in bag.decoded()] == ["a"]


# --------------------------------------------------------------------------------- our messages


def install(folder, monkeypatch):
    """Our message definitions where ROS installs them, and nothing else."""
    target = folder / "share" / "mrs_people_msgs" / "msg"
    shutil.copytree(REPOSITORY / "msgs" / "msg", target)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{os.pathsep}{folder}")
    monkeypatch.setattr(sys, "prefix", str(folder / "nowhere"))
    default_typestore.cache_clear()


@pytest.fixture
def installed(tmp_path, monkeypatch):
    yield install(tmp_path / "prefix", monkeypatch)
    default_typestore.cache_clear()


def person(identity):
    types = default_typestore().types
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](1.0, 2.0, 0.0),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
    )
    vector = types["geometry_msgs/msg/Vector3"](np.nan, np.nan, np.nan)
    return types["mrs_people_msgs/msg/Person"](
        id=identity,
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose, np.arange(36.0)),
        velocity=types["geometry_msgs/msg/TwistWithCovariance"](
            types["geometry_msgs/msg/Twist"](vector, vector), np.full(36, np.nan)
        ),
        height=1.75,
        sigma=0.125,
        robots=["robot_a", "robot_c"],
        age=types["builtin_interfaces/msg/Duration"](3, 4),
        coasting=True,
    )


def people():
    types = default_typestore().types
    stamp = types["builtin_interfaces/msg/Time"](7, 8)
    return types["mrs_people_msgs/msg/People"](
        header=types["std_msgs/msg/Header"](stamp, "map"),
        scans=[],
        persons=[person(4), person(9)],
        hidden=[
            types["mrs_people_msgs/msg/HiddenPerson"](
                person=person(5),
                last_seen=types["builtin_interfaces/msg/Time"](6, 9),
                last_seen_at=types["geometry_msgs/msg/Point"](2.0, 3.0, 0.0),
            )
        ],
        groups=[],
        quarantined=["robot_b"],
    )


def check_people(path):
    with BagReader(path) as bag:
        ((topic, at, read),) = bag.decoded()
    assert (topic, at) == ("/tracked_people", START_NS)
    assert read.header.frame_id == "map"
    assert [p.id for p in read.persons] == [4, 9]
    (hidden,) = read.hidden
    assert (hidden.person.id, hidden.last_seen.sec, hidden.last_seen_at.y) == (5, 6, 3.0)
    assert read.quarantined == ["robot_b"]
    assert read.persons[1].robots == ["robot_a", "robot_c"]
    assert (read.persons[0].height, read.persons[0].sigma) == (1.75, 0.125)
    np.testing.assert_array_equal(read.persons[0].pose.covariance, np.arange(36.0))
    assert np.isnan(read.persons[0].velocity.twist.linear.x)


@pytest.mark.usefixtures("installed")
def test_installed_message_types_are_known(tmp_path, monkeypatch):
    assert set(OUR_MESSAGES) <= default_typestore().fielddefs.keys()
    path = tmp_path / "people.mcap"
    with BagWriter(path) as bag:
        bag.write("/tracked_people", START_NS, people())
    check_people(path)
    # the bag carries the definitions: it can be read where our messages are not installed
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    default_typestore.cache_clear()
    assert OUR_MESSAGES[0] not in default_typestore().fielddefs
    check_people(path)


@pytest.mark.usefixtures("installed")
def test_bag_is_read_by_its_own_older_definition(tmp_path):
    definition = default_typestore().generate_msgdef(OUR_MESSAGES[1], ros_version=2)[0]
    older = definition.replace("float32 sigma\n", "")
    assert older != definition
    data = default_typestore().serialize_cdr(person(4), OUR_MESSAGES[1])
    with Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        c = writer.add_connection("/p", OUR_MESSAGES[1], msgdef=older, rihs01="RIHS01_older")
        writer.write(c, START_NS, data)
    with BagReader(tmp_path / "b") as bag:
        assert "sigma" not in {
            name for name, _ in bag.typestore.fielddefs["mrs_people_msgs/msg/Person"][1]
        }
        assert bag.type_hash(OUR_MESSAGES[1]) == "RIHS01_older"


def test_broken_definition_is_refused(tmp_path, monkeypatch):
    install(tmp_path / "prefix", monkeypatch)
    file = tmp_path / "prefix/share/mrs_people_msgs/msg/Odd.msg"
    file.write_text("float32\n")
    with pytest.raises(BagError, match=r"Odd\.msg: not a message definition"):
        require_types(default_typestore(), ["mrs_people_msgs/msg/Odd"])
    default_typestore.cache_clear()


# ------------------------------------------------------------------------------------- manifest


def manifest():
    return yaml.safe_load((BAGS / "manifest.yaml").read_text(encoding="utf-8"))


def test_manifest_lists_every_bag():
    assert set(manifest()) == {
        p.name for p in BAGS.iterdir() if (p / "metadata.yaml").exists() or p.suffix == ".mcap"
    }


@pytest.mark.parametrize("name", manifest())
def test_manifest_matches_the_bags(name):
    entry = manifest()[name]
    assert {"description", "origin", "licence", "ground_truth", "robots"} <= entry.keys()
    with BagReader(BAGS / name) as bag:
        assert entry["topics"] == {
            t.name: {"type": t.type, "count": t.count} for t in bag.topics.values()
        }
        assert bag.duration_s == pytest.approx(entry["duration_s"], abs=1e-3)
        namespaces = {t.split("/")[1] for t in bag.topics}
        assert namespaces - {"ground_truth", "map"} == set(entry["robots"])
        for robot, about in entry["robots"].items():
            for camera in about["cameras"]:
                assert f"/{robot}/{camera}/camera_info" in bag.topics
            if "x_m" not in about:
                continue  # it drives
            odometry = next(bag.decoded([f"/{robot}/odom"]))[2]
            pose = odometry.pose.pose
            yaw = 2 * np.arctan2(pose.orientation.z, pose.orientation.w)
            assert (pose.position.x, pose.position.y) == (about["x_m"], about["y_m"])
            assert yaw == pytest.approx(about["yaw_rad"], abs=1e-6)
        truth = entry["ground_truth"]
        for _, _, poses in bag.decoded([truth["topic"]]):
            assert len(poses.poses) == truth["people"]


def test_our_bags_have_checksums(tmp_path):
    """A changed byte of an image, which nothing else would detect."""
    for name in manifest():
        whole = (BAGS / name / f"{name}.mcap").read_bytes()
        (tmp_path / f"{name}.mcap").write_bytes(whole[:1_000_000] + b"?" + whole[1_000_001:])
        assert "damaged (Chunk checksum mismatch" in error_of(tmp_path / f"{name}.mcap")


def test_recovery_on_a_full_disk_leaves_things_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = BagWriter(tmp_path / "walk.mcap")
    types = default_typestore().types
    killed.write("/talk", 1, types["std_msgs/msg/String"]("hello"))
    killed.flush()
    storage: Any = killed._writer.storage
    storage.bio.close()
    os.close(killed._held)
    before = {f: f.read_bytes() for f in tmp_path.rglob("*") if f.is_file()}

    def full(writer: Any) -> None:
        writer.storage.bio.close()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(CheckedWriter, "close", full)
        with pytest.raises(
            BagError, match=r"recovered \(No space left.*walk.mcap.part is as it was"
        ):
            recover(tmp_path / "walk.mcap")
    assert {f: f.read_bytes() for f in tmp_path.rglob("*") if f.is_file()} == before
    assert recover(tmp_path / "walk.mcap").counts == {"/talk": 1}
    assert list(tmp_path.iterdir()) == [tmp_path / "walk.mcap"]
