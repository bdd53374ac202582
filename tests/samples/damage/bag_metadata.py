"""metadata.yaml of a ROS 2 bag of two files, damaged at random: every scan as it was, or fewer and a word of it."""

import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.scans import read_survey
from tests.samples.bags.samples import dive
from tests.samples.bags.writers import write_mcap, write_ros2
from tests.samples.damage.mutations import mutated

METADATA = "metadata.yaml"


def two_files(folder: Path, name: str) -> Path:
    """A bag whose recorder went on in a second file: its mounting is in the first alone."""
    records = [record for record in dive() if record[0] != "/odom"]
    bag = write_ros2(folder / name, records[:3])
    write_mcap(bag / f"{name}_1.mcap", records[3:])
    text = (bag / METADATA).read_text()
    named = f"- {name}.db3\n"
    assert named in text
    (bag / METADATA).write_text(text.replace(named, f"{named}  - {name}_1.mcap\n", 1))
    return bag


def damage_metadata(folder: Path, count: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Damage it so many times: how it ended, and what went wrong."""
    bag = two_files(folder, "dive")
    content, other = (bag / METADATA).read_bytes(), (two_files(folder, "other") / METADATA).read_bytes()
    whole = read_survey([bag]).scans
    (bag / METADATA).write_bytes(content.replace(b"- dive.db3", b"- gone.db3"))
    unmounted = read_survey([bag]).scans
    expected = {scan.stamp: [scan] for scan in whole}
    for scan in unmounted:
        expected[scan.stamp].append(scan)
    ends, faults = Counter[str](), list[str]()
    for number in range(count):
        changed = mutated(content, other, np.random.default_rng([seed, number]))
        (bag / METADATA).write_bytes(changed)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                read = read_survey([bag])
        except InputError as error:
            ends["refused"] += 1
            faults += [f"{number}: refused without a word"] * (str(bag) not in str(error))
        except Exception as error:  # noqa: BLE001 - every one of them is a fault to tell
            faults.append(f"{number}: {type(error).__name__}: {str(error)[:200]}")
        else:
            is_whole = len(read.scans) == len(whole)
            ends["whole" if is_whole else "fewer scans" if read.scans else "refused"] += 1
            known = expected if not is_whole else {scan.stamp: [scan] for scan in whole}
            faults += [f"{number}: {fault}" for fault in _faults(read.scans, known)]
            if not is_whole and not read.notes and not read.unread:
                faults.append(f"{number}: {len(read.scans)} scans, and no word of it")
    return ends, faults


def _faults(scans: tuple[Scan, ...], expected: dict[float, list[Scan]]) -> list[str]:
    """What is not as it was."""
    stamps = [scan.stamp for scan in scans]
    faults = [] if stamps == sorted(set(stamps)) else [f"stamps {stamps}"]
    for scan in scans:
        wholes = expected.get(scan.stamp, [])
        if not any(np.array_equal(scan.points, whole.points) for whole in wholes):
            faults.append(f"another scan at {scan.stamp}")
    return faults
