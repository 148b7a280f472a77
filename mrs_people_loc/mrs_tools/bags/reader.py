"""Reads bags: every failure is a `BagError` that names the file, what is wrong and what to do.

    with BagReader("bags/paper_formation") as bag:
        for topic, time_ns, message in bag.decoded(["/robot_a/odom"]):
            ...

A bag is a folder with `metadata.yaml`, as `ros2 bag` makes it, or one `.mcap` or `.db3` file.
Where it has checksums, they are compared, so damage to a bag of ours never passes for data. SQLite
bags (`.db3`) have none: there it is noticed where SQLite's own structure, or a message's, is
broken, and a changed pixel is not.
"""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mrs_people_loc.config import load_yaml
from mrs_people_loc.errors import BagError, ConfigError
from mrs_ros.closing import Closing
from mrs_tools.bags.checks import CheckedReader
from mrs_tools.bags.message_types import (
    check_definitions,
    default_typestore,
    reason,
    require_types,
)
from mrs_tools.bags.writer import part_of, unfinished


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


class BagReader(Closing):
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
                f"({reason(err)}). The bag is damaged there"
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


def _check_is_bag(path: Path) -> None:
    """Raise if what lies at a path can be no bag, with the reason a person can act on."""
    if path.suffix == ".part" and path.is_dir():
        raise BagError(unfinished(path.with_suffix("")))
    if part_of(path).is_dir() and not path.exists():
        raise BagError(unfinished(path))
    if not path.exists():
        raise BagError(f"{path}: there is no such bag")
    if path.is_dir():
        _check_folder(path)
    elif path.suffix == ".bag":
        raise BagError(f"{path}: a bag of ROS 1. Convert it with `rosbags-convert`")
    elif path.suffix not in (".mcap", ".db3"):
        raise BagError(f"{path}: not a bag. Give a folder with metadata.yaml, a .mcap or a .db3")
    elif path.stat().st_size == 0:
        raise BagError(f"{path}: the file is empty. Record it again")
    elif path.suffix == ".db3":
        _check_is_whole(path)


def _check_folder(path: Path) -> None:
    if not (path / "metadata.yaml").exists():
        files = sorted(f.name for f in path.iterdir() if f.suffix in (".mcap", ".db3"))
        if not files:
            raise BagError(f"{path}: the folder is no bag, it has no metadata.yaml")
        raise BagError(
            f"{path}: the folder has no metadata.yaml. Open {path / files[0]} itself, or "
            "write one with `ros2 bag reindex`"
        )
    try:
        load_yaml(path / "metadata.yaml")  # no aliases, which may stand for any amount
    except ConfigError as err:
        raise _damaged(path, err) from err
    for file in path.glob("*.db3"):
        _check_is_whole(file)


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


def _damaged(path: Path, why: BaseException | str) -> BagError:
    """The error for a bag that cannot be read (to the end)."""
    if isinstance(why, PermissionError):
        return BagError(f"{path}: no permission to read it")
    if isinstance(why, BaseException):
        why = reason(why)
    if path.is_dir():
        remedy = "open the data file in it alone, it may be whole"
    elif path.suffix == ".db3":
        remedy = f"save what can be saved with `sqlite3 {path} .recover`"
    else:
        remedy = "save what can be saved with `mcap recover`"
    return BagError(
        f"{path}: the bag is truncated or damaged ({why}). Copy it again; if that is all there "
        f"is of it, {remedy}"
    )
