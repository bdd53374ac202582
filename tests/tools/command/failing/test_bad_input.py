"""Bad input, end to end: a clear error that says what to do, the right exit code, nothing lost."""

from pathlib import Path

import numpy as np
import pytest

from tests.samples.clutter_scans import (
    files_in,
    plane,
    printed,
    refused,
    said,
    scan,
    sonarmap,
    write,
)

GRID = ("--grid", "64")
HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex {}\n" + "".join(
    f"property float {axis}\n" for axis in "xyz"
)


@pytest.fixture
def good(tmp_path: Path) -> str:
    return write(tmp_path, good=scan(0))[0]


def ply(promised: int, points: np.ndarray) -> bytes:
    return (HEADER.format(promised) + "end_header\n").encode() + points.astype("<f4").tobytes()


NOT_SCANS = {
    "no bytes": ("bad.ply", b"", ["bad.ply", "empty (0 bytes)"]),
    "one point": ("bad.ply", ply(1, np.ones((1, 3))), ["bad", "fill 1 of the voxels", "more structure"]),
    "one plane": ("bad.ply", ply(2000, plane()), ["bad", "in one plane", "more structure"]),
    "nothing finite": ("bad.ply", ply(9, np.full((9, 3), np.nan)), ["bad.ply", "dropped 9 of 9 points that are NaN"]),
    "more promised": ("bad.ply", ply(2001, plane()), ["bad.ply", "promises 2,001", "cut or its header is wrong"]),
    "text": ("bad.ply", b"These are notes.\n", ["bad.ply", "holds text", "wanted a PLY file"]),
    "unknown format": ("bad.e57", b"LASF", ["bad.e57", "unknown format '.e57'", ".ply, .pcd, .npy"]),
    "map coordinates": ("bad.ply", ply(2000, plane() + 5e5), ["bad.ply", "map coordinates", "subtract"]),
    "too much": (
        "bad.pcd",
        b"VERSION 0.7\nFIELDS x y z n\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 300000000\nWIDTH 0\nHEIGHT 1\n"
        b"DATA binary\n",
        ["bad.pcd", "the header promises points of 1,200,000,012 bytes"],
    ),
}


@pytest.mark.parametrize(("case", "place"), [(case, ("target", "source")[k % 2]) for k, case in enumerate(NOT_SCANS)])
def test_files_that_are_not_scans_are_refused(good: str, tmp_path: Path, case: str, place: str) -> None:
    name, content, words = NOT_SCANS[case]
    (tmp_path / name).write_bytes(content)
    pair = [tmp_path / name, good] if place == "target" else [good, tmp_path / name]
    refused(sonarmap("register", *pair, *GRID, "--json"), "error: ", *words)


@pytest.mark.parametrize("name", ["missing.ply", "missing", "missing/*.ply", "missing.sonar#2", "\x1b[2Jmissing.ply"])
def test_missing_files_are_refused(good: str, tmp_path: Path, name: str) -> None:
    for verb in (["register", good, tmp_path / name], ["map", good, tmp_path / name, "-o", tmp_path / "out"]):
        result = sonarmap(*verb)
        refused(result, "error: ", "missing")
        assert "\x1b" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_map_refuses_a_single_scan(good: str, tmp_path: Path) -> None:
    for inputs in ([good], [good, good], [tmp_path]):
        result = sonarmap("map", *inputs, "-o", tmp_path / "out", *GRID)
        refused(result, "1 scan given; a map needs at least two")
        assert ("given more than once" in result.stderr) == (len(inputs) == 2)


def test_a_survey_without_a_usable_pair_is_refused(tmp_path: Path) -> None:
    paths = write(tmp_path, a=plane(), b=scan(0), c=plane())
    result = sonarmap("map", *paths, "-o", tmp_path / "out", *GRID)
    refused(result, "none of the 3 pairs", "a: all its points lie in one plane")
    assert set(files_in(tmp_path / "out")) == {"journal.sqlite"}  # keeps the tried pairs for the next run


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--grid 98", ["--grid 98 is not an even product of 2, 3 and 5 from 16 to 512", "--grid 96 or --grid 100"]),
        ("--voxel -1", ["-1.0 m", "above 0"]),
        ("--max-tilt -5", ["-5.0 degrees", "more than 0 and at most 180"]),
        ("--set hypotheses=0", ["hypotheses=0 is too few"]),
        ("--set hypotheses=many", ["--set hypotheses=many", "wanted a whole number"]),
        ("--seed -1", ["-1", "whole number", "as in --seed 1"]),
        ("--device abacus", ["no OpenCL device matches 'abacus'", "There are: "]),
    ],
)
@pytest.mark.parametrize("verb", ["register", "map"])
def test_invalid_option_values_are_refused(tmp_path: Path, verb: str, options: str, words: list[str]) -> None:
    """The message says what was given, what was wanted and what to do."""
    out = ["-o", tmp_path / "out"] if verb == "map" else []
    refused(sonarmap(verb, *write(tmp_path, a=scan(0), b=scan(1)), *out, *options.split()), *words)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("voxel", "words"), [("1e-6", "Give a larger --voxel"), ("1e6", "wanted at least 20")])
def test_far_too_small_or_large_voxels_are_refused(tmp_path: Path, voxel: str, words: str) -> None:
    result = sonarmap("register", *write(tmp_path, a=scan(0), b=scan(1)), *GRID, "--voxel", voxel, "--json")
    refused(result, words, "--voxel")


def test_bad_and_unreadable_scans_leave_gaps_and_the_others_are_mapped(tmp_path: Path) -> None:
    name, content, (_, words) = NOT_SCANS["too much"]
    write(tmp_path / "scans", a=scan(0), b=plane(), c=scan(1), e=scan(2))
    unreadable = tmp_path / "scans" / name.replace("bad", "d")
    unreadable.write_bytes(content)
    result = sonarmap("map", tmp_path / "scans", "-o", tmp_path / "out", *GRID, "--json")
    summary = printed(result, 3)
    assert [(scan["name"], scan["stamp"]) for scan in summary["scans"]] == [("a", 0), ("b", 1), ("c", 2), ("e", 4)]
    assert [part["scans"] for part in summary["components"]] == [[0, 2, 3]]
    assert summary["unplaced"] == [1]
    assert summary["gaps"] == [[0, 1], [1, 2], [2, 3]]
    (unread,) = summary["unread"]
    assert (unread["name"], unread["gap"]) == (str(unreadable), [2, 3])
    assert words in unread["reason"]
    assert {"map.ply", "trajectory.tum"} <= set(files_in(tmp_path / "out"))
    assert "map_2.ply" not in files_in(tmp_path / "out")
    said(result, "warning: b is in no map: ", "warning: skipped, which leaves a gap", "d.pcd: ", words)
    assert result.stderr.count("more structure") == 1
    assert "gap between" not in result.stderr


def test_fewer_than_two_readable_scans_are_refused(good: str, tmp_path: Path) -> None:
    (tmp_path / "bad.ply").write_bytes(b"")
    for inputs, left in (([good, tmp_path / "bad.ply"], "1 of 2"), ([tmp_path / "bad.ply"], "0 of 1")):
        result = sonarmap("map", *inputs, "-o", tmp_path / "out", *GRID)
        refused(result, "error: ", "bad.ply: the file is empty", f"{left} scans can be read; a map needs at least two")
    assert not (tmp_path / "out").exists()
