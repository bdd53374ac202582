"""What cannot be a scan is refused in words that say so, with no more memory than its size explains."""

import io
import re
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.scans import FORMATS, read_scan, read_scans
from tests.samples.cloud_files import POINTS, SAMPLES, STRENGTH, TABLE, npy, npz, pcd, ply, text

pytestmark = pytest.mark.filterwarnings("error")
NAMES = list(SAMPLES)


def refused(folder: Path, suffix: str, content: bytes, said: str) -> None:
    """Refused in words that name the file, without more memory than a few times its size."""
    (folder / f"scan{suffix}").write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=said) as caught:
            read_scans([folder / f"scan{suffix}"])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert f"scan{suffix}" in str(caught.value)
    assert peak < 1_000_000 + 20 * len(content), f"{peak:,} bytes for a file of {len(content):,}"


# Of files that promise how many points they hold
COUNTED = {name: (".ply", SAMPLES[name][1], [b"vertex"]) for name in NAMES if name.startswith("ply")} | {
    f"pcd {encoding}": (".pcd", pcd(encoding), [b"WIDTH", b"POINTS"])
    for encoding in ("ascii", "binary", "binary_compressed")
}


@pytest.mark.parametrize("count", [20, 10**17, -5])
@pytest.mark.parametrize("kind", COUNTED)
def test_a_wrong_number_of_points_in_the_header_is_refused(tmp_path, kind, count):
    suffix, content, words = COUNTED[kind]
    for word in words:
        content = content.replace(b"%s 5" % word, b"%s %d" % (word, count))
    refused(tmp_path, suffix, content, "promises" if count > 0 else "'-5'")


@pytest.mark.parametrize("shape", ["(6, 4)", "(1000000000000, 3)", "(1000000000000, 1000000000000)", "(-5, 4)"])
def test_an_npy_with_a_wrong_shape_in_its_header_is_refused(tmp_path, shape):
    content = npy(TABLE).replace(b"(5, 4), }" + b" " * (len(shape) - 6), b"%s, }" % shape.encode())
    refused(tmp_path, ".npy", content, "promises" if shape[1] != "-" else "shape")


def zipped(member: bytes) -> bytes:
    """An npz file of this member."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", member)
    return file.getvalue()


@pytest.mark.slow
def test_an_npz_with_a_wrong_size_in_its_header_is_not_unpacked(tmp_path):
    lying = npy(POINTS).replace(b"(5, 3), }        ", b"(1000000000, 3), }")
    refused(tmp_path, ".npz", zipped(lying), r"'points.npy'.*promises")
    body = npy(np.zeros((6_000_000, 3), np.float32))
    content = zipped(body)
    bomb = content.replace(len(body).to_bytes(4, "little"), (5000).to_bytes(4, "little"))
    assert bomb != content
    refused(tmp_path, ".npz", bomb, "damaged|promises")


@pytest.mark.parametrize(
    ("suffix", "content", "said"),
    [
        (".ply", ply().replace(b"vertex 5", b"vertex 0"), "no points"),
        (".ply", ply("ascii").replace(b"double y", b"double w"), "no column y among"),
        (".ply", ply().replace(b"property float x", b"property list uchar float x"), "list property"),
        (".ply", ply("ascii").replace(b"7 -2.25", b"-2.25"), "line 11 has 4 columns; wanted 5"),
        (".pcd", pcd("binary").replace(b"WIDTH 5", b"WIDTH 4"), "POINTS 5 and WIDTH x HEIGHT 4 x 1"),
        (".pcd", pcd("binary").replace(b"SIZE 2 4", b"SIZE 2 3"), "SIZE '3'"),
        (".pcd", pcd("binary").replace(b"FIELDS", b"FILDS"), "no FIELDS"),
        (".pcd", pcd("ascii").replace(b"1 2 3 1.5", b"1 2 1.5"), "line 12 has 6 columns; wanted 7"),
        (".xyz", b"1 2 3\n4 5\n", "line 2 has 2 columns; wanted 3"),
        (".csv", b"x,y,intensity\n1,2,3\n", "no column z among"),
        (".csv", b"1;2;3.5,5\n", "line 1: '3.5,5' is not a number"),
        (".xyz", b"1 2 3\n1 2 \xc2\xa03\n", "line 2: .* is not a number"),  # NumPy divides there
        (".xyz", b"1 2 3\n1 2 1_0\n", "line 2: '1_0' is not a number"),
        (".txt", b"1 2 3 4 5\n", "line 1 has 5 columns.*names the columns"),
        (".txt", b"1 2 3\n4 5 6 # m\xe4rz\n", "line 2 is not UTF-8"),
        (".npy", npy(np.zeros((6, 5))), r"shape \(6, 5\); wanted"),
        (".npy", npy(np.zeros((0, 3))), "no points"),
        (".npy", npy(np.zeros((2, 3), complex)), "array of complex128"),
        (".npy", npy(np.array([[1, 2, None]], object)), "array of objects"),
        (".npz", npz(points=np.array([[1, 2, None]], object)), "array of objects"),
        (".npz", npz(points=POINTS, strength=STRENGTH[:4]), r"strength has shape \(4,\); wanted \(5,\)"),
        (".npz", npz(points=POINTS, stamp=np.array([1.0, 2.0])), "stamp has shape"),
        (".npz", npz(a=POINTS, b=STRENGTH), "its arrays are a, b; wanted 'points'"),
        (".npy", npy(np.full((3, 3), np.nan, np.float32)), "NaN or infinite; nothing"),
        (".csv", text().decode().encode("utf-16"), "binary content|UTF-8"),
    ],
)
def test_invalid_scans_are_refused_with_the_reason(tmp_path, suffix, content, said):
    refused(tmp_path, suffix, content, said)


@pytest.mark.parametrize("far", [100_001.0, -4.2e6, 1.7e308])
def test_map_coordinates_are_refused_with_advice(tmp_path, far):
    table = POINTS.astype(np.float64)
    refused(tmp_path, ".npy", npy(table + far), "map coordinates.*subtract the sensor's position")
    table[1, 1] = far
    refused(tmp_path, ".npy", npy(table), "another unit.*--units, such as mm")
    table[1, 1] = 1e5
    (tmp_path / "near.npy").write_bytes(npy(table))
    assert read_scan(tmp_path / "near.npy").points[1, 1] == 1e5


@pytest.mark.parametrize("suffix", sorted(FORMATS))
def test_a_file_with_a_wrong_suffix_is_refused_with_its_format(tmp_path, suffix):
    for right, content in {suffix: (suffix, content) for suffix, content in SAMPLES.values()}.values():
        if FORMATS[suffix].kind != FORMATS[right].kind:
            refused(tmp_path, suffix, content, f"holds {re.escape(FORMATS[right].kind)}.*rename it")


@pytest.mark.parametrize("suffix", sorted(FORMATS))
def test_empty_files_and_garbage_are_refused(tmp_path, suffix):
    refused(tmp_path, suffix, b"", "empty")
    garbage = np.random.default_rng(1).integers(0, 256, 5000, np.uint8).tobytes()
    refused(tmp_path, suffix, garbage, "binary content of no known kind")
