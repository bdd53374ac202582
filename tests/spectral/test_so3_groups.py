"""The best of given rotations between two spectra, group by group."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.device import Array
from sonarmap.spectral.so3 import PARTS, RotationPeaks, Sweep, distinct_rotations
from tests.samples.structures import structure
from tests.spectral.test_so3_rotations import Spectra, turned

TILTS = Rotation.from_rotvec(np.deg2rad([[0, 0, 0], [5, 0, 0], [0, 5, 0], [-5, 0, 0], [0, -5, 0]]))
EACH = len(TILTS)
TURNS = np.arange(-180.0, 180.0, 6.0)
# group by group: all tilts of a turn
SWEEP = Rotation.concatenate([TILTS * Rotation.from_euler("Z", turn, degrees=True) for turn in TURNS])
# a turn between two of the groups, nearer to 48 degrees than to 42, and a tilt near the third, about y
TRUE = Rotation.from_rotvec(np.deg2rad([1, 4.5, 0])) * Rotation.from_euler("Z", 46.5, degrees=True)
GROUP, TILT = int(np.flatnonzero(TURNS == 48)[0]), 2


@pytest.fixture(scope="module")
def spectra() -> Spectra:
    return Spectra(np.deg2rad(20.0))


@pytest.fixture(scope="module")
def scans(spectra: Spectra) -> tuple[Array, Array]:
    return spectra.of(structure(2)), spectra.of(turned(TRUE))


def indices(R: Rotation) -> np.ndarray:
    """Where rotations are in the sweep, (n,)."""
    alike = np.abs(R.as_quat() @ SWEEP.as_quat().T)
    assert (alike.max(axis=1) > 1 - 1e-12).all()
    return alike.argmax(axis=1)


def swept(spectra: Spectra, scans: tuple[Array, Array], count: int, apart_deg: float = 0.0) -> RotationPeaks:
    """The best turns of the sweep, farther apart than this."""
    return spectra.so3.best_of(*scans, Sweep(SWEEP, EACH, np.deg2rad(apart_deg)), count)


def test_the_best_is_the_nearest_tilt_of_the_nearest_turn(spectra: Spectra, scans: tuple[Array, Array]) -> None:
    best = swept(spectra, scans, 5)
    assert indices(best.R)[0] == GROUP * EACH + TILT
    assert best.scores[0] > best.scores[1]


def test_groups_come_once_and_the_best_first(spectra: Spectra, scans: tuple[Array, Array]) -> None:
    best = swept(spectra, scans, 20)
    assert len(best.R) == len(best.scores) == 20
    assert best.scores.dtype == np.float64
    assert (np.diff(best.scores) <= 0).all()
    assert len(set(indices(best.R) // EACH)) == 20


def test_there_are_no_more_than_there_are(spectra: Spectra, scans: tuple[Array, Array]) -> None:
    every = swept(spectra, scans, 1000)
    assert sorted(indices(every.R) // EACH) == list(range(len(TURNS)))
    one_group = Sweep(SWEEP[:EACH], EACH, 0.0)
    (only,) = spectra.so3.best_of(*scans, one_group, 3).scores
    assert only in every.scores


def test_each_stands_for_its_group_by_its_highest(spectra: Spectra, scans: tuple[Array, Array]) -> None:
    """In groups of one, all rotations show their values."""
    every = spectra.so3.best_of(*scans, Sweep(SWEEP, 1, 0.0), len(SWEEP))
    values = np.empty(len(SWEEP))
    values[indices(every.R)] = every.scores
    groups = values.reshape(-1, EACH)
    best = swept(spectra, scans, len(TURNS))
    np.testing.assert_array_equal(best.scores, -np.sort(-groups.max(axis=1), kind="stable"))
    np.testing.assert_array_equal(values[indices(best.R)], best.scores)


def test_none_is_near_a_better_one(spectra: Spectra, scans: tuple[Array, Array]) -> None:
    every, apart = swept(spectra, scans, len(TURNS)), swept(spectra, scans, len(TURNS), 20.0)
    assert apart.scores[0] == every.scores[0]
    assert 8 <= len(apart.R) < len(every.R) / 2
    for n in range(1, len(apart.R)):
        nearest = (apart.R[:n].inv() * apart.R[n]).magnitude().min()
        assert np.rad2deg(nearest) > 20.0
    left_out = [R for R in every.R if np.rad2deg((apart.R.inv() * R).magnitude().min()) > 20.0]
    assert left_out == []


def test_the_value_at_a_peak_is_the_peaks(spectra: Spectra, scans: tuple[Array, Array]) -> None:
    (peaks,) = spectra.so3.candidates(*scans, 3, lambda R: np.ones(len(R), dtype=bool), PARTS[:1])
    values = spectra.so3.best_of(*scans, Sweep(peaks.R, 1, 0.0), 3).scores
    np.testing.assert_allclose(values, peaks.scores, rtol=0.05)


def test_distinct_rotations_are_those_of_all_in_their_order() -> None:
    z = [Rotation.from_euler("Z", angle, degrees=True) for angle in (0.0, 40.0, 3.0, 80.0, 44.0)]
    first = RotationPeaks(Rotation.concatenate(z[:2]), np.array([0.9, 0.5]))
    second = RotationPeaks(Rotation.concatenate(z[2:]), np.array([0.8, 0.7, 0.6]))
    found = distinct_rotations([first, second])
    np.testing.assert_allclose(np.rad2deg(found.R.magnitude()), [0, 40, 80], atol=1e-9)
    np.testing.assert_array_equal(found.scores, [0.9, 0.5, 0.7])
