"""Recordings that are cut, or claim what no recorder writes."""

import bz2
import shutil
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import lz4.frame
import numpy as np
import pytest
import zstandard

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags import recording
from sonarmap.tools.files.readers.bags.recording import Unpacker
from sonarmap.tools.files.readers.clouds import rows as bounds
from sonarmap.tools.files.readers.scans import read_scans, read_survey
from tests.samples.bags.messages import CLOUD, cloud
from tests.samples.bags.samples import recordings
from tests.samples.bags.writers import write_mcap, write_ros1, write_ros2
from tests.samples.cloud_files import put
from tests.samples.damage.damaged_files import damage
from tests.samples.damage.navigation_files import NAVIGATION_FILES
from tests.samples.damage.pose_files import read_as_odometry
from tests.samples.processor_time import quick, thrifty
from tests.samples.refusals import refuses

ZEROS = bytes(3 << 20)
PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstandard.ZstdCompressor().compress,
}  # fmt: skip


@pytest.mark.parametrize(("count", "seed"), [(500, 3), pytest.param(5_000, 4, marks=pytest.mark.slow)])
def test_damaged_recordings_of_navigation_are_refused_or_harmless(tmp_path: Path, count: int, seed: int) -> None:
    files = {kind: file for kind, file in NAVIGATION_FILES.items() if kind.endswith("of navigation")}
    outcome = damage(tmp_path, count // len(files) + 1, seed, files)
    assert outcome.faults == []
    assert all(ends["refused"] and ends["read"] for ends in outcome.ends.values())
    assert outcome.longest[0] < 5
    assert outcome.largest[0] < 300e6


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kind", ["mcap plain", "mcap lz4", "mcap zstd"])
def test_a_cut_mcap_file_is_read_up_to_the_cut(tmp_path: Path, kind: str) -> None:
    """As it is where a vehicle loses its power: what is there is right, and a note tells where it ends."""
    suffix, content = recordings()[kind]
    path = put(tmp_path / f"dive{suffix}", content)
    whole = read_scans([path]).scans
    counts = set()
    for kept in range(0, len(content), 83):
        path.write_bytes(content[:kept])
        read = read_survey([path])
        counts.add(len(read.scans))
        assert read.unread or any("cut or damaged" in note for note in read.notes)
        for scan, expected in zip(read.scans, whole, strict=False):
            np.testing.assert_array_equal(scan.points, expected.points)
            assert scan.stamp == expected.stamp
    assert counts == ({0, 1, 2, 3} if kind == "mcap zstd" else {0, 3})  # its chunks are small


@pytest.mark.parametrize("kind", ["bag", "bag bz2", "bag lz4"])
def test_a_cut_ros_1_bag_is_refused(tmp_path: Path, kind: str) -> None:
    suffix, content = recordings()[kind]
    path = tmp_path / f"dive{suffix}"
    for kept in range(0, len(content), 211):
        path.write_bytes(content[:kept])
        refuses(r"dive\.bag: (its index cannot be read; `rosbag|the file is empty|it is)", read_scans, [path])


def test_a_damaged_chunk_leaves_a_gap(tmp_path: Path) -> None:
    suffix, content = recordings()["mcap zstd"]
    changed = bytearray(content)
    start = content.index(recording.ZSTD_START, content.index(recording.ZSTD_START) + 4)
    changed[start + 60] ^= 255
    (tmp_path / f"dive{suffix}").write_bytes(changed)
    (note,) = [note for note in read_survey([tmp_path]).notes if "cannot be unpacked" in note]
    assert "the messages in it are missing" in note
    assert [scan.stamp for scan in read_survey([tmp_path]).scans] == [1.125, 2.125]


@pytest.mark.parametrize("compression", PACKERS)
def test_chunks_unpack_to_a_limit(monkeypatch: pytest.MonkeyPatch, compression: str) -> None:
    refuses("its compression is 'brotli'; wanted bz2, lz4 or zstd", Unpacker(0), b"", "brotli")
    packed = PACKERS[compression](ZEROS)
    unpacked = Unpacker(len(packed))
    assert unpacked(packed, compression) == ZEROS
    monkeypatch.setattr(recording, "LARGEST", len(ZEROS))
    assert unpacked(packed, compression) == ZEROS
    monkeypatch.setattr(recording, "_ALL", 1)
    refuses(r"its [\d,]+ bytes unpack to more than 6,291,456, which no recorder writes", unpacked, packed, compression)
    monkeypatch.setattr(recording, "LARGEST", len(ZEROS) - 1)
    with thrifty(), pytest.raises(InputError, match=rf"{compression} unpacks to more than 3,145,727"):
        Unpacker(len(packed))(packed, compression)


def test_compression_bombs_in_recordings_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clouds of one point that shrink to nothing: read as they are, and refused where the limit is lower."""
    zeros = np.zeros((40_000, 4), np.float32)
    zeros[:, 0] = 1
    records = [("/p", CLOUD, 1.0, cloud(zeros))]
    paths = [
        write_mcap(tmp_path / "a.mcap", records),
        write_ros1(tmp_path / "b.bag", records, "bz2"),
        write_ros1(tmp_path / "c.bag", records, "lz4"),
        write_ros2(tmp_path / "d", records, compression="message"),
    ]
    assert [len(read_scans([path]).scans[0].points) for path in paths] == [40_000] * 4
    monkeypatch.setattr(recording, "LARGEST", 100_000)
    for path in paths:
        refuses("unpacks to more than 100,000", read_scans, [path])
    packed = write_ros2(tmp_path / "e", records, compression="file")
    assert len(read_scans([packed]).scans[0].points) == 40_000
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=400_000))
    refuses(r"e: e\.db3\.zstd: the bag unpacks to more than the 360,000 bytes", read_scans, [packed])
    monkeypatch.setattr(bounds, "_SMALL", 100_000)
    monkeypatch.setattr(bounds, "_RATIO", 1)
    refuses(r"e: e\.db3\.zstd: the bag unpacks to more than [\d,]+ bytes, which no", read_scans, [packed])


EMPTY_RECORD = b"\x08" + bytes(8)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("piece", "count", "words"),
    [
        (bytes(1 << 20), 500, "zstd unpacks to more than 67,108,864 bytes, which no recorder writes"),
        (EMPTY_RECORD, 2_000_000, "it holds more than the 131,072 records that may still come, which is not"),
    ],
    ids=["zeros", "records"],
)
def test_a_bomb_in_a_chunk_is_refused_with_little_memory(tmp_path: Path, piece: bytes, count: int, words: str) -> None:
    path = put(tmp_path / "a.mcap", recordings()["mcap plain"][1][:8] + packed_chunk(piece, count))
    assert path.stat().st_size < 20_000
    with thrifty(), pytest.raises(InputError, match=words):
        read_scans([path])


EMPTY_ROWS = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format, offered_qos_profiles);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data);
INSERT INTO topics VALUES(1, '/p', 'sensor_msgs/msg/PointCloud2', 'cdr', '');
INSERT INTO messages WITH n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n WHERE k < 200000) SELECT k, 1, 1, x'' FROM n;
"""


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("kind", "count", "words"),
    [
        ("mcap", 9, r"x\d\.mcap\.zstd: the bag unpacks to more than 67,108,864 bytes, which no recorder writes"),
        ("mcap", 1, r"x0\.mcap\.zstd: it has too many records before byte [\d,]+, which is not believable"),
        ("db3", 1, r"x0\.db3\.zstd: it has more than 131,072 messages, which is not believable"),
    ],
    ids=["files", "records", "rows"],
)
def test_a_bomb_in_a_bag_is_refused_quickly(tmp_path: Path, kind: str, count: int, words: str) -> None:
    """Of records without content, of many files, of rows without content."""
    if kind == "db3":
        with closing(sqlite3.connect(tmp_path / "x.db3")) as database:
            database.executescript(EMPTY_ROWS)
        plain = (tmp_path / "x.db3").read_bytes()
    else:
        magic = recordings()["mcap plain"][1][:8]
        other = struct.pack("<BQ", 0x80, 16 << 20) + bytes(16 << 20)  # of a kind that MCAP leaves to others
        plain = magic + bytes(9 << 20) if count == 1 else recordings()["mcap plain"][1][:-8] + other
    bag = tmp_path / "bag"
    bag.mkdir()
    for k in range(count):
        (bag / f"x{k}.{kind}.zstd").write_bytes(zstandard.ZstdCompressor().compress(plain))
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    with quick(), pytest.raises(InputError, match=words):
        read_scans([bag])


def packed_chunk(piece: bytes, count: int) -> bytes:
    packed = zstandard.ZstdCompressor().compress(piece * count)
    head = struct.pack("<QQQII", 0, 0, len(piece) * count, 0, 4) + b"zstd" + struct.pack("<Q", len(packed))
    return struct.pack("<BQ", 6, len(head) + len(packed)) + head + packed


@pytest.mark.parametrize("table", ["messages", "topics"])
def test_generated_columns_of_sqlite_are_refused(tmp_path: Path, table: str) -> None:
    """Of 900 MB in each row, which the file need not hold."""
    path = put(tmp_path / "a.db3", recordings()["db3"][1])
    with closing(sqlite3.connect(path)) as database:
        column = "data" if table == "messages" else "type"
        database.execute(f"ALTER TABLE {table} RENAME COLUMN {column} TO other")
        database.execute(f"ALTER TABLE {table} ADD COLUMN {column} AS (zeroblob(900000000))")
        database.commit()
    with thrifty(), pytest.raises(InputError, match=f"its table {table} has a generated column, which no rec"):
        read_scans([path])


@pytest.mark.parametrize("length", [2**31, 2**64 - 1])
@pytest.mark.parametrize("opcode", [1, 6, 0x7F])
def test_mcap_records_of_impossible_length_are_refused(tmp_path: Path, opcode: int, length: int) -> None:
    """At the first record, and at the first chunk's content."""
    content = recordings()["mcap plain"][1]
    path, chunk = tmp_path / "a.mcap", content.index(b"\x06", 8 + 9)
    for damaged in (
        content[:8] + struct.pack("<BQ", opcode, length) + content[17:],
        content[: chunk + 9 + 32] + struct.pack("<Q", length) + content[chunk + 9 + 40 :],
    ):
        path.write_bytes(damaged)
        with thrifty(), pytest.raises(InputError):
            read_scans([path])


TIMES = [0.125, 1.125, 2.125]


@pytest.mark.parametrize("kind", ["bag", "bag lz4"])
def test_ros_1_records_of_impossible_length_are_refused(tmp_path: Path, kind: str) -> None:
    """Of the first record's head, and of one in the index."""
    content, claim = recordings()[kind][1], struct.pack("<I", 2**32 - 1)
    for at in (13, content.rindex(b"conn=") - 8):
        path = put(tmp_path / "a.bag", content[:at] + claim + content[at + 4 :])
        with thrifty():
            refuses(r"a\.bag: its index cannot be read; `rosbag reindex` makes another", read_as_odometry, path)


@pytest.mark.parametrize("kind", ["mcap plain", "mcap zstd"])
def test_mcap_texts_of_impossible_length_are_refused_or_ignored(tmp_path: Path, kind: str) -> None:
    """In the first record and in the summary, whose records are of the right lengths: what the index says is left."""
    content, text = recordings()[kind][1], struct.pack("<I", 2**32 - 1)
    path = put(tmp_path / "a.mcap", content[:17] + text + content[21:])
    with thrifty(), pytest.raises(InputError, match="it claims 4,294,967,295 of"):
        read_scans([path])
    name = content.rindex(struct.pack("<I", len(CLOUD)) + CLOUD.encode())
    path.write_bytes(content[:name] + text + content[name + 4 :])
    with thrifty():
        assert [scan.stamp for scan in read_scans([path]).scans] == TIMES
