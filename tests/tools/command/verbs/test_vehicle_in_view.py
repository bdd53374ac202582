"""The vehicle itself in the sensor's view: named by inspect and map with the boxes that leave it out."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.readers.clouds.ply import read_ply_columns
from sonarmap.tools.files.readers.scans import read_scans
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.files.writers.points import write_ply
from tests.samples.clutter_scans import done, printed, refused, said, sonarmap

OPTIONS = re.compile(r"--exclude-box (\S+\d)")
RAILS = 0.3  # share of the points


def rails(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points on two rails, 0.8 to 1.1 m ahead."""
    along, beside = rng.uniform(0.8, 1.1, count), rng.choice([-0.3, 0.3], count)
    return np.column_stack([along, beside, np.full(count, -0.2)]) + rng.normal(0, 0.01, (count, 3))


def with_vehicle(clean: Path, folder: Path) -> Path:
    rng = np.random.default_rng(2)
    for scan in read_scans([clean]).scans:
        more = rails(round(RAILS / (1 - RAILS) * len(scan.points)), rng)
        write_ply(folder / f"{scan.name}.ply", np.vstack([scan.points, more]).astype(np.float32))
    return folder


def simulated(folder: Path, scene: str, *more: str) -> Path:
    done(sonarmap("simulate", "--scene", scene, "--scans", "10", "--seed", "4", "-q", "-o", folder, *more))
    return folder


@pytest.fixture(scope="module")
def surveys(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Scans of a rough bed, and the same with rails."""
    folder = tmp_path_factory.mktemp("surveys")
    clean = simulated(folder / "clean", "shallow")
    return clean, with_vehicle(clean, folder / "rails")


def test_inspect_names_the_boxes(surveys: tuple[Path, Path]) -> None:
    clean, dirty = surveys
    assert "exclude-box" not in done(sonarmap("inspect", clean)).stderr
    result = sonarmap("inspect", dirty)
    said(result, "2 objects from 0.8", " % of the points", "stand still in the sensor's frame")
    boxes = OPTIONS.findall(" ".join(result.stderr.split()))
    assert len(boxes) == 2
    options = [word for box in boxes for word in ("--exclude-box", box)]
    result = sonarmap("inspect", dirty, *options)
    said(result, f"in the excluded box {boxes[0]}")
    assert "stand still" not in result.stderr
    notes = printed(sonarmap("inspect", dirty, *options, "--json"))["notes"]
    assert sum("dropped" in note for note in notes) == 2


def test_impossible_boxes_are_refused(surveys: tuple[Path, Path]) -> None:
    refused(sonarmap("inspect", surveys[0], "--exclude-box", "1,2,3"), "--exclude-box '1,2,3' is no box")
    refused(sonarmap("inspect", surveys[0], "--min-range", "5", "--max-range", "2"), "give other --min-range")


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["flatbed", "harbor"])
def test_the_named_boxes_give_the_map_without_the_vehicle(tmp_path: Path, scene: str) -> None:
    """Poses within 0.1 voxel, no false point at the track, and as many doubtful points."""
    clean = simulated(tmp_path / "clean", scene, "--spacing", "3", "--priors", "all", "--fix-sigma", "0.5")
    dirty = with_vehicle(clean, tmp_path / "rails")
    options = ("--grid", "64", "--loops", "0", "--no-report", "--priors", clean / "priors.csv")
    done(sonarmap("map", clean, "-o", tmp_path / "a", *options))
    first = sonarmap("map", dirty, "-o", tmp_path / "b", *options)
    boxes = OPTIONS.findall(" ".join(first.stderr.split()))
    boxed = [word for box in boxes for word in ("--exclude-box", box)]
    result = done(sonarmap("map", dirty, "-o", tmp_path / "c", *options, *boxed))
    assert "stand still" not in result.stderr
    without, box = (read_tum(tmp_path / out / "trajectory.tum").T_world_sensor.translation for out in "ac")
    voxel = read_map_folder(tmp_path / "a").voxel
    print(scene, "poses differ by", np.abs(without - box).max() / voxel, "voxels")
    assert np.abs(without - box).max() < 0.1 * voxel
    for name in ("map.ply", "map_all.ply"):
        one, other = (points_of(tmp_path / out / name) for out in "ac")
        print(scene, name, len(one), "points without,", len(other), "with the vehicle left out")
        assert len(one) == len(other)
        nearest = [KDTree(points).query(box)[0].min() for points in (one, other)]
        assert nearest[1] == pytest.approx(nearest[0], abs=0.1 * voxel)  # none of the rails, 0.8 to 1.1 m away


def points_of(path: Path) -> np.ndarray:
    columns = read_ply_columns(path.read_bytes())
    return np.column_stack([columns[axis] for axis in "xyz"])


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene", ["seabed", "harbor", "wreck", "pool", "bridge", "rubble", "manifold", "clutter", "ship"]
)
@pytest.mark.parametrize("trajectory", ["survey", "lawnmower"])
def test_nothing_is_claimed_of_a_clean_survey(tmp_path: Path, scene: str, trajectory: str) -> None:
    clean = simulated(tmp_path / "clean", scene, "--trajectory", trajectory)
    assert "stand" not in done(sonarmap("inspect", clean)).stderr
