"""Writes bags (mcap), with checksums of messages and index.

with BagWriter("out.mcap") as out:
out.write("/chatter", time_ns, String("hello"))     # a message of `default_typestore()`
"""

from __future__ import annotations

import fcntl
import os
import shlex
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys.store import Typestore

from mrs_people_loc.errors import BagError
from mrs_ros.closing import Closing
from mrs_tools.bags.checks import CheckedWriter
from mrs_tools.bags.message_types import default_typestore, reason, require_types


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


def unfinished(path: Path) -> str:
    """What to say of a bag that was never closed."""
    return (
        f"{path}: this bag is still being written, or its recorder was killed; what there is lies "
        f"in {part_of(path)}. If it was killed, make a bag of that with "
        f"`mrs record --recover {shlex.quote(str(path))}`"
    )


class BagWriter(Closing):
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
                f"{self._part}: exists already. {unfinished(self.path)}; or remove it, or give "
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
                f"{self.path}: the {msgtype} for {topic} has a bad value ({reason(err)})"
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

    def __exit__(self, kind: object, *_: object) -> None:
        """Close the bag, or drop it if there was an exception."""
        if kind is None:
            self.close()
        else:
            self.abort()
