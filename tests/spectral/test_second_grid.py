"""The coarse-grid retry of a pair, with voxels twice as large."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid, second_edge
from sonarmap.spectral.judgement import no_candidates
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from tests.samples.scenes.structures import assert_near, structure

EDGE, EXTENT = 192, 25.6
T_TRUE = RigidTransform.from_components([1.3, -2.1, 0.7], Rotation.from_euler("ZYX", [40, 6, -9], degrees=True))


@pytest.fixture(scope="module")
def registrar() -> SpectralRegistrar:
    return SpectralRegistrar(choose_device(), Grid(EDGE, EXTENT / EDGE))


def noisy(points: np.ndarray, voxels: float, seed: int) -> Scan:
    """A scan with Gaussian noise of this standard deviation [voxels]."""
    noise = np.random.default_rng(seed).normal(0.0, voxels * EXTENT / EDGE, points.shape)
    return Scan((points + noise).astype(np.float32))


@pytest.mark.slow
def test_noisy_scans_refused_on_the_fine_grid_are_accepted_on_the_coarse_one(registrar: SpectralRegistrar) -> None:
    points = structure(4, 8000)
    scans = [noisy(of, 3.75, k) for k, of in enumerate((points, T_TRUE.inv().apply(points)))]
    found = registrar.register(*(registrar.prepare(scan) for scan in scans))
    assert found.accepted
    assert found.reason.startswith("on the coarser grid, with voxels of 0.267 m: the scans match")
    assert_near(found.T_target_source, T_TRUE, 2.0, 0.3)
    wider = registrar.with_voxel(2 * EXTENT / EDGE)
    twice = wider.register(*(wider.prepare(Scan(2 * scan.points)) for scan in scans))
    np.testing.assert_allclose(twice.T_target_source.translation, 2 * found.T_target_source.translation, atol=1e-3)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("same", [True, False])
def test_the_fine_grid_gives_the_pose_of_a_common_place(monkeypatch: pytest.MonkeyPatch, same: bool) -> None:
    monkeypatch.setattr("sonarmap.spectral.registration.second_edge", {64: 32, 32: None}.get)
    sigma = 0.2 if same else 0.05

    def answer(self: SpectralRegistrar, _: object) -> Registration:
        fine = self.grid.edge == 64
        T = RigidTransform.from_translation([0.0, 0.1 if fine else 0.4, 0.0])
        covariance = np.diag(np.full(6, sigma**2))
        answered = replace(no_candidates(1.0), T_target_source=T, covariance=covariance, evidence=(("fixed", 0.99),))
        other = replace(answered, probability=0.6 if fine else 0.04)
        return replace(answered, probability=0.3 if fine else 0.95, accepted=not fine, alternatives=(other,))

    registrar = SpectralRegistrar(choose_device(), Grid(64, EXTENT / 64))
    scan = registrar.prepare(Scan(structure(4, 3000)))
    monkeypatch.setattr(SpectralRegistrar, "_register_once", answer)
    found = registrar.register(scan, scan)
    np.testing.assert_allclose(found.T_target_source.translation[1], 0.1 if same else 0.4)
    assert (found.probability, found.accepted) == (0.95, True)
    assert found.probability + sum(other.probability for other in found.alternatives) <= 1
    assert found.reason.startswith("on the coarser grid, with voxels of 0.8 m")


@pytest.mark.slow
def test_whether_a_pose_is_fixed_depends_on_the_fine_voxel_on_both_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    """An accepted pose has the same accuracy in meters on both grids."""
    monkeypatch.setattr("sonarmap.spectral.registration.second_edge", {64: 32, 32: None}.get)
    judged: list[tuple[int, float]] = []

    def conclude(test: HypothesisTest, *_: object) -> Registration:
        judged.append((test.grid.edge, cast(float, _[-1])))
        return replace(no_candidates(1.0), probability=0.1)

    monkeypatch.setattr("sonarmap.spectral.registration.conclude", conclude)
    registrar = SpectralRegistrar(choose_device(), Grid(64, EXTENT / 64)).with_voxel(0.3)
    scan = registrar.prepare(Scan(structure(4, 3000)))
    registrar.register(scan, scan)
    assert set(judged) == {(64, 0.3), (32, 0.3)}


@pytest.mark.parametrize(
    ("edge", "second"), [(64, None), (120, None), (128, 64), (180, 90), (192, 96), (250, 128), (256, 128), (512, 256)]
)
def test_only_fine_grids_have_a_retry(edge: int, second: int | None) -> None:
    assert second_edge(edge) == second


@pytest.mark.slow
def test_accepted_pairs_are_not_retried(registrar: SpectralRegistrar) -> None:
    points = structure(4, 8000)
    target, source = (registrar.prepare(noisy(of, 0.5, k)) for k, of in enumerate((points, T_TRUE.inv().apply(points))))
    found = registrar.register(target, source)
    assert found.accepted
    assert found.reason.startswith("the scans match")
    assert_near(found.T_target_source, T_TRUE, 0.3, 0.05)
