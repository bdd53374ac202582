"""Real scans, if the shared data lies beside the checkout: RGB-D fragments with truth, and sonar frames."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.map.crossing import crossing_error
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.scans import read_scans
from sonarmap.tools.methods.registry import build
from tests.samples.places import DATA
from tests.samples.scenes.structures import difference

pytestmark = pytest.mark.slow
KITCHEN, SHIP = DATA / "redkitchen", DATA / "sonar3d15" / "ship_short.sonar"


@dataclass(frozen=True, slots=True)
class Mapped:
    """Scans mapped as one survey by the default method with its defaults."""

    scans: tuple[Scan, ...]
    voxel: float
    result: SurveyResult

    @property
    def poses(self) -> RigidTransform:
        return self.result.trajectory.T_world_sensor

    @property
    def registrations(self) -> dict[tuple[int, int], Registration]:
        """Registrations by their pair of scans."""
        return {(pair.i, pair.j): pair.registration for pair in self.result.pairs if pair.registration}


def mapped(*inputs: Path) -> Mapped:
    scans = read_scans(inputs).scans
    grid = choose_grid(scans)
    return Mapped(scans, grid.voxel, Mapper(build("spectral", grid), grid.voxel).run(scans))


@pytest.fixture(scope="module")
def kitchen() -> Mapped:
    """Survey of three fragments of a kitchen."""
    if not KITCHEN.is_dir():
        pytest.skip("shared/data/redkitchen is not beside the checkout")
    return mapped(*sorted(KITCHEN.glob("*.ply")))


@pytest.fixture(scope="module")
def ship() -> Mapped:
    """Survey of six frames of a sonar in front of a ship."""
    if not SHIP.is_file():
        pytest.skip("shared/data/sonar3d15 is not beside the checkout")
    return mapped(SHIP)


def true_transforms() -> dict[tuple[int, int], RigidTransform]:
    """gt.log: a line 'i j n' and the matrix that maps fragment j into fragment i."""
    rows = [line.split() for line in (KITCHEN / "gt.log").read_text().splitlines() if line.strip()]
    return {
        (int(head[0]), int(head[1])): RigidTransform.from_matrix(np.array(matrix, dtype=float))
        for head, *matrix in (rows[n : n + 5] for n in range(0, len(rows), 5))
    }


def crossings(survey: Mapped) -> tuple[float, float]:
    """Median crossing errors [m] before and after the loops, with every scan as its own survey."""
    before, scans = survey.result.chained.T_world_sensor, survey.scans
    error = crossing_error(PlacedScans.of(scans, survey.poses, survey.voxel, surveys=range(len(scans))), before)
    assert error.before is not None
    assert error.after is not None
    return error.before.median, error.after.median


def test_the_kitchen_is_registered_within_3_degrees_and_a_voxel(kitchen: Mapped) -> None:
    """All pairs are accepted, within 3 degrees, and within a voxel at the center of the source's points.

    The fragments lie 1 to 4 m in front of their origin, so that a degree moves the origin by a voxel or two.
    """
    scans, voxel, truth = kitchen.scans, kitchen.voxel, true_transforms()
    assert kitchen.registrations.keys() == {(0, 1), (1, 2), (0, 2)}
    for (i, j), registration in kitchen.registrations.items():
        T, middle = registration.T_target_source, scans[j].points.mean(axis=0)
        angle, off = difference(T, truth[i, j])[0], np.linalg.norm(T.apply(middle) - truth[i, j].apply(middle))
        print(f"fragments {i}, {j}: {angle:.2f} degrees, {off / voxel:.2f} voxels of {voxel:.4f} m")
        assert registration.accepted
        assert angle < 3
        assert off < voxel
    for poses in (kitchen.result.chained, kitchen.result.trajectory):
        for k in (1, 2):
            T, middle = poses.T_world_sensor[0].inv() * poses.T_world_sensor[k], scans[k].points.mean(axis=0)
            assert difference(T, truth[0, k])[0] < 3
            assert np.linalg.norm(T.apply(middle) - truth[0, k].apply(middle)) < voxel
    print_pairs(kitchen.result)
    assert all(pair.kept for pair in kitchen.result.pairs)
    before, after = crossings(kitchen)
    assert after < max(1.1 * before, 0.5 * voxel)


def test_frames_of_an_almost_still_sonar_are_mapped_consistently(ship: Mapped) -> None:
    """Six frames within a second: every tried loop is kept, and the whole motion is under 0.3 m."""
    poses, result = ship.poses, ship.result
    print_pairs(result)
    steps = [ship.registrations[k, k + 1].T_target_source for k in range(5)]
    for step in steps:
        angle, distance = difference(RigidTransform.identity(), step)
        assert angle < 3
        assert distance < 0.15
    for whole in (np.prod(np.array(steps, dtype=object)), poses[0].inv() * poses[5]):
        assert difference(RigidTransform.identity(), whole)[1] < 0.3
    assert len(result.components) == 1
    assert sum(pair.role == "loop" for pair in result.pairs) >= 3
    assert all(pair.kept for pair in result.pairs)
    assert max(pair.residual for pair in result.pairs) < 4.74
    before, after = crossings(ship)
    assert after < max(1.1 * before, 0.5 * ship.voxel)


def print_pairs(result: SurveyResult) -> None:
    for pair in result.pairs:
        print(f"{pair.i}, {pair.j} {pair.role}: {pair.residual:.2f} sigmas; {pair.reason}")
