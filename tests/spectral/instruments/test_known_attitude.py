"""Registration with measured attitudes: sigmas, a flat bed, and scans that lean."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import ALL, ATTITUDE, DEPTH, knowing, unexact
from tests.samples.scenes.reliefs import HERE, T_TRUE, THERE, relief, seen
from tests.samples.scenes.structures import assert_near, difference


@pytest.fixture(scope="module")
def upright(registrar: SpectralRegistrar, scans: tuple[SpectralScan, SpectralScan]) -> Registration:
    return registrar.register(*scans)


EDGE, VOXEL = 64, 0.5
SIGMAS = np.array([*np.deg2rad([1.0, 1.0, 3.0]), 1.0, 1.0, 0.15])
RELATIVE = np.sqrt(2) * SIGMAS
LEVEL = knowing(ATTITUDE, DEPTH, sigmas=SIGMAS)


@pytest.fixture(scope="module")
def registrar() -> SpectralRegistrar:
    return SpectralRegistrar(choose_device(), Grid(EDGE, VOXEL))


@pytest.fixture(scope="module")
def scans(registrar: SpectralRegistrar) -> tuple[SpectralScan, SpectralScan]:
    """Scans of a structured place, with error-free attitude and depth."""
    target, source = (registrar.prepare(Scan(seen(relief(1), T), prior=PosePrior(T, LEVEL))) for T in (HERE, THERE))
    return target, source


def off(T_target_source: RigidTransform) -> np.ndarray:
    """(6,) rotation vector and shift from the true pose, in the world's axes [rad, m]."""
    turn = HERE.rotation * T_target_source.rotation * T_TRUE.rotation.inv() * HERE.rotation.inv()
    shift = HERE.rotation.apply(T_target_source.translation - T_TRUE.translation)
    return np.concatenate([turn.as_rotvec(), shift])


def sigmas(covariance: np.ndarray) -> np.ndarray:
    """(6,) of a registration's covariance, in the world's axes [rad, m]."""
    to_world = np.kron(np.eye(2), THERE.rotation.as_matrix())
    return np.sqrt(np.diag(to_world @ covariance @ to_world.T))


def assert_not_larger(small: np.ndarray, large: np.ndarray) -> None:
    least = np.linalg.eigvalsh(large - small)[0]
    assert least > -1e-9 * np.linalg.eigvalsh(large)[-1]


class TestRelief:
    @pytest.mark.slow
    def test_by_scans_has_no_errors_of_instruments(self, registrar, scans):
        """A graph that holds the measurements beside the registration would count the errors twice."""
        plain = registrar.register(*(replace(scan, prior=None) for scan in scans)).T_target_source
        precise = knowing(*ALL, sigmas=SIGMAS / 5)
        wrong = RigidTransform.from_exp_coords([*np.deg2rad([0.6, -0.5, 0.8]), 0.4, -0.3, 0.1])
        pair = scans[0], replace(scans[1], prior=PosePrior(THERE * wrong, precise))
        registration = registrar.register(replace(pair[0], prior=PosePrior(HERE, precise)), pair[1])
        beside = difference(registration.T_target_source, plain)
        assert beside[0] > 0.2
        assert beside[1] > 0.1
        assert_near(registration.by_scans.T_target_source, plain, 0.05, 0.015)

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("seed", [1, 2])
    def test_the_pose_is_found_with_smaller_sigmas_than_by_the_scans_alone(self, registrar, scans, seed):
        rng = np.random.default_rng(seed)
        measured = (unexact(T, rng, SIGMAS, most=1.5).T_world_sensor for T in (HERE, THERE))
        pair = [replace(scan, prior=PosePrior(T, LEVEL)) for scan, T in zip(scans, measured, strict=True)]
        registration = registrar.register(*pair)
        assert_near(registration.T_target_source, T_TRUE, 0.4, 0.15)
        assert registration.accepted
        alone = registration.by_scans
        assert_not_larger(registration.covariance, alone.covariance)
        height = sigmas(registration.covariance)[5], sigmas(alone.covariance)[5]
        assert height[0] < height[1]
        # structured scans are more accurate than a measurement within a degree
        assert (sigmas(registration.covariance)[:2] < RELATIVE[:2] / 2).all()
        assert (np.abs(off(registration.T_target_source)) < 4 * sigmas(registration.covariance)).all()

    def test_candidate_rotations_have_the_measured_tilt(self, registrar, scans):
        rotations = registrar._rotations(*scans, registrar._bounds(*scans))
        assert len(rotations.scores) <= 4 * registrar.config.hypotheses
        assert (np.diff(rotations.scores) <= 0).all()
        up = (HERE.rotation * rotations.R * THERE.rotation.inv()).apply([0, 0, 1])
        assert np.arccos(np.clip(up[:, 2], -1, 1)).max() < 2.01 * RELATIVE[0]
        assert (rotations.R.inv() * T_TRUE.rotation).magnitude().min() < np.deg2rad(2.0)

    @pytest.mark.slow
    def test_by_scans_is_the_registration_without_both_priors_and_near_exact_ones(self, registrar, scans, upright):
        target, source = scans
        registration = registrar.register(target, replace(source, prior=None))
        assert registration.T_by_scans is None
        assert registration.by_scans is registration
        assert_near(upright.T_target_source, upright.by_scans.T_target_source, 0.1, 0.1 * VOXEL)


def bed(seed: int) -> np.ndarray:
    """Points of a flat ground at z = 0, (n, 3) [m]."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-32, 32, (60_000, 2)), rng.normal(0, 0.03, 60_000)])


# what the source's instruments are off by: tilt, heading and shift in the world
TILT, HEADING, SHIFT = np.deg2rad([0.9, 1.2]), np.deg2rad(2.0), np.array([0.9, -0.7, 0.15])


@pytest.fixture(scope="module")
def flat(registrar: SpectralRegistrar) -> tuple[SpectralScan, SpectralScan]:
    """Scans of a flat bed, with all instruments."""
    wrong = Rotation.from_rotvec([*TILT, 0]) * Rotation.from_euler("Z", HEADING)
    measured = RigidTransform.from_components(THERE.translation + SHIFT, wrong * THERE.rotation)
    target = registrar.prepare(Scan(seen(bed(1), HERE), prior=PosePrior(HERE, SIGMAS)))
    source = registrar.prepare(Scan(seen(bed(2), THERE), prior=PosePrior(measured, SIGMAS)))
    return target, source


@pytest.fixture(scope="module")
def of_flat(registrar: SpectralRegistrar, flat: tuple[SpectralScan, SpectralScan]) -> Registration:
    return registrar.register(*flat)


class TestFlatBed:
    def test_tilt_and_height_improve_on_the_instruments_and_the_rest_is_theirs(self, of_flat) -> None:
        assert of_flat.accepted
        assert 0.85 < of_flat.probability <= 1
        error, sigma = off(of_flat.T_target_source), sigmas(of_flat.covariance)
        assert np.linalg.norm(error[:2]) < np.linalg.norm(TILT) / 3
        assert (sigma[:2] < RELATIVE[:2] / 2).all()
        assert abs(error[5]) < 0.7 * SHIFT[2]
        assert sigma[5] < 0.85 * RELATIVE[5]
        assert (np.abs(error) < 3 * sigma).all()
        assert error[2] == pytest.approx(HEADING, abs=RELATIVE[2] / 3)
        np.testing.assert_allclose(error[3:5], SHIFT[:2], atol=RELATIVE[3] / 3)
        np.testing.assert_allclose(sigma[2:5], RELATIVE[2:5], rtol=0.1)

    def test_the_scans_alone_leave_the_rest_unconstrained(self, of_flat: Registration) -> None:
        sigma = sigmas(of_flat.by_scans.covariance)
        assert sigma[2] > np.deg2rad(30.0)
        assert (sigma[3:5] > 10.0).all()

    @pytest.mark.slow
    def test_without_a_position_it_is_refused(self, registrar, flat):
        unplaced = np.where(np.isin(np.arange(6), [3, 4]), np.inf, SIGMAS)
        registration = registrar.register(
            *(replace(scan, prior=PosePrior(scan.prior.T_world_sensor, unplaced)) for scan in flat)
        )
        assert not registration.accepted
        assert np.linalg.eigvalsh(registration.covariance)[-1] > 5.0**2

    @pytest.mark.parametrize("missing", [DEPTH, None])
    def test_without_one_of_the_instruments_the_scan_is_refused(self, registrar, missing):
        known = knowing(*(kind for kind in ALL if kind != missing), sigmas=SIGMAS)
        prior = None if missing is None else PosePrior(HERE, known)
        with pytest.raises(InputError, match=r"all its points lie in one plane .* a prior with attitude, heading"):
            registrar.prepare(Scan(seen(bed(1), HERE), prior=prior))


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "about"), [(9.0, 0.6), (9.0, 2.0), (7.5, 2.0)])
def test_leaning_scans_stay_level_with_larger_sigmas(registrar, scans, upright, degrees, about):
    """A sonar that guesses elevations shows leaning walls; both attitudes are measured within a degree.

    Without instruments the scans fit best as they lean.
    """
    axis = np.array([np.cos(about), np.sin(about), 0])
    lean = THERE.rotation.inv() * Rotation.from_rotvec(np.deg2rad(degrees) * axis) * THERE.rotation
    points = lean.apply(seen(relief(1), THERE)).astype(np.float32)
    source = registrar.prepare(Scan(points, prior=PosePrior(THERE, LEVEL)))
    leaning = registrar.register(scans[0], replace(source, prior=None))
    assert np.linalg.norm(off(leaning.T_target_source)[:2]) == pytest.approx(np.deg2rad(degrees), rel=0.05)
    registration = registrar.register(scans[0], source)
    assert np.linalg.norm(off(registration.T_target_source)[:2]) < np.deg2rad(max(4.0, 0.6 * degrees))
    tilt, usual = (sigmas(each.by_scans.covariance)[:2] for each in (registration, upright))
    assert (tilt > 2 * usual).all()
    assert (np.abs(off(registration.by_scans.T_target_source)[:2]) < 4 * tilt).all()
    assert_not_larger(registration.covariance, registration.by_scans.covariance)
