"""Priors as measurements: residuals, covariances and Jacobians, and the search ranges by priors."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.prior import RelativePrior
from sonarmap.spectral.scan import PosePrior
from tests.samples.relative_priors import (
    ALL,
    ATTITUDE,
    DEPTH,
    HEADING,
    POSITION,
    SURE,
    T_SOURCE,
    T_TARGET,
    T_TRUE,
    Kinds,
    about_vertical,
    at,
    between,
    knowing,
    names_of,
    pair,
    unexact,
)


def perturbed(T: RigidTransform, tangent: np.ndarray) -> RigidTransform:
    """R <- Exp(w) R, t <- t + s of (n, 6) tangents."""
    R = Rotation.from_rotvec(tangent[:, :3]) * T.rotation
    return RigidTransform.from_components(T.translation + tangent[:, 3:], R)


def differences(relative: RelativePrior, T: RigidTransform, step: float = 1e-5) -> np.ndarray:
    """The jacobian of the residuals by central differences, (k, 6)."""
    ahead, behind = (at(relative, perturbed(T, sign * step * np.eye(6))).residual for sign in (1, -1))
    return (ahead - behind).T / (2 * step)


EVERY: list[Kinds] = [
    tuple(kind for kind, known in zip(ALL, knows, strict=True) if known) for knows in product([True, False], repeat=4)
]


def known(target: Kinds, source: Kinds) -> list[bool]:
    """(6,) bool, which of tilt, tilt, turn, East, North and Up instruments measure in full."""
    both = [kind in target and kind in source for kind in ALL]
    attitude, heading, position, depth = both
    leveled = ATTITUDE in target or ATTITUDE in source
    headed = any(ATTITUDE in kinds and HEADING in kinds for kinds in (target, source))
    return [attitude, attitude, attitude and heading, position and headed, position and headed, depth and leveled]


def tilted(tilt: tuple[float, float], turn: float) -> RigidTransform:
    """The true pose with these errors of tilt and turn in the world [rad], and of the shift."""
    off = Rotation.from_rotvec([*tilt, 0]) * Rotation.from_euler("Z", turn)
    R = T_TARGET.rotation.inv() * off * T_SOURCE.rotation
    return RigidTransform.from_components(T_TRUE.translation + np.array([0.7, -0.4, 0.3]), R)


@pytest.mark.parametrize("target", EVERY, ids=names_of)
class TestWhateverIsKnown:
    @pytest.mark.quick_cases(5)
    def test_the_measured_pose_has_no_residuals(self, target: Kinds) -> None:
        for source in EVERY:
            residuals = at(between(target, source), T_TRUE).residual
            assert residuals.shape == (1, sum(known(target, source)))
            np.testing.assert_allclose(residuals, 0, atol=1e-12)

    @pytest.mark.quick_cases(5)
    def test_the_covariance_is_of_the_residuals(self, target: Kinds) -> None:
        for source in EVERY:
            count = sum(known(target, source))
            covariance = at(between(target, source), T_TRUE).covariance[0]
            assert covariance.shape == (count, count)
            np.testing.assert_allclose(covariance, covariance.T, atol=1e-15)
            assert (np.linalg.eigvalsh(covariance) > 0).all()

    @pytest.mark.quick_cases(5)
    def test_the_jacobian_is_exact_where_no_tilt_is_left(self, target: Kinds) -> None:
        for source in EVERY:
            relative, T = between(target, source), tilted((0.0, 0.0), 0.3)
            np.testing.assert_allclose(at(relative, T).jacobian[0], differences(relative, T), atol=1e-6)


class TestResiduals:
    def test_they_are_the_tilts_the_turn_and_the_shift_in_the_world_in_this_order(self) -> None:
        tilt, turn, shift = (0.03, -0.05), 0.2, np.array([1.0, 2.0, -3.0])
        T = tilted(tilt, turn)
        t = T_TRUE.translation + T_TARGET.rotation.inv().apply(shift)
        residuals = pair(*ALL).at(T.rotation, t).residual
        np.testing.assert_allclose(residuals, [[*tilt, turn, *shift]], atol=1e-12)

    def test_with_the_source_as_reference_they_are_those_of_the_inverse(self) -> None:
        """The source alone knows its heading: the world's axes are by its instruments."""
        relative = between((ATTITUDE, POSITION, DEPTH), ALL)
        shift = np.array([1.0, 2.0, -3.0])
        moved = RigidTransform.from_components(T_SOURCE.translation - shift, T_SOURCE.rotation)
        residuals = at(relative, T_TARGET.inv() * moved).residual
        np.testing.assert_allclose(residuals, [[0, 0, *shift]], atol=1e-12)


DRAWS, BOXES = 800, 150


@pytest.fixture(scope="module")
def draws() -> list[tuple[PosePrior, PosePrior]]:
    """Measurements of the true poses, with the instruments' errors."""
    rng = np.random.default_rng(7)
    return [(unexact(T_TARGET, rng, SURE), unexact(T_SOURCE, rng, SURE)) for _ in range(DRAWS)]


def redrawn(draw: tuple[PosePrior, PosePrior], target: Kinds, source: Kinds) -> RelativePrior:
    """The prior with only some components measured; an unmeasured heading gets another value."""
    priors = []
    for measured, kinds, turn in zip(draw, (target, source), (0.0, 1.3), strict=True):
        T = measured.T_world_sensor if HEADING in kinds else about_vertical(turn) * measured.T_world_sensor
        priors.append(PosePrior(T, knowing(*kinds, sigmas=SURE)))
    return RelativePrior(*priors)


@pytest.mark.parametrize(
    ("target", "source"),
    [
        (ALL, ALL),
        ((ATTITUDE, DEPTH), (ATTITUDE, DEPTH)),
        ((ATTITUDE, POSITION, DEPTH), ALL),
        ((HEADING, DEPTH), (ATTITUDE, DEPTH)),
    ],
    ids=names_of,
)
@pytest.mark.slow
def test_the_covariance_is_that_of_the_instruments_errors(draws, target, source):
    """Whitened variances of 800 draws are 1 within 4 standard deviations, 20 %, and the means are 0."""
    residuals = np.array([at(redrawn(draw, target, source), T_TRUE).residual[0] for draw in draws])
    exact = redrawn((PosePrior(T_TARGET, SURE), PosePrior(T_SOURCE, SURE)), target, source)
    whitening = np.linalg.inv(np.linalg.cholesky(at(exact, T_TRUE).covariance[0]))
    white = residuals @ whitening.T
    np.testing.assert_allclose(white.T @ white / DRAWS, np.eye(white.shape[1]), atol=4 * np.sqrt(2 / DRAWS))
    np.testing.assert_allclose(white.mean(axis=0), 0, atol=4 / np.sqrt(DRAWS))


class TestReaches:
    def test_the_tilts_sigma_is_that_of_the_less_certain_axis_of_both_scans(self) -> None:
        sigmas = np.array([0.03, 0.01, 1, 1, 1, 1]), np.array([0.04, 0.02, 1, 1, 1, 1])
        relative = RelativePrior(PosePrior(T_TARGET, sigmas[0]), PosePrior(T_SOURCE, sigmas[1]))
        assert relative.tilt_sigma == pytest.approx(0.05)


class TestShiftBox:
    def test_the_truth_is_inside_four_sigmas_from_the_sides(self) -> None:
        rng = np.random.default_rng(8)
        off = []
        for _ in range(BOXES):
            relative = RelativePrior(unexact(T_TARGET, rng, SURE), unexact(T_SOURCE, rng, SURE))
            box = relative.shift_box(T_TRUE.rotation)
            assert box is not None
            off.append((T_TRUE.translation - box[0]) / box[1])
        assert (np.abs(off) > 1).sum() <= 2  # 0.1 are to be expected
        np.testing.assert_allclose(np.std(off, axis=0), 0.25, rtol=4 / np.sqrt(2 * BOXES))

    def test_its_widths_are_along_the_targets_axes(self) -> None:
        """The target looks North: East's error is along its y axis, backward."""
        sigmas = np.array([1e-6, 1e-6, 1e-6, 3.0, 1.0, 0.2])
        target, source = about_vertical(np.pi / 2, (1, 2, 3)), about_vertical(0.4, (5, 9, 4))
        box = RelativePrior(PosePrior(target, sigmas), PosePrior(source, sigmas)).shift_box(Rotation.identity())
        assert box is not None
        np.testing.assert_allclose(box[0], [7, -4, 1], atol=1e-9)
        np.testing.assert_allclose(box[1], 4 * np.sqrt(2) * np.array([1.0, 3.0, 0.2]), rtol=1e-4)
