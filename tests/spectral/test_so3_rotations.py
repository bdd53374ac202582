"""Rotations between two spectra: accuracy, order, distinctness and bounds."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Array, choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.prepared import Preparer
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.so3 import PARTS, RotationPeaks, So3, Sweep, distinct_rotations
from tests.samples.scenes.reliefs import HERE, T_TRUE, THERE, relief, seen
from tests.samples.scenes.structures import structure

EDGE = 32


class Spectra:
    """Coefficients of scans on one grid."""

    def __init__(self, max_tilt: float) -> None:
        device = choose_device()
        self.so3, self._preparer = So3(device, EDGE, max_tilt), Preparer(device, Grid(EDGE, 0.8), use_strength=False)

    def of(self, points: np.ndarray) -> Array:
        _, magnitude = self._preparer.prepare(Scan(points))
        return self.so3.analyze(magnitude).read().coefficients

    def best(
        self, target: Array, source: Array, count: int, allowed: Callable[[Rotation], np.ndarray]
    ) -> RotationPeaks:
        """The highest of all layers together."""
        (peaks,) = self.so3.candidates(target, source, count, allowed, PARTS[:1])
        return peaks


@pytest.fixture(scope="module")
def spectra() -> Spectra:
    return Spectra(np.pi)


@pytest.fixture(scope="module")
def target(spectra: Spectra) -> Array:
    return spectra.of(structure(2))


def turned(R_target_source: Rotation) -> np.ndarray:
    return R_target_source.inv().apply(structure(2)).astype(np.float32)


def everything(R: Rotation) -> np.ndarray:
    return np.ones(len(R), dtype=bool)


def errors(peaks: RotationPeaks, true: Rotation) -> np.ndarray:
    return np.rad2deg((peaks.R * true.inv()).magnitude())


ANY = [(2.5, -1.0, 0.7), (0.0, 3.1, 0.0), (0.0, 0.0, 0.01), (0.0, 0.0, -2.0), (-1.6, 0.1, 0.2), (0.3, 1.5, -2.4)]


@pytest.mark.parametrize("rotvec", ANY)
def test_the_true_rotation_is_the_best_between_samples_too(spectra, target, rotvec):
    true = Rotation.from_rotvec(rotvec)
    peaks = spectra.best(target, spectra.of(turned(true)), 4, everything)
    assert errors(peaks, true)[0] < 1.4  # samples are 1.9 and 2.8 degrees apart
    assert peaks.scores[0] > peaks.scores[1]


def test_rotations_are_distinct_and_the_best_first(spectra: Spectra, target: Array) -> None:
    peaks = spectra.best(target, spectra.of(structure(3)), 12, everything)
    assert len(peaks.scores) == len(peaks.R) == 12
    assert (np.diff(peaks.scores) <= 0).all()
    between = [(a.inv() * b).magnitude() for n, a in enumerate(peaks.R) for b in peaks.R[:n]]
    assert np.rad2deg(min(between)) >= 6.99
    # twice is the same
    again = spectra.best(target, spectra.of(structure(3)), 12, everything)
    np.testing.assert_array_equal(peaks.R.as_quat(), again.R.as_quat())
    np.testing.assert_array_equal(peaks.scores, again.scores)


def test_only_allowed_rotations_are_returned(spectra: Spectra, target: Array) -> None:
    source = spectra.of(turned(Rotation.from_rotvec([0.1, 0.0, 0.3])))

    def upside_down(R: Rotation) -> np.ndarray:
        return R.apply([0, 0, 1])[:, 2] < 0

    peaks = spectra.best(target, source, 5, upside_down)
    assert len(peaks.R) == 5
    assert upside_down(peaks.R).all()
    nothing = spectra.best(target, source, 5, lambda R: np.zeros(len(R), dtype=bool))
    assert (len(nothing.R), len(nothing.scores)) == (0, 0)


def test_a_bound_on_tilt_bounds_the_vertical(target: Array) -> None:
    """Roll and pitch of 20 degrees each tilt it by 28 degrees."""
    bounded = Spectra(float(np.deg2rad(20.0)))
    away = np.arccos(np.cos(np.deg2rad(20.0)) ** 2)
    source = bounded.of(structure(5))
    peaks = bounded.best(target, source, 40, everything)
    tilts = np.arccos(peaks.R.apply([0, 0, 1])[:, 2])
    assert tilts.max() < away + np.deg2rad(4.0)
    true = Rotation.from_euler("ZYX", [130, 19.5, -19.5], degrees=True)
    assert errors(bounded.best(target, bounded.of(turned(true)), 1, everything), true)[0] < 1.5


@pytest.mark.parametrize("seed", [1])
def test_partly_overlapping_scans_have_the_true_rotation_among_the_best(spectra: Spectra, seed: int) -> None:
    target, source = (spectra.of(seen(relief(seed), T)) for T in (HERE, THERE))
    peaks = spectra.best(target, source, 12, everything)
    assert errors(peaks, T_TRUE.rotation).min() < 4.0


TILTS = Rotation.from_rotvec(np.deg2rad([[0, 0, 0], [5, 0, 0], [0, 5, 0], [-5, 0, 0], [0, -5, 0]]))
EACH = len(TILTS)
TURNS = np.arange(-180.0, 180.0, 6.0)
# group by group: all tilts of a turn
SWEEP = Rotation.concatenate([TILTS * Rotation.from_euler("Z", turn, degrees=True) for turn in TURNS])
# a turn between two of the groups, nearer to 48 degrees than to 42, and a tilt near the third, about y
TRUE = Rotation.from_rotvec(np.deg2rad([1, 4.5, 0])) * Rotation.from_euler("Z", 46.5, degrees=True)
GROUP, TILT = int(np.flatnonzero(TURNS == 48)[0]), 2


@pytest.fixture(scope="module")
def bounded() -> Spectra:
    return Spectra(np.deg2rad(20.0))


@pytest.fixture(scope="module")
def scans(bounded: Spectra) -> tuple[Array, Array]:
    return bounded.of(structure(2)), bounded.of(turned(TRUE))


def indices(R: Rotation) -> np.ndarray:
    """Where rotations are in the sweep, (n,)."""
    alike = np.abs(R.as_quat() @ SWEEP.as_quat().T)
    assert (alike.max(axis=1) > 1 - 1e-12).all()
    return alike.argmax(axis=1)


def swept(bounded: Spectra, scans: tuple[Array, Array], count: int) -> RotationPeaks:
    """The best turns of the sweep."""
    return bounded.so3.best_of(*scans, Sweep(SWEEP, EACH, 0.0), count)


def test_distinct_rotations_are_those_of_all_in_their_order() -> None:
    z = [Rotation.from_euler("Z", angle, degrees=True) for angle in (0.0, 40.0, 3.0, 80.0, 44.0)]
    first = RotationPeaks(Rotation.concatenate(z[:2]), np.array([0.9, 0.5]))
    second = RotationPeaks(Rotation.concatenate(z[2:]), np.array([0.8, 0.7, 0.6]))
    found = distinct_rotations([first, second])
    np.testing.assert_allclose(np.rad2deg(found.R.magnitude()), [0, 40, 80], atol=1e-9)
    np.testing.assert_array_equal(found.scores, [0.9, 0.5, 0.7])


def test_each_band_is_searched_by_itself(spectra: Spectra, target: Array) -> None:
    """One batch gives the result of separate calls; `allowed` is applied to all bands."""
    true = Rotation.from_rotvec([0.3, -0.2, 1.9])
    source = spectra.of(turned(true))
    together = spectra.so3.candidates(target, source, 4, everything)
    assert len(together) == len(PARTS) - 1
    for part, peaks in zip(PARTS[1:], together, strict=True):
        (alone,) = spectra.so3.candidates(target, source, 4, everything, [part])
        np.testing.assert_allclose(peaks.scores, alone.scores, rtol=1e-5)
        np.testing.assert_allclose((peaks.R * alone.R.inv()).magnitude(), 0, atol=1e-3)
        assert errors(peaks, true).min() < 2.5


def test_groups_come_once_and_the_best_first_and_no_more_than_there_are(bounded, scans: tuple[Array, Array]) -> None:
    """The best is the tilt nearest to the truth, of the turn nearest to it."""
    best = swept(bounded, scans, 20)
    assert indices(best.R)[0] == GROUP * EACH + TILT
    assert best.scores[0] > best.scores[1]
    assert (np.diff(best.scores) <= 0).all()
    assert len(set(indices(best.R) // EACH)) == len(best.R) == len(best.scores) == 20
    every = swept(bounded, scans, 1000)
    assert sorted(indices(every.R) // EACH) == list(range(len(TURNS)))
    one_group = Sweep(SWEEP[:EACH], EACH, 0.0)
    (only,) = bounded.so3.best_of(*scans, one_group, 3).scores
    assert only in every.scores


def test_peaks_are_examined_until_enough_are_allowed(spectra: Spectra, target: Array) -> None:
    """More than one batch, as few rotations are allowed."""
    source = spectra.of(structure(3))

    def rarely(R: Rotation) -> np.ndarray:
        return R.apply([1, 0, 0])[:, 1] > 0.97

    every, few = (spectra.best(target, source, 10_000, which) for which in (everything, rarely))
    assert len(few.R) >= 3
    assert rarely(few.R).all()
    assert len(every.R) > 64 or len(every.R) > len(few.R)
