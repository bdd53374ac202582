"""Files, folders and patterns: found, ordered, stamped and named as told; or refused, as copies are."""

import os
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.scans import read_scan, read_scans, read_survey
from sonarmap.tools.files.readers.selection import select_files
from tests.samples.cloud_files import POINTS, npz, put
from tests.samples.refusals import refuses


def test_a_folder_is_read_in_natural_order_and_other_files_are_ignored(tmp_path):
    for index in (10, 2, 1, 33):
        put(tmp_path / f"scan{index}.xyz", f"{index} 2 3\n".encode())
    put(tmp_path / "notes.md", b"no scan")
    put(tmp_path / ".hidden.xyz", b"no scan")
    (tmp_path / "folder.xyz").mkdir()
    for paths in ([tmp_path], [tmp_path / "scan*.xyz"], [str(tmp_path / "*")], sorted(tmp_path.glob("scan*"))):
        scans = read_scans(paths).scans
        assert [scan.points[0, 0] for scan in scans] == [1, 2, 10, 33]
        assert [scan.stamp for scan in scans] == [0, 1, 2, 3]
        assert [scan.name for scan in scans] == ["scan1", "scan2", "scan10", "scan33"]


def test_the_files_of_a_finished_map_are_no_scans(tmp_path):
    for name in ("scan1.ply", "map.ply", "map_all.ply", "points.xyz"):
        put(tmp_path / name, b"1 2 3\n")
    put(tmp_path / "scan2.xyz", b"1 2 3\n")
    put(tmp_path / "summary.json", b'{"files": ["map.ply", "map_all.ply", "points.xyz", "pairs.csv", "../scan2.xyz"]}')
    selected = select_files([tmp_path], (".ply", ".xyz", ".csv"))
    assert [each.path.name for each in selected.files] == ["scan1.ply", "scan2.xyz"]
    (note,) = selected.passed_over
    assert note.startswith(f"{tmp_path} also holds a finished map")
    assert note.endswith("left out map.ply, map_all.ply, points.xyz")
    by_name = select_files([tmp_path / "map.ply", tmp_path / "scan2.xyz"], (".ply", ".xyz"))  # as the user wants it
    assert [each.path.name for each in by_name.files] == ["map.ply", "scan2.xyz"]
    (tmp_path / "scan1.ply").unlink()
    (tmp_path / "scan2.xyz").unlink()
    with pytest.raises(InputError, match="holds no scans, but a finished map"):
        select_files([str(tmp_path / "*")], (".ply", ".xyz"))


def test_scans_of_one_folder_are_of_one_survey(tmp_path):
    for name in ("b/scan1.xyz", "b/scan2.xyz", "a/scan1.xyz", "a/scan3.xyz"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        put(tmp_path / name, b"1 2 3\n")
    put(tmp_path / "a" / "scan2.xyz", b"no numbers\n")
    assert len(read_scans([str(tmp_path / "**" / "scan[13].xyz")]).scans) == 3
    read = read_survey([tmp_path / "b", tmp_path / "a"])
    assert read.surveys == (0, 0, 1, 1)
    assert len(read.unread) == 1
    assert set(read_survey([tmp_path / "b"]).surveys) == {0}
    alone = [tmp_path / "a" / "scan1.xyz", tmp_path / "b" / "scan1.xyz"]
    assert read_survey(alone).surveys == (0, 0)  # each scan has a folder of its own


@pytest.mark.parametrize(("name", "content"), [("README.txt", b"Scans of a quay\n"), ("rov.csv", b"time,depth\n1,2\n")])
def test_a_text_beside_scans_of_another_format_is_no_gap(tmp_path, name, content):
    put(tmp_path / "scan_1.npz", npz(points=POINTS))
    put(tmp_path / "scan_2.npz", npz(points=POINTS))
    put(tmp_path / name, content)
    read = read_survey([tmp_path])
    assert [scan.name for scan in read.scans] == ["scan_1", "scan_2"]
    assert not read.unread
    assert f"{tmp_path / name} holds no points" in read.notes[0]


def test_a_file_named_by_two_paths_is_read_once(tmp_path, monkeypatch):
    path = put(tmp_path / "scan.xyz", b"1 2 3\n")
    put(tmp_path / "other.xyz", b"4 5 6\n")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link").symlink_to(tmp_path)
    read = read_scans([path, "scan.xyz", "./scan.xyz", "link/scan.xyz"])
    assert [scan.name for scan in read.scans] == ["scan"]
    assert read.files == (path,)
    assert f"{path} is given more than once, and used once" in read.notes
    assert not [note for note in read_survey([path, tmp_path / "other.xyz"]).notes if "more than once" in note]
    (tmp_path / "again.xyz").symlink_to(path)
    assert [note for note in read_survey([tmp_path]).notes if "more than once" in note]  # the link and its file
    assert len(read_scans([path, tmp_path / "scan.xyz", str(tmp_path / "scan*.xyz")]).scans) == 1


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("missing.ply", "no such file"),
        ("missing/*.ply", "holds no scans; known formats are .*ply"),
        ("cloud.e57", "unknown format '.e57'; known formats are .*ply.*sonar"),
        ("nosuffix", "unknown format.*no suffix"),
        ("truth.tum", "these are poses, not scans; unknown format"),
        ("hollow", "holds no scans"),
        ("*.e57", "holds no scans"),
        ("good.xyz#1", "holds scans #0 to #0"),
        ("missing.sonar#1", "no such file"),
        ("null\0byte.ply", "null"),
        ("x" * 5000 + ".ply", "cannot read|no such file"),
        ("pipe.ply", "not a regular file"),
    ],
)
def test_unusable_paths_are_refused(tmp_path, name, said):
    os.mkfifo(tmp_path / "pipe.ply")
    for kind in ("cloud.e57", "nosuffix", "truth.tum", "good.xyz"):
        put(tmp_path / kind, b"1 2 3\n")
    (tmp_path / "hollow").mkdir()
    refuses(said, read_scans, [f"{tmp_path}/{name}"])
    refuses("no scans given", read_scans, [])


@pytest.mark.parametrize(
    ("error", "words"),
    [(PermissionError(13, "Permission denied"), "Permission denied.*permissions"), (MemoryError(), "memory")],
)
def test_a_file_that_cannot_be_read_is_refused(tmp_path, monkeypatch, error, words):
    def fail(_):
        raise error

    path = put(tmp_path / "scan.xyz", b"1 2 3\n")
    monkeypatch.setattr(Path, "read_bytes", fail)
    refuses(rf"scan\.xyz.*{words}", read_scan, path)


def test_stamps_are_the_files_own_where_all_have_one(tmp_path):
    put(tmp_path / "a.npz", npz(points=POINTS, stamp=np.array(1.7e9)))
    put(tmp_path / "b.npz", npz(points=POINTS, stamp=np.array([1.7e9 + 0.25])))
    assert [scan.stamp for scan in read_scans([tmp_path]).scans] == [1.7e9, 1.7e9 + 0.25]
    refuses("holds 2 scans", read_scan, tmp_path)
    put(tmp_path / "c.npz", npz(points=POINTS))
    read = read_scans([tmp_path])
    assert [scan.stamp for scan in read.scans] == [0, 1, 2]
    assert read.notes == ("1 of 3 scans have no time: all are stamped 0, 1, 2, ...",)


def test_a_name_with_the_signs_of_a_pattern_is_a_name_first(tmp_path):
    path = put(tmp_path / "scan[1].XYZ", b"1 2 3\n")
    assert read_scan(path).name == "scan[1]"
    assert read_scan(put(tmp_path / "scan#4.xyz", b"1 2 3\n")).name == "scan#4"
