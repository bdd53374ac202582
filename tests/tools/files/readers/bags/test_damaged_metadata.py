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


NAMES, UNREADABLE = (
    "- dive.db3\n  - dive_1.mcap\n",
    "metadata.yaml cannot be read; all recordings of the folder are taken",
)


@pytest.mark.parametrize(
    ("old", "new", "shots", "note"),
    [
        pytest.param(NAMES, "- dive_1.mcap\n  - dive.db3\n", 3, "", id="another order"),
        pytest.param("- dive_1.mcap\n", "- dive_1.mcap\n  - dive_1.mcap\n", 3, "", id="a file twice"),
        ("  - dive_1.mcap\n", "", 2, "dive_1.mcap is left out, as metadata.yaml does not name it"),
        # it is a bag all the same: its files are one recording, mounted alike
        ("rosbag2_bagfile_information", "rosbag2_bagfile_infirmation", 3, UNREADABLE),
        ("rosbag2_bagfile_information", "# ", 3, UNREADABLE),
        pytest.param(f"\n  {NAMES}", " dive.db3\n", 3, UNREADABLE, id="no list"),
    ],
)
def test_metadata_that_say_something_else(tmp_path: Path, old: str, new: str, shots: int, note: str) -> None:
    bag = two_files(tmp_path, "dive")
    text = (bag / METADATA).read_text()
    assert old in text
    (bag / METADATA).write_text(text.replace(old, new, 1))
    read = read_survey([bag])
    assert not read.unread
    assert [scan.stamp for scan in read.scans] == TIMES[:shots]
    assert not note or f"dive: {note}" in read.notes
