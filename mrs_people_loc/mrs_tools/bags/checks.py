"""What `bags` does beyond `rosbags`: checksums of mcap files, and bounds on what they grow to.

`rosbags` compares a chunk with its checksum when it reads the chunk, but writes none, and
decompresses however much comes out. Its readers and writers are extended here where it provides
for that, at `STORAGE_PLUGINS`. The layout of mcap is that of https://mcap.dev/spec.
"""

from __future__ import annotations

import os
import struct
import sys
import zlib
from collections.abc import Collection, Generator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError, StoragePlugin, Writer
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import McapReader, McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

from mrs_people_loc.errors import BagError

#: Greatest chunk or message, decompressed [bytes]. A colour image of 4096x4096 px has 48 MiB.
MAX_BYTES = 64 << 20
#: A file that is compressed as a whole may grow by this factor, or to `MAX_BYTES`.
MAX_GROWTH = 100

_MAGIC = b"\x89MCAP0\r\n"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_FOOTER, _CHUNK, _CHUNK_INDEX, _DATA_END = 0x02, 0x06, 0x08, 0x0F
_BLOCK = 1 << 20


# -------------------------------------------------------------------------------------- files


class CheckedMcap(McapReader):
    """An mcap file that is checked before it is read."""

    def open(self) -> None:
        """Open the file."""
        check_mcap(Path(str(self.path)))
        super().open()


class CheckedFolder(DirectoryReader):
    """A folder with `metadata.yaml` that is checked before it is read."""

    STORAGE_PLUGINS: Mapping[str, Any] = {"mcap": CheckedMcap, "sqlite3": Sqlite3Reader}

    def open(self) -> None:
        """Open the folder, and its files."""
        for file in Path(str(self.path)).iterdir():
            if file.is_file() and os.access(file, os.R_OK):
                _check_growth_of_file(file)
        super().open()
        self._each_compressed = self.metadata.compression_mode == "message"
        self.metadata = self.metadata._replace(compression_mode=None)  # of messages, see below

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """The messages; those that are compressed one by one are decompressed within bounds."""
        for connection, time_ns, data in super().messages(connections, start, stop):
            if self._each_compressed:
                data = _decompressed(data, f"{self.path}: a message on {connection.topic}")
            yield connection, time_ns, data


class CheckedReader(Reader):
    """A bag that is checked before it is read."""

    STORAGE_PLUGINS: Mapping[str, Any] = {
        "dir": CheckedFolder,
        ".mcap": CheckedMcap,
        ".db3": Sqlite3Reader,
    }


def check_mcap(path: Path) -> None:
    """Walk over the records of an mcap file.

    The index, and messages outside chunks, are compared with their checksums. Chunks are when they
    are read; here is looked at whether they have any, and what they grow to.

    Args:
        path: The file.

    Raises:
        BagError: A chunk is too large.
        ReaderError: The file is truncated or damaged.
    """
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ReaderError("it does not begin as mcap does")
        try:
            _walk(path, file, os.fstat(file.fileno()).st_size)
        except struct.error:
            raise ReaderError(f"a record before byte {file.tell()} is cut short") from None


class _Chunk(NamedTuple):
    """What a chunk and its entry in the index say alike."""

    compression: bytes
    compressed: int
    uncompressed: int


def _walk(path: Path, file: BinaryIO, size: int) -> None:
    chunks: dict[int, _Chunk] = {}
    indexed: dict[int, _Chunk] = {}
    have_checksum: set[bool] = set()
    opcode = 0
    while opcode != _FOOTER:
        at = file.tell()
        opcode, length = _numbers(file, "<BQ")
        end = at + 9 + length
        if opcode == 0 or end > size:
            raise ReaderError(f"there is no record at byte {at}")
        if opcode == _CHUNK:
            chunks[at], has_checksum = _read_chunk(file, end, f"{path}: the chunk at byte {at}")
            have_checksum.add(has_checksum)
        elif opcode == _CHUNK_INDEX:
            _, _, start, _ = _numbers(file, "<QQQQ")
            _string(file, end)  # where its messages are
            _numbers(file, "<Q")
            indexed[start] = _Chunk(_string(file, end), *_numbers(file, "<QQ"))
        elif opcode == _DATA_END and not chunks:
            (expected,) = _numbers(file, "<I")
            _compare(file, 0, at, expected, "messages do")
        elif opcode == _FOOTER:
            summary, _, expected = _numbers(file, "<QQI")
            _compare(file, summary, at + 25, expected if summary else 0, "index does")
        file.seek(end)
    if indexed and indexed != chunks:
        raise ReaderError("its index does not fit its chunks")
    if len(have_checksum) > 1:
        raise ReaderError("some of its chunks have lost their checksums")


def _read_chunk(file: BinaryIO, end: int, what: str) -> tuple[_Chunk, bool]:
    """A chunk whose size was checked, and whether it has a checksum."""
    _, _, uncompressed, checksum = _numbers(file, "<QQQI")
    compression, (compressed,) = _string(file, end), _numbers(file, "<Q")
    chunk = _Chunk(compression, compressed, uncompressed)
    if file.tell() + compressed != end:
        raise ReaderError(f"{what} is not as long as its record")
    _check_growth(file, chunk, what)
    return chunk, checksum != 0


def _compare(file: BinaryIO, start: int, end: int, expected: int, what: str) -> None:
    """Raise if a part of a file differs from its checksum; 0: it has none."""
    if expected and _checksum(file, start, end) != expected:
        raise ReaderError(f"its {what} not fit the checksum")


def _numbers(file: BinaryIO, layout: str) -> tuple[int, ...]:
    return struct.unpack(layout, file.read(struct.calcsize(layout)))


def _string(file: BinaryIO, end: int) -> bytes:
    (length,) = _numbers(file, "<I")
    return file.read(min(length, end - file.tell()))


def _checksum(file: BinaryIO, start: int, end: int) -> int:
    """CRC-32 of a part of a file."""
    file.seek(start)
    checksum = 0
    while start < end:
        block = file.read(min(_BLOCK, end - start))
        if not block:
            break
        checksum = zlib.crc32(block, checksum)
        start += len(block)
    return checksum


# -------------------------------------------------------------------------------- compression


def _check_growth(file: BinaryIO, chunk: _Chunk, what: str) -> None:
    """Raise if a chunk, at whose data the file is, has more than `MAX_BYTES` or than it says."""
    grown: int | None
    if not chunk.compression:
        grown = chunk.compressed
    elif chunk.uncompressed > MAX_BYTES:
        raise BagError(f"{what} grows to {chunk.uncompressed} bytes; allowed: {MAX_BYTES}")
    else:
        data, grown = file.read(chunk.compressed), None
        try:
            if chunk.compression == b"zstd" and zstd.get_frame_size(data) == len(data):
                grown = zstd.get_frame_info(data).decompressed_size
            if grown is None:
                grown = _grown(data, chunk)
        except (zstd.ZstdError, RuntimeError, EOFError) as err:
            raise ReaderError(f"{what}: {err}") from err
    if grown != chunk.uncompressed:
        raise ReaderError(f"a chunk says that it has {chunk.uncompressed} bytes, but has others")


def _grown(data: bytes, chunk: _Chunk) -> int:
    """What one frame grows to, or anything above what its chunk says [bytes]."""
    if chunk.compression == b"zstd":
        frame: Any = zstd.ZstdDecompressor()
    elif chunk.compression == b"lz4":
        frame = lz4.frame.LZ4FrameDecompressor()
    else:
        raise ReaderError(f"compression is {chunk.compression!r}; wanted: zstd, lz4 or none")
    size = len(frame.decompress(data, _BLOCK))
    while not frame.eof and not frame.needs_input and size <= chunk.uncompressed:
        size += len(frame.decompress(b"", _BLOCK))
    return size if not frame.unused_data else -1


def _decompressed(data: bytes, what: str) -> bytes:
    """A message that was compressed by itself."""
    frame = zstd.ZstdDecompressor()
    message = frame.decompress(data, MAX_BYTES + 1)
    if len(message) > MAX_BYTES:
        raise BagError(f"{what} grows to more than {MAX_BYTES} bytes, which are allowed")
    if not frame.eof or frame.unused_data:
        raise ReaderError(f"{what} is cut short")
    return message


def _check_growth_of_file(path: Path) -> None:
    """Raise if a file that is compressed as a whole would fill the disk."""
    with path.open("rb") as file:
        if file.read(4) != _ZSTD_MAGIC:
            return
    allowed = max(MAX_BYTES, MAX_GROWTH * path.stat().st_size)
    size = 0
    with zstd.open(path) as file:
        while block := file.read(_BLOCK):
            size += len(block)
            if size > allowed:
                raise BagError(f"{path}: grows to more than {allowed} bytes, which are allowed")


# ------------------------------------------------------------------------------------- writing


class McapWriterWithChecksums(McapWriter):
    """Writes the checksums of chunks and of the index, too; as 0 they would say "not known"."""

    def close_chunk(self) -> None:
        """Write the chunk, its checksum, and where its messages are."""
        checksum = zlib.crc32(self.chunk.bio.getbuffer())
        at = self.bio.tell()
        super().close_chunk()
        end = self.bio.tell()
        self.bio.seek(at + 9 + struct.calcsize("<QQQ"))
        self.bio.write(struct.pack("<I", checksum))
        self.bio.seek(end)

    def close(self, version: int, metadata: str) -> None:
        """Write the index and its checksum."""
        super().close(version, metadata)
        with self.path.open("r+b") as file:
            file.seek(-len(_MAGIC) - 29, os.SEEK_END)
            at = file.tell()
            _, _, summary = _numbers(file, "<BQQ")
            checksum = _checksum(file, summary, at + 25)
            file.seek(at + 25)
            file.write(struct.pack("<I", checksum))


class CheckedWriter(Writer):
    """A bag whose mcap file has checksums."""

    STORAGE_PLUGINS: Mapping[StoragePlugin, Any] = {StoragePlugin.MCAP: McapWriterWithChecksums}
