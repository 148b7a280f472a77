"""Bags: recordings of ROS topics, read and written without ROS.

A thin layer over `rosbags`: the same two classes for every tool, every failure a `BagError` that
names the file, what is wrong and what to do.

    with BagReader("mrs_people_loc/bags/paper_formation") as bag:
        for topic, time_ns, message in bag.decoded(["/robot_a/odom"]):
            ...

    with BagWriter("out.mcap") as out:
        out.write("/chatter", time_ns, String("hello"))     # a message of `bag.typestore`

A bag is a folder with `metadata.yaml`, as `ros2 bag` makes it, or one `.mcap` or `.db3` file.

What is written has checksums, of messages and index, and what has some is compared with them; so
damage to such a bag never passes for data. SQLite bags (`.db3`) have none: there it is noticed
where SQLite's own structure, or a message's, is broken, and a changed pixel is not.
"""

from __future__ import annotations

import fcntl
import fnmatch
import os
import shlex
import shutil
import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinitionFormat,
    Nodetype,
    Qos,
)
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mrs_people_loc.config import load_yaml
from mrs_people_loc.errors import BagError, ConfigError
from mrs_tools.bags.checks import CheckedReader, CheckedWriter, check_definitions

OUR_MESSAGES = tuple(
    f"mrs_people_msgs/msg/{n}"
    for n in (
        "People",
        "Person",
        "Group",
        "RobotScan",
        "TeamPose",
        "Wall",
        "RelativePose",
        "RelativePoses",
        "GuideStatus",
        "RobotPost",
    )
)


class RawMessage(NamedTuple):
    """One message as it lies in the bag."""

    topic: str
    type: str
    """Type name such as `sensor_msgs/msg/Image`."""
    time_ns: int
    """Bag time, i.e. when the message was recorded; nanoseconds since 1970."""
    data: bytes
    """The message in CDR, encapsulation header included: what `rclpy` publishes as it is."""


@dataclass(frozen=True)
class Topic:
    """One topic of a bag.

    Attributes:
        name: Full name.
        type: Type name such as `sensor_msgs/msg/Image`.
        count: Number of messages.
        qos: What the recorded publishers offered; empty if the bag does not say.
    """

    name: str
    type: str
    count: int
    qos: tuple[Qos, ...] = ()


def matching(names: Iterable[str], patterns: Collection[str]) -> list[str]:
    """Names that fit at least one shell pattern; all of them if there is no pattern.

    Args:
        names: Topic names.
        patterns: Names or shell patterns such as `/robot_a/*`; a missing leading slash is added.

    Returns:
        Those names, in their order.
    """
    full = [p if p.startswith(("/", "*")) else f"/{p}" for p in patterns]
    return [n for n in names if not full or any(fnmatch.fnmatchcase(n, p) for p in full)]


# ---------------------------------------------------------------------------------------- types


@lru_cache(maxsize=1)
def default_typestore() -> Typestore:
    """Every standard message of ROS 2 Jazzy and, where they are installed, our own."""
    store = get_typestore(Stores.ROS2_JAZZY)
    if _definition_file(OUR_MESSAGES[0]):
        require_types(store, OUR_MESSAGES)
    return store


def require_types(store: Typestore, types: Iterable[str]) -> None:
    """Add types that a store lacks, and all they are made of, from the installed packages.

    Args:
        store: The store to add to.
        types: Type names such as `mrs_people_msgs/msg/People`.

    Raises:
        BagError: A definition is not installed or cannot be read.
    """
    wanted = list(types)
    while wanted:
        name = wanted.pop()
        if name in store.fielddefs:
            continue
        file = _definition_file(name)
        if file is None:
            raise BagError(
                f"message type {name} is unknown: install its package, or source the workspace "
                "that has it"
            )
        try:
            found = get_types_from_msg(file.read_text(encoding="utf-8"), name)
            store.register(found)
        except Exception as err:
            raise BagError(f"{file}: not a message definition ({_reason(err)})") from err
        for _, fields in found.values():
            for _, (kind, value) in fields:
                element: Any = value[0] if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else None
                kind, value = element or (kind, value)
                if kind == Nodetype.NAME:
                    wanted.append(str(value))


def _definition_file(name: str) -> Path | None:
    """Where ROS installed the definition of a type, if it did."""
    package, _, message = name.partition("/msg/")
    for prefix in [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]:
        file = Path(prefix, "share", package, "msg", f"{message}.msg")
        if prefix and message and file.is_file():
            return file
    return None


# -------------------------------------------------------------------------------------- reading


class BagReader:
    """An open bag; use it as a context manager or call `close`.

    Attributes:
        path: The bag.
        topics: Its topics by name, sorted.
        start_ns: Bag time of the first message, nanoseconds since 1970.
        end_ns: Bag time of the last message.
        message_count: Number of messages on all topics.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open a bag.

        Args:
            path: A folder with `metadata.yaml`, or one `.mcap` or `.db3` file.

        Raises:
            BagError: There is no such bag, it has no messages, or it is truncated or damaged.
        """
        self.path = Path(path)
        try:
            _check_is_bag(self.path)
            self._reader = CheckedReader(self.path)
            self._reader.open()
        except BagError:
            raise
        except Exception as err:  # the library lets errors of many kinds through on damaged files
            raise _damaged(self.path, err) from err
        try:
            self._read_index()
        except BagError:
            self.close()
            raise
        except Exception as err:
            self.close()
            raise _damaged(self.path, err) from err

    def _read_index(self) -> None:
        self._connections: list[Connection] = list(self._reader.connections)
        for c in self._connections:
            for text in (c.topic, c.msgtype, c.digest, c.msgdef.data):
                if not isinstance(text, str):  # SQLite and YAML have values of all types everywhere
                    raise _damaged(
                        self.path, f"topic {c.topic!r} has {text!r} where a text belongs"
                    )
        self.message_count: int = self._reader.message_count
        self.start_ns: int = self._reader.start_time
        self.end_ns: int = self._reader.end_time - 1
        if self.message_count == 0:
            raise BagError(
                f"{self.path}: the bag is empty, it has no messages. Record it again while the "
                "topics are being published"
            )
        self.topics: dict[str, Topic] = {}
        for c in sorted(self._connections, key=lambda c: c.topic):
            known = self.topics.get(c.topic, Topic(c.topic, c.msgtype, 0))
            if known.type != c.msgtype:
                raise BagError(
                    f"{self.path}: topic {c.topic} has two types, {known.type} and {c.msgtype}. "
                    "Split the bag by type first"
                )
            assert isinstance(c.ext, ConnectionExtRosbag2)
            self.topics[c.topic] = Topic(
                c.topic,
                c.msgtype,
                known.count + c.msgcount,
                known.qos + tuple(c.ext.offered_qos_profiles),
            )

    @property
    def duration_s(self) -> float:
        """Seconds from the first message to the last."""
        return (self.end_ns - self.start_ns) * 1e-9

    def select(self, patterns: Collection[str]) -> list[str]:
        """Topics of the bag that were asked for.

        Args:
            patterns: Names or shell patterns such as `/robot_a/*`; none: every topic.

        Returns:
            Topic names, sorted.

        Raises:
            BagError: A pattern fits no topic.
        """
        for pattern in patterns:
            if not matching(self.topics, [pattern]):
                raise BagError(f"{self.path}: no topic {pattern}. It has: {', '.join(self.topics)}")
        return matching(self.topics, patterns)

    def messages(
        self,
        topics: Collection[str] = (),
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Messages in the order of their bag time.

        Args:
            topics: Names or shell patterns of the topics to read; none: every topic.
            start_ns: From this bag time on; None: from the beginning.
            stop_ns: Before this bag time; None: to the end.

        Yields:
            The messages, undecoded.

        Raises:
            BagError: The bag has no such topic, or is truncated or damaged.
        """
        chosen = set(self.select(topics))
        connections = [c for c in self._connections if c.topic in chosen]
        source = self._reader.messages(connections, start_ns, stop_ns)
        count = 0
        data: Any
        while True:
            try:
                connection, time_ns, data = next(source)
            except StopIteration:
                break
            except BagError:
                raise
            except Exception as err:
                raise _damaged(self.path, err) from err
            if not (isinstance(data, bytes) and isinstance(time_ns, int)):
                raise _damaged(self.path, f"a message on {connection.topic} is no message")
            count += 1
            yield RawMessage(connection.topic, connection.msgtype, time_ns, data)
        if start_ns is not None or stop_ns is not None:
            return
        # Some damage makes the library read less than there is, and say nothing.
        if sum(c.msgcount for c in self._connections) == self.message_count:
            expected = sum(c.msgcount for c in connections)
            if count != expected:
                raise _damaged(self.path, f"its index promises {expected} messages, {count} found")

    def decoded(self, topics: Collection[str] = ()) -> Iterator[tuple[str, int, Any]]:
        """Messages in the order of their bag time, decoded.

        Args:
            topics: Names or shell patterns of the topics to read; none: every topic.

        Yields:
            Topic, bag time in nanoseconds, and the message: an object whose attributes are the
            message's fields, arrays as NumPy arrays.

        Raises:
            BagError: As `messages` and `decode`.
        """
        for raw in self.messages(topics):
            yield raw.topic, raw.time_ns, self.decode(raw)

    def decode(self, raw: RawMessage) -> Any:
        """One message as an object, with the definition that the bag was recorded with.

        Args:
            raw: A message of this bag.

        Raises:
            BagError: The type is unknown or the bytes are no message of it.
        """
        try:
            return self.typestore.deserialize_cdr(raw.data, raw.type)
        except BagError:
            raise
        except Exception as err:
            raise BagError(
                f"{self.path}: the message on {raw.topic} at {raw.time_ns} ns is no {raw.type} "
                f"({_reason(err)}). The bag is damaged there"
            ) from err

    @cached_property
    def typestore(self) -> Typestore:
        """The types of the bag's topics, defined as the bag says; `default_typestore` where not.

        Raises:
            BagError: A type is defined neither in the bag nor among the installed packages.
        """
        own: dict[str, Any] = {}
        try:
            for c in self._connections:
                if c.msgdef.format == MessageDefinitionFormat.MSG:
                    own.update(get_types_from_msg(c.msgdef.data, c.msgtype))
                elif c.msgdef.format == MessageDefinitionFormat.IDL:
                    for text in _idl_parts(c.msgdef.data):
                        own.update(get_types_from_idl(text))
            check_definitions(own)
            types = {c.msgtype for c in self._connections}
            if not types <= own.keys():
                own = {**default_typestore().fielddefs, **own}
            store = get_typestore(Stores.EMPTY)
            store.register(own)
            require_types(store, types)
        except BagError as err:
            raise BagError(f"{self.path}: {err}") from err
        except Exception as err:
            raise _damaged(self.path, err) from err
        return store

    def type_hash(self, msgtype: str) -> str | None:
        """The hash (`RIHS01_...`) of a type's definition at the time of recording.

        Args:
            msgtype: Type name such as `sensor_msgs/msg/Image`.

        Returns:
            The hash, None if the bag has neither hash nor definition.
        """
        connections = [c for c in self._connections if c.msgtype == msgtype]
        for c in connections:
            if c.digest.startswith("RIHS"):
                return c.digest
        if all(c.msgdef.format == MessageDefinitionFormat.NONE for c in connections):
            return None
        try:
            return self.typestore.hash_rihs01(msgtype)
        except KeyError:  # the library cannot hash wide strings
            return None

    def close(self) -> None:
        """Close the files."""
        if self._reader.is_open:
            self._reader.close()

    def __enter__(self) -> BagReader:
        """Return the open bag."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the files."""
        self.close()


def _check_is_bag(path: Path) -> None:
    """Raise if what lies at a path can be no bag, with the reason a person can act on."""
    if path.suffix == ".part" and path.is_dir():
        raise BagError(_unfinished(path.with_suffix("")))
    if not path.exists():
        if part_of(path).is_dir():
            raise BagError(_unfinished(path))
        raise BagError(f"{path}: there is no such bag")
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            try:
                load_yaml(path / "metadata.yaml")  # no aliases, which may stand for any amount
            except ConfigError as err:
                raise _damaged(path, err) from err
            for file in path.glob("*.db3"):
                _check_is_whole(file)
            return
        files = sorted(f.name for f in path.iterdir() if f.suffix in (".mcap", ".db3"))
        if files:
            raise BagError(
                f"{path}: the folder has no metadata.yaml. Open {path / files[0]} itself, or "
                "write one with `ros2 bag reindex`"
            )
        raise BagError(f"{path}: the folder is no bag, it has no metadata.yaml")
    if path.suffix == ".bag":
        raise BagError(f"{path}: a bag of ROS 1. Convert it with `rosbags-convert`")
    if path.suffix not in (".mcap", ".db3"):
        raise BagError(f"{path}: not a bag. Give a folder with metadata.yaml, a .mcap or a .db3")
    if path.stat().st_size == 0:
        raise BagError(f"{path}: the file is empty. Record it again")
    if path.suffix == ".db3":
        _check_is_whole(path)


def _check_is_whole(file: Path) -> None:
    """Raise if an SQLite file is shorter than its header says: SQLite reads zeros there."""
    with file.open("rb") as stream:
        header = stream.read(100)
    if header.startswith(b"SQLite format 3") and header[24:28] == header[92:96]:
        page = int.from_bytes(header[16:18], "big")
        expected = int.from_bytes(header[28:32], "big") * (65536 if page == 1 else page)
        if file.stat().st_size < expected:
            raise _damaged(file, f"{file.stat().st_size} of {expected} bytes")


def _idl_parts(text: str) -> list[str]:
    """The files that a definition in IDL is put together from."""
    separator = "=" * 80 + "\n"
    if not text.startswith(separator):
        return [text]
    return [part.split("\n", 1)[1] for part in text.split(separator)[1:]]


def _damaged(path: Path, reason: BaseException | str) -> BagError:
    """The error for a bag that cannot be read (to the end)."""
    if isinstance(reason, PermissionError):
        return BagError(f"{path}: no permission to read it")
    if isinstance(reason, BaseException):
        reason = _reason(reason)
    if path.is_dir():
        remedy = "open the data file in it alone, it may be whole"
    elif path.suffix == ".db3":
        remedy = f"save what can be saved with `sqlite3 {path} .recover`"
    else:
        remedy = "save what can be saved with `mcap recover`"
    return BagError(
        f"{path}: the bag is truncated or damaged ({reason}). Copy it again; if that is all there "
        f"is of it, {remedy}"
    )


def _reason(err: BaseException) -> str:
    """What an error of another library says, on one line."""
    text = " ".join(str(err).split()).rstrip(".")
    if len(text) < 10:
        text = f"{type(err).__name__} {text}".strip()
    return text if len(text) <= 150 else f"{text[:150]}..."


# -------------------------------------------------------------------------------------- writing


def part_of(path: Path) -> Path:
    """Where a bag lies while it is written."""
    return path.with_name(path.name + ".part")


def lock(part: Path) -> int:
    """Claim a bag that is being written, for as long as this process lives.

    Args:
        part: As `part_of` says.

    Returns:
        A file descriptor, which gives it up when it is closed.

    Raises:
        BagError: Another process writes it.
    """
    held = os.open(part, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(held)
        raise BagError(f"{part}: is being written at the moment. End the recorder first") from None
    return held


def _unfinished(path: Path) -> str:
    """What to say of a bag that was never closed."""
    return (
        f"{path}: this bag is still being written, or its recorder was killed; what there is lies "
        f"in {part_of(path)}. If it was killed, make a bag of that with "
        f"`mrs record --recover {shlex.quote(str(path))}`"
    )


class BagWriter:
    """A bag (mcap) that is being written; use it as a context manager.

    The bag appears under its name when it is closed: what is there is complete. Until then it
    lies beside it in `<name>.part`. An exception inside the `with` block removes it; what a process
    leaves that is killed, up to its last `flush`, becomes a bag with `recovery.recover`.

    Attributes:
        path: Where the bag will be.
        counts: Number of messages written so far, by topic.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Begin a bag.

        Args:
            path: `NAME.mcap` for one file, any other name for a folder with `metadata.yaml`.

        Raises:
            BagError: It exists already or cannot be written.
        """
        self.path = Path(path)
        self._part = part_of(self.path)
        self.counts: dict[str, int] = {}
        self._connections: dict[str, Connection] = {}
        if self.path.suffix in (".db3", ".bag"):
            raise BagError(f"{self.path}: only mcap is written. Name it {self.path.stem}.mcap")
        if self.path.exists():
            raise BagError(f"{self.path}: exists already. Give another name, or remove it first")
        if self._part.exists():
            raise BagError(
                f"{self._part}: exists already. {_unfinished(self.path)}; or remove it, or give "
                "another name"
            )
        # The library makes NAME/NAME.mcap and writes that name into both files.
        name = self.path.stem if self.path.suffix == ".mcap" else self.path.name
        self._writer = CheckedWriter(
            self._part / name, version=9, storage_plugin=StoragePlugin.MCAP
        )
        try:
            self._writer.open()
            self._held = lock(self._part)
        except OSError as err:
            raise self._failed(err) from err

    def add_topic(
        self,
        name: str,
        msgtype: str,
        qos: Sequence[Qos] = (),
        typestore: Typestore | None = None,
    ) -> None:
        """Announce a topic; once per topic, before its first `write_raw`.

        Args:
            name: Full topic name.
            msgtype: Type name such as `sensor_msgs/msg/Image`.
            qos: What the publishers offer.
            typestore: Where the definition is; `default_typestore()` if None.

        Raises:
            BagError: The topic was announced before, or the type is unknown.
        """
        if name in self._connections:
            raise BagError(f"{self.path}: topic {name} was announced before")
        store = typestore or default_typestore()
        require_types(store, [msgtype])
        self._connections[name] = self._writer.add_connection(
            name, msgtype, typestore=store, offered_qos_profiles=qos
        )
        self.counts[name] = 0

    def write_raw(self, topic: str, time_ns: int, data: bytes | memoryview) -> None:
        """Write one message that is already in CDR.

        Args:
            topic: A topic that was announced.
            time_ns: Bag time, nanoseconds since 1970.
            data: The message in CDR, encapsulation header included.

        Raises:
            BagError: The topic was not announced, or the disk does not take it.
        """
        if topic not in self._connections:
            raise BagError(f"{self.path}: topic {topic} was not announced with add_topic")
        try:
            self._writer.write(self._connections[topic], time_ns, data)
        except OSError as err:
            raise self._failed(err) from err
        self.counts[topic] += 1

    def write(
        self, topic: str, time_ns: int, message: Any, typestore: Typestore | None = None
    ) -> None:
        """Write one message; a new topic is announced by it.

        Args:
            topic: Full topic name.
            time_ns: Bag time, nanoseconds since 1970.
            message: A message of the typestore's classes, as `BagReader.decode` gives them.
            typestore: Where the definition is; `default_typestore()` if None.

        Raises:
            BagError: It is no such message, is of another type than the topic, or the disk does
                not take it.
        """
        msgtype = getattr(message, "__msgtype__", None)
        if msgtype is None:
            raise BagError(
                f"{self.path}: {type(message).__name__} on {topic} is no message of a typestore"
            )
        if topic not in self._connections:
            self.add_topic(topic, msgtype, typestore=typestore)
        if msgtype != self._connections[topic].msgtype:
            raise BagError(
                f"{self.path}: topic {topic} is {self._connections[topic].msgtype}, not {msgtype}"
            )
        try:
            data = (typestore or default_typestore()).serialize_cdr(message, msgtype)
        except Exception as err:
            raise BagError(
                f"{self.path}: the {msgtype} for {topic} has a bad value ({_reason(err)})"
            ) from err
        self.write_raw(topic, time_ns, data)

    def flush(self) -> None:
        """Hand all messages so far to the system: they outlive this process, however it ends.

        Raises:
            BagError: The disk does not take it.
        """
        storage: Any = self._writer.storage
        try:
            if storage.chunk.msgs:
                storage.close_chunk()
            storage.bio.flush()
        except OSError as err:
            raise self._failed(err) from err

    def close(self) -> None:
        """Write the index and put the bag in its place.

        Raises:
            BagError: The disk does not take it, or something else took its place meanwhile.
        """
        try:
            self._writer.close()
            if self.path.exists():
                raise BagError(f"{self.path}: exists by now. This bag was left in {self._part}")
            bag = self._writer.path
            if self.path.suffix == ".mcap":
                (bag / f"{bag.name}.mcap").rename(self.path)
            else:
                bag.rename(self.path)
            shutil.rmtree(self._part)
        except OSError as err:
            raise self._failed(err) from err
        finally:
            os.close(self._held)

    def abort(self) -> None:
        """Drop the bag: nothing of it stays."""
        self._writer.abort()
        shutil.rmtree(self._part, ignore_errors=True)
        os.close(self._held)

    def _failed(self, err: OSError) -> BagError:
        rest = f". What there is lies in {self._part}" if self._part.exists() else ""
        return BagError(f"{self.path}: cannot be written ({err.strerror or err}){rest}")

    def __enter__(self) -> BagWriter:
        """Return the open bag."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag, or drop it if there was an exception."""
        if kind is None:
            self.close()
        else:
            self.abort()
