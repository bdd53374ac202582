"""Headers and numbers that ask for the impossible: a reason in words, no warning, and next to no memory."""

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import lzf
import numpy as np
import pytest
import snappy
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import available_memory, require_memory
from sonarmap.tools.files.readers.g2o import read_g2o
from sonarmap.tools.files.readers.scans import read_scan, read_survey
from sonarmap.tools.files.user_file import read_json
from tests.samples.cloud_files import npz, put
from tests.samples.clutter_scans import plane, refused_with_reason, said, sonarmap, write
from tests.samples.damage.pose_files import POSE_FILES, numbers_in
from tests.samples.processor_time import thrifty
from tests.samples.recordings import range_image
from tests.samples.refusals import refuses


def pcd(count: str = "1", width: str = "0", encoding: str = "binary", more: int = 1) -> bytes:
    """No points, with `more` fields after x, y, z of `count` numbers each."""
    names, fours, floats, counts = (" ".join([field] * more) for field in ("n", "4", "F", count))
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z {names}\nSIZE 4 4 4 {fours}\nTYPE F F F {floats}\n"
        f"COUNT 1 1 1 {counts}\nWIDTH {width}\nHEIGHT {width}\nDATA {encoding}\n"
    ).encode()


def npy(shape: str) -> bytes:
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header


def ply(count: str, encoding: str = "binary_little_endian", more: str = "") -> bytes:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    return f"ply\nformat {encoding} 1.0\nelement vertex {count}\n{axes}{more}end_header\n".encode()


def packet(payload: bytes) -> bytes:
    """Of a recording, with a payload that is compressed already."""
    body = b"RIP2" + struct.pack("<I", 12 + len(payload)) + payload
    return body + struct.pack("<I", zlib.crc32(body))


def npz_of_zeros(megabytes: int, header: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", header + bytes(megabytes << 20))
    return file.getvalue()


def compressed_pcd(packed: bytes, claimed: int, width: str, more: int = 1) -> bytes:
    """A single row of points, packed; `claimed` bytes when unpacked."""
    header = pcd(width=width, encoding="binary_compressed", more=more)
    return header.replace(f"HEIGHT {width}".encode(), b"HEIGHT 1") + struct.pack("<II", len(packed), claimed) + packed


def bytes_pcd(points: int) -> bytes:
    """Zeros, a byte for each coordinate."""
    content = compressed_pcd(lzf.compress(bytes(3 * points), 3 * points), 3 * points, str(points), more=0)
    return content.replace(b"SIZE 4 4 4", b"SIZE 1 1 1", 1).replace(b"TYPE F F F", b"TYPE U U U", 1)


@pytest.fixture
def same(tmp_path: Path) -> np.ndarray:
    """Points that are all the same, also in a.pcd and b.npz."""
    points = np.full((200_000, 3), 7.5, np.float32)
    packed = lzf.compress(points.tobytes(), 2 * points.nbytes)
    (tmp_path / "a.pcd").write_bytes(compressed_pcd(packed, points.nbytes, str(len(points)), more=0))
    (tmp_path / "b.npz").write_bytes(npz(compressed=True, points=points))
    return points


LARGEST = "9" * 18
LONG = ("npz of zeros", "text of one line", "pcd 100,000 fields")
HOSTILE: dict[str, tuple[str, bytes | Callable[[], bytes], str]] = {  # large ones are made where they are wanted
    "pcd record of 1 GB": (".pcd", pcd("300000000"), "points of 1,200,000,012 bytes"),
    "pcd record, compressed": (".pcd", pcd("300000000", encoding="binary_compressed") + bytes(8), "another size"),
    "pcd 100,000 fields": (".pcd", pcd(more=100_000), "no points"),
    "pcd LZF 264 times": (".pcd", compressed_pcd(b"\0", 256, "4"), "1 bytes that claim to hold 256"),
    "npy 2^62 rows": (".npy", npy(f"({2**62}, 3)"), "the header promises"),
    "npy 70 axes": (".npy", npy("(" + "1, " * 70 + ")") + bytes(4), "wanted (N, 3)"),
    "ply 10^12 faces": (".ply", ply("0", more=f"element face {10**12}\nproperty list uchar int i\n"), "promises"),
    "sonar claims 4 GB": (".sonar", packet(b"\xff\xff\xff\xff\x0f" + bytes(99)), "claim to unpack to 4,294,967,295"),
    "sonar packet of 1 MB": (".sonar", packet(bytes(1 << 20)), "packet 1 at byte 0 claims 1,048,588 bytes"),
    "npz of zeros": (".npz", lambda: npz_of_zeros(500, npy("(1, 3)")), "save the file without compression"),
    "pcd of bytes": (".pcd", lambda: bytes_pcd(16 << 20), "16,777,216 points would make 402,653,184 bytes of 5"),
    "csv unit after blanks": (".csv", b"x" + b" " * 100_000 + b"q,y,z\n1,2,3\n", "no column x"),
    "csv 100,000 columns": (".csv", b"y," * 100_000 + b"\n1,2,3\n", "no column x"),
    "text of one line": (".xyz", b"1 " * 1_000_000 + b"\n", "1000000 columns"),
    "text of one number": (".xyz", b"9" * 1_000_000 + b" 2 3\n", "NaN or infinite"),
}  # fmt: skip


@pytest.mark.parametrize("case", [pytest.param(k, marks=pytest.mark.slow if k in LONG else ()) for k in HOSTILE])
def test_hostile_files_leave_a_gap_with_a_reason(tmp_path: Path, case: str) -> None:
    suffix, content, words = HOSTILE[case]
    if suffix == ".csv":  # beside scans of another format it would be left out with a note
        for name in "ac":
            np.savetxt(tmp_path / f"{name}.csv", plane(), delimiter=",")
    else:
        write(tmp_path, a=plane(), c=plane())
    (tmp_path / f"b{suffix}").write_bytes(content if isinstance(content, bytes) else content())
    with thrifty():
        read = read_survey([tmp_path])
    (unread,) = read.unread
    assert words in unread.reason
    assert len(unread.reason) < 1000
    assert [scan.name for scan in read.scans] == ["a", "c"]


def test_the_best_compressed_files_are_still_read(tmp_path: Path, same: np.ndarray) -> None:
    """No limit is below what the formats can do."""
    flat = range_image(1, np.full((256, 64), 100))
    (tmp_path / "c.sonar").write_bytes(rip.packb(flat))
    raw = flat.SerializeToString()
    assert len(raw) > 20 * len(snappy.compress(raw))
    counts = [len(scan.points) for scan in read_survey([tmp_path]).scans]
    assert counts == [len(same), len(same), 256 * 64]


@pytest.mark.parametrize("name", ["a.pcd", "b.npz", "c.ply"])
def test_files_larger_than_memory_are_refused_before_unpacking(
    tmp_path: Path, same: np.ndarray, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, c=same)
    assert len(read_scan(tmp_path / name).points) == len(same)
    monkeypatch.setattr("sonarmap.tools.files.memory.available_memory", lambda: 1 << 20)
    with thrifty():
        refuses(r"of 1.0 MiB to spare here; thin its points out", read_scan, tmp_path / name)


pytestmark = pytest.mark.filterwarnings("error")
HOSTILE_NUMBERS = (b"1e308", b"-1e308", b"1e200", b"-1e35", b"1e999", b"1" + b"0" * 400, b"nan", b"-inf")
QUICK = ("tum", "kitti", "priors by stamp", "priors by name", "description.json")  # which hold few numbers
TINY = (b"1e-308", b"1e-200", b"0", b"-1")
NUMBER = re.compile(rb"(?<![\w.:-])-?\d+(\.\d+)?(?![\w.])")


def with_numbers(path: Path, content: bytes, numbers: tuple[bytes, ...]) -> Iterator[bytes]:
    """Each number of a file replaced in turn by each of these, and written."""
    for number in NUMBER.finditer(content):
        for other in numbers:
            put(path, content[: number.start()] + other + content[number.end() :])
            yield other


@pytest.mark.parametrize("kind", [pytest.param(k, marks=() if k in QUICK else pytest.mark.slow) for k in POSE_FILES])
def test_large_numbers_are_refused_and_tiny_ones_give_no_infinity(tmp_path: Path, kind: str) -> None:
    file = POSE_FILES[kind]
    path = tmp_path / file.name
    assert all(np.isfinite(numbers).all() for numbers in numbers_in(file.read(put(path, file.content))))
    for _ in with_numbers(path, file.content, HOSTILE_NUMBERS):
        refuses(re.escape(str(path)), file.read, path)
    for tiny in with_numbers(path, file.content, TINY):
        with suppress(InputError):
            assert all(np.isfinite(numbers).all() for numbers in numbers_in(file.read(path))), tiny


def test_a_zero_covariance_is_refused(tmp_path: Path) -> None:
    summary = put(tmp_path / "summary.json", POSE_FILES["summary.json"].content.replace(b"0.125", b"0"))
    put(tmp_path / "pairs.csv", POSE_FILES["pairs.csv"].content)
    poses = put(tmp_path / "poses.tum", POSE_FILES["tum"].content)
    result = sonarmap("evaluate", poses, poses, "--summary", summary)
    refused_with_reason(result)
    said(result, "error: a pose's covariance is singular")


class TestNesting:
    @pytest.mark.parametrize("kind", [kind for kind in POSE_FILES if kind.endswith(".json")])
    @pytest.mark.parametrize("content", [b"[" * 100_000, b'{"a":' * 100_000, b"[" * 500 + b"]" * 500])
    def test_deep_nesting_is_refused(self, tmp_path: Path, kind: str, content: bytes) -> None:
        path = put(tmp_path / "deep.json", content)
        refuses(re.escape(str(path)), POSE_FILES[kind].read, path)

    def test_valid_json_is_read(self, tmp_path: Path) -> None:
        path = put(tmp_path / "a.json", b'{"a": [1, -2.5e-3, 9223372036854775807, 1e30, null, "\xc3\xb6"]}')
        assert read_json(path, "a file") == {"a": [1, -2.5e-3, 2**63 - 1, 1e30, None, "ö"]}


class TestMemory:
    def test_a_system_without_memory_counts_has_a_default(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def missing(*_: object, **__: object) -> str:
            raise FileNotFoundError

        monkeypatch.setattr(Path, "read_text", missing)
        assert available_memory() > 2**27
        monkeypatch.setattr("sonarmap.tools.files.memory.os.sysconf", missing)
        assert available_memory() == 4 << 30

    def test_only_more_than_the_memory_is_refused(self) -> None:
        available = available_memory()
        assert 2**27 < available < 2**50
        require_memory("a thing", available // 2, "take less")
        with pytest.raises(
            InputError, match=r"a thing takes [\d,.]+ GiB of memory, .* [GM]iB to spare here; take less"
        ):
            require_memory("a thing", 10**400, "take less")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("number", "solved"),
    [(b"1e16", True), (b"1e30", False)],
)
def test_weights_that_differ_much_are_solved_or_refused(tmp_path: Path, number: bytes, solved: bool) -> None:
    edge = b"EDGE_SE3:QUAT 1 2 1.5 0.25 0 0 0 0 1 100 0.5 0.5 0.5 0.5 0.5 "
    before, _, after = POSE_FILES["g2o"].content.rpartition(edge + b"100 ")
    path = put(tmp_path / "in.g2o", before + edge + number + b" " + after)
    result = sonarmap("optimize", path, "-o", tmp_path / "out.g2o")
    if solved:
        assert result.exit_code == 0, result.output
        T = read_g2o(tmp_path / "out.g2o").trajectory.T_world_sensor
        np.testing.assert_allclose((T[1].inv() * T[2]).translation, [1.5, 0.25, 0], atol=1e-4)
    else:
        refused_with_reason(result)
        said(result, "error: the pose graph of 3 poses and 2 edges has no unique solution")
