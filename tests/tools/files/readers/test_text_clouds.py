"""Text clouds as other programs write them: .pts, .asc, colors, decimal commas, NaN as Microsoft's library has it."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.cloud_files import POINTS, STRENGTH, TABLE, pcd, ply, put, text
from tests.samples.damage.damaged_files import damage, readables
from tests.samples.refusals import refuses

NOT_FINITE = ["1.#QNAN", "-1.#IND", "-nan(ind)", "1.#INF", "nan(snan)", "-NaN", "1.#SNAN0"]
NEW = ("pts", "asc", "csv with decimal commas", "pcd with commas", "g2o of GTSAM")


@pytest.mark.parametrize("word", NOT_FINITE)
def test_nan_of_any_spelling_is_dropped_and_counted(tmp_path: Path, word: str) -> None:
    put(tmp_path / "a.txt", text() + f"1 {word} 3 4\n{word} {word} {word} 1\n".encode())
    read = read_scans([tmp_path / "a.txt"])
    np.testing.assert_array_equal(read.scans[0].points, POINTS)
    assert read.notes == ("a.txt: dropped 2 of 7 points that are NaN or infinite",)
    for name, content in (("b.pcd", pcd("ascii")), ("c.ply", ply("ascii"))):
        put(tmp_path / name, content.replace(b" 3.25 ", f" {word} ".encode()))
        assert len(read_scans([tmp_path / name]).scans[0].points) == 4


@pytest.mark.parametrize(
    "content",
    [
        text(";").replace(b".", b","),
        text("\t").replace(b".", b","),
        text(" ").replace(b".", b","),
        text(";", "X;Y;Z;Intensity\n").replace(b".", b","),
        b"\xef\xbb\xbf" + text(", "),
    ],
    ids=["semicolons", "tabs", "blanks", "a heading", "a byte-order mark"],
)
@pytest.mark.parametrize("suffix", [".asc", ".csv"])
def test_decimal_commas_are_read(tmp_path: Path, suffix: str, content: bytes) -> None:
    scan = read_scans([put(tmp_path / f"a{suffix}", content)]).scans[0]
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.strength, STRENGTH)


def test_colors_are_left_out(tmp_path: Path) -> None:
    rows = TABLE.tolist()
    six = "".join(f"{x} {y} {z} 255 0 17\n" for x, y, z, _ in rows)
    seven = "".join(f"{x} {y} {z} {s} 255 0 17\n" for x, y, z, s in rows)
    for name, content in (("a.pts", f"5\n{six}"), ("b.asc", six), ("c.xyz", seven), ("d.pts", f"5\r\n{seven}")):
        scan = read_scans([put(tmp_path / name, content.encode())]).scans[0]
        np.testing.assert_array_equal(scan.points, POINTS)
        assert (scan.strength is not None) == (name in ("c.xyz", "d.pts"))
    refuses("last three of 6 columns are no colors", read_scans, [put(tmp_path / "e.asc", b"1 2 3 0.5 0.1 0.1\n")])


def test_the_count_of_a_pts_file_is_checked(tmp_path: Path) -> None:
    put(tmp_path / "a.pts", b"6\n" + text())
    refuses("6 points in its first line, and 5 lines follow: the file is cut", read_scans, [tmp_path / "a.pts"])
    put(tmp_path / "b.pts", b"4\n" + text())
    read = read_scans([tmp_path / "b.pts"])
    assert (len(read.scans[0].points), read.notes) == (4, ("b.pts: ignored 1 lines after the last point",))


def test_a_grid_of_heights_is_no_scan(tmp_path: Path) -> None:
    put(tmp_path / "a.asc", b"ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n")
    refuses("an ESRI ASCII grid", read_scans, [tmp_path / "a.asc"])


@pytest.mark.parametrize("each", [500, pytest.param(5000, marks=pytest.mark.slow)])
def test_damaged_files_of_the_new_formats_are_refused_or_harmless(tmp_path: Path, each: int) -> None:
    outcome = damage(tmp_path, each, 3, {kind: file for kind, file in readables().items() if kind in NEW})
    assert outcome.faults == []
    assert sum(ends["refused"] > 0 for ends in outcome.ends.values()) == len(NEW)
    assert outcome.longest[0] < 5.0
    assert outcome.largest[0] < 300 << 20
    print({kind: dict(ends) for kind, ends in outcome.ends.items()}, outcome.longest, outcome.largest)
