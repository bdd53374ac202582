"""metadata.yaml of ROS 2 bags: what it names counts, once and in the order of time; damage is refused or told."""

from pathlib import Path

import pytest

from sonarmap.tools.files.readers.scans import read_survey
from tests.samples.damage.bag_metadata import METADATA, damage_metadata, two_files

TIMES = [0.125, 1.125, 2.125]


def _check(folder: Path, count: int, seed: int) -> None:
    ends, faults = damage_metadata(folder, count, seed)
    print(dict(ends))
    assert faults == []
    assert sum(ends.values()) == count
    assert ends["whole"] > 0.5 * count
    assert ends["fewer scans"] > 0


def test_some_damaged_metadata(tmp_path: Path) -> None:
    _check(tmp_path, 100, seed=3)


@pytest.mark.slow
def test_thousands_of_damaged_metadata(tmp_path: Path) -> None:
    _check(tmp_path, 3000, seed=4)


def _read_with(folder: Path, old: str, new: str) -> tuple[list[float], list[str]]:
    """Stamps and notes of a bag whose metadata say something else."""
    bag = two_files(folder, "dive")
    text = (bag / METADATA).read_text()
    assert old in text
    (bag / METADATA).write_text(text.replace(old, new, 1))
    read = read_survey([bag])
    assert not read.unread
    return [scan.stamp for scan in read.scans], [note.removeprefix("dive: ") for note in read.notes]


def test_files_in_another_order(tmp_path: Path) -> None:
    names = "- dive.db3\n  - dive_1.mcap\n"
    assert _read_with(tmp_path, names, "- dive_1.mcap\n  - dive.db3\n")[0] == TIMES


def test_a_file_named_twice(tmp_path: Path) -> None:
    assert _read_with(tmp_path, "- dive_1.mcap\n", "- dive_1.mcap\n  - dive_1.mcap\n")[0] == TIMES


def test_a_file_that_is_not_named(tmp_path: Path) -> None:
    stamps, notes = _read_with(tmp_path, "  - dive_1.mcap\n", "")
    assert stamps == TIMES[:2]
    assert "dive_1.mcap is left out, as metadata.yaml does not name it" in notes


@pytest.mark.parametrize("title", ["rosbag2_bagfile_infirmation", "# "])
def test_a_title_that_nobody_knows(tmp_path: Path, title: str) -> None:
    """It is a bag all the same: its files are one recording, mounted alike."""
    stamps, notes = _read_with(tmp_path, "rosbag2_bagfile_information", title)
    assert stamps == TIMES
    assert "metadata.yaml cannot be read; all recordings of the folder are taken" in notes


def test_names_that_are_no_list(tmp_path: Path) -> None:
    stamps, notes = _read_with(tmp_path, "\n  - dive.db3\n  - dive_1.mcap\n", " dive.db3\n")
    assert stamps == TIMES
    assert "metadata.yaml cannot be read; all recordings of the folder are taken" in notes
