"""Baseline registration methods: each finds the motions that it can find, and refuses other scans."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.baselines.points import thin
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.simulate.random_pairs import random_pair
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.methods.registry import METHODS, build

POINTS = ("icp", "icp-plane", "gicp", "fpfh-ransac", "kiss")
ANYWHERE = ("fpfh-ransac", "kiss")
GRID = Grid(128, 2.0)
# p_target = T p_source: a small motion, all numbers different
SMALL = RigidTransform.from_components([1.1, -0.7, 0.4], Rotation.from_euler("ZYX", [5, 2, -3], degrees=True))


def installed(name: str) -> str:
    package = METHODS[name].package
    if package:
        pytest.importorskip(package.replace("-", "_"), reason=f"{package} is not installed: pip install {package}")
    return name


@cache
def easy() -> tuple[Scan, Scan, RigidTransform]:
    return random_pair(21, (0.8, 0.98), Noise(sigma2=0.5))


@cache
def elsewhere() -> Scan:
    return random_pair(22, (0.8, 0.98), Noise(sigma2=0.5))[1]


def turned(scan: Scan, T_new_old: RigidTransform) -> Scan:
    return Scan(T_new_old.apply(scan.points.astype(np.float64)).astype(np.float32), name="turned")


def halves(scan: Scan) -> tuple[Scan, Scan]:
    """Disjoint halves of a scan's points, the second seen from SMALL."""
    target = Scan(scan.points[::2], name="target")
    return target, turned(Scan(scan.points[1::2]), SMALL.inv())


def register(name: str, target: Scan, source: Scan, seed: int = 0) -> Registration:
    registrar = build(installed(name), GRID, seed=seed)
    return registrar.register(registrar.prepare(target), registrar.prepare(source))


def check(found: Registration, truth: RigidTransform) -> None:
    error = pair_error(found.T_target_source, truth)
    assert error.within(1.0, GRID.voxel), error
    assert found.accepted, found.reason
    assert found.reason
    assert np.isnan(found.psr)
    assert found.seconds > 0
    assert np.linalg.eigvalsh(found.covariance).min() > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ANYWHERE)
def test_a_large_motion_is_found_and_follows_a_turned_source(name: str) -> None:
    """For a source in another frame, T_target_new = T_target_old inverse(T_new_old)."""
    target, source, truth = easy()
    T_new_old = RigidTransform.from_components([2, -3, 1], Rotation.from_euler("ZYX", [130, -8, 15], degrees=True))
    before = register(name, target, source)
    check(before, truth)
    after = register(name, target, turned(source, T_new_old))
    check(after, before.T_target_source * T_new_old.inv())


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("name", POINTS)
def test_a_small_motion_is_found_and_reproduced_with_the_same_seed(name: str) -> None:
    pair = halves(easy()[0])
    first, other = (register(name, *pair, seed=5) for _ in range(2))
    check(first, SMALL)
    assert first.overlap > 0.95
    assert other.T_target_source.as_matrix().tobytes() == first.T_target_source.as_matrix().tobytes()
    assert other.covariance.tobytes() == first.covariance.tobytes()
    assert (other.overlap, other.reason) == (first.overlap, first.reason)


@pytest.mark.parametrize("name", POINTS)
def test_too_few_points_are_refused(name: str) -> None:
    registrar = build(installed(name), GRID)
    scan = Scan(np.random.default_rng(1).uniform(-0.5, 0.5, (500, 3)).astype(np.float32), name="crumb")
    with pytest.raises(InputError, match=r"crumb: its points fill \d+ voxels of 2 m; wanted at least 20"):
        registrar.prepare(scan)


@pytest.mark.parametrize("name", POINTS)
def test_scans_of_a_few_scattered_points_are_refused(name: str) -> None:
    """No point has enough neighbors for a normal or a feature, on which libraries have crashed."""
    rng = np.random.default_rng(7)
    target, source = (Scan(rng.uniform(-40, 40, (30, 3)).astype(np.float32)) for _ in range(2))
    found = register(name, target, source)
    assert not found.accepted
    assert np.linalg.eigvalsh(found.covariance).min() > 0


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("name", ["icp", "fpfh-ransac"])
def test_another_place_is_refused_without_output_on_stdout(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    capfd.readouterr()
    found = register(name, easy()[0], elsewhere())
    assert capfd.readouterr().out == ""
    assert not found.accepted
    assert "wanted at least" in found.reason


def test_normals_point_to_the_side_of_the_sensor() -> None:
    x, y = np.meshgrid(np.arange(0, 20, 0.5), np.arange(0, 20, 0.5))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -5)]).astype(np.float32)
    side = np.where(points[:, :1] < 10, [0, 0, 10], [0, 0, -10])
    for viewpoints, up in ((None, np.ones(40)), ((points + side).astype(np.float32), np.repeat([1, -1], 20))):
        cloud = thin(Scan(points, viewpoints=viewpoints), 0.5)
        order = np.lexsort((cloud.points[:, 0], cloud.points[:, 1]))
        np.testing.assert_allclose(cloud.normals[order][:, 2].reshape(-1, 40), np.tile(up, (40, 1)), atol=1e-9)
