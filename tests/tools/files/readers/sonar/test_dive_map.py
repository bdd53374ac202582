"""A recording with losses, doubled and exchanged packets, damage and a wrap: its map is that of the undisturbed one."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

import sonarmap
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper import MapperSettings
from sonarmap.tools.files.readers.scans import read_survey
from tests.samples.dives import Dive
from tests.samples.recordings import Events, damage_a_shot, disturbed, written


def record(folder: Path, dive: Dive) -> tuple[list[Path], set[int], Events]:
    """A dive as it is, and with 1 % of the packets lost, 1 % doubled, 1 % exchanged with the next, and a damaged one;
    shots without a range image in the second, and what else was done."""
    clean = list(dive.packets())
    packets, events = disturbed(clean, seed=1)
    lost = damage_a_shot(packets, events, dive.shots // 3)
    assert 0 not in lost
    return [written(folder / "whole.sonar", clean), written(folder / "dive.sonar", packets)], lost, events


def check_notes(words: str, shots: int, lost: set[int], events: Events) -> None:
    """That what was done to a recording is counted in what the command says of it."""
    missing = len(lost & set(range(1, shots - 1)))  # nobody misses the first and the last
    for note in (
        "1 damaged packet left out",
        f"{missing:,} of {shots - len(lost) + missing:,} shots are missing by their numbers",
        f"{events.doubled:,} doubled image",
        f"{events.exchanged:,} shot",
        "the numbers of the shots wrapped once",
    ):
        assert note in words, f"{note!r} is not in {words}"


@dataclass(frozen=True, slots=True)
class Mapped:
    """A map: its voxel [m], T_world_sensor of its scans, and its points (M, 3) [m]."""

    voxel: float
    trajectory: Trajectory
    points: np.ndarray


def check_same(dive: Dive, whole: Mapped, other: Mapped) -> None:
    """That two maps of a dive, both in the frame of its first shot and with one voxel, are the same within a voxel.

    A point off the true surface is a false echo, and whether it stays may hang on a single shot.
    """
    voxel = whole.voxel
    assert voxel == other.voxel
    stamps, others = (np.round(each.trajectory.stamps, 3) for each in (whole, other))
    _, first, second = np.intersect1d(stamps, others, return_indices=True)
    assert len(first) == len(other.trajectory)
    T, T_other = whole.trajectory.T_world_sensor[first], other.trajectory.T_world_sensor[second]
    shares, of_surface = [], []  # of the points of each map that have a point of the other within a voxel
    for a, b in ((whole, other), (other, whole)):
        near = KDTree(b.points).query(a.points)[0] <= voxel
        placed = a.trajectory.T_world_sensor[0].inv().apply(a.points)
        shares.append(near.mean())
        of_surface.append(near[dive.surface_distances(placed) <= voxel].mean())
    places = np.linalg.norm(T.translation - T_other.translation, axis=1) / voxel
    turns = np.degrees((T.inv() * T_other).rotation.magnitude())
    print(
        f"at most {places.max():.2f} voxels and {turns.max():.2f} degrees apart; within a voxel: {shares}, {of_surface}"
    )
    assert places.max() < 1
    assert min(of_surface) > 0.99
    assert min(shares) > 0.95


@pytest.mark.slow
def test_a_disturbed_dive_gives_the_same_map(tmp_path: Path) -> None:
    maps, notes = list[Mapped](), ""
    dive = Dive("rubble", 100, rate=2.5, columns=64, rows=16, first=2**32 - 50)
    paths, lost, events = record(tmp_path, dive)
    for path in paths:
        read = read_survey([path])
        notes = "; ".join(read.notes)
        result = sonarmap.map_scans(read.scans, edge=64, settings=MapperSettings(LoopSettings(per_scan=0)))
        assert len(result.keys or ()) in range(4, dive.shots // 4)
        assert len(result.components) == 1
        maps.append(Mapped(result.voxel, result.trajectory, result.maps[0].points))
    check_notes(notes, dive.shots, lost, events)
    check_same(dive, *maps)
