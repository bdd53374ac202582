"""The probability of hypotheses, and alternatives that cannot be excluded."""

from math import erf

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.judgement import clues, fixed_probability, place_probabilities
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.verify.fit import Fit
from sonarmap.spectral.verify.hypothesis import Evidence, Hypothesis
from sonarmap.spectral.verify.verifier import Observability
from tests.samples.scenes.structures import registered

GRID = Grid(128, 0.5)
SURE = np.diag(np.repeat([0.01, 0.15], 3) ** 2)
SHARP = Observability(np.eye(3), np.full((3, 3, 2), 0.3), np.full(2, 0.6))
BLURRED = Observability(np.eye(3), np.full((3, 3, 2), 1.0), np.full(2, 1.0))


def hypothesis(psr: float, view: float, width: float = 0.15) -> Hypothesis:
    """A hypothesis with this evidence."""
    fit = Fit(Rotation.identity(), np.zeros(3), np.eye(6), 0.1, 1000.0)
    evidence = Evidence(view, view, 0.6, 0.5, 0.1, width, 0.12, psr, 40.0)
    return Hypothesis(fit, 0.4, 20.0, evidence)


def probabilities(*hypotheses: Hypothesis, seen: Observability = SHARP, search: float = 0.0) -> list[float]:
    return place_probabilities(hypotheses, clues(hypotheses, seen, SURE, GRID, search))


@pytest.mark.parametrize(
    "worse",
    [{"best": hypothesis(12.0, 0.8)}, {"best": hypothesis(60.0, 0.2)}, {"seen": BLURRED}],
    ids=["peak", "view", "blurred"],
)
def test_the_probability_falls_with_the_evidence(worse) -> None:
    (clear,) = probabilities(hypothesis(60.0, 0.8))
    (less,) = probabilities(worse.get("best", hypothesis(60.0, 0.8)), seen=worse.get("seen", SHARP))
    assert 0.9 < clear < 1
    assert less < clear


def test_an_unconstrained_pose_is_less_probable() -> None:
    """3 voxels are 1.5 m: one standard deviation holds 68.3 % and two hold 95.4 %."""
    sure, one_sigma, two_sigma = (fixed_probability(np.eye(6) * sigma**2, 0.5) for sigma in (0.01, 1.5, 0.75))
    assert sure > 0.999999
    turn = {sigma: erf(np.deg2rad(6) / sigma / np.sqrt(2)) for sigma in (1.5, 0.75)}
    assert one_sigma == pytest.approx(0.6827 * turn[1.5], rel=1e-3)
    assert two_sigma == pytest.approx(0.9545 * turn[0.75], rel=1e-3)


@pytest.mark.parametrize(
    ("left_open", "instruments", "unsure"),
    [
        # navigation knows the shift to 1.4 m, the scans leave it open; an unsure one knows it to 30 m
        ([1e-3, 1e-3, 1e-3, 1.4, 0.1, 0.1], [0.03, 0.03, 0.03, 1.4, 1.4, 0.3], [0.03, 0.03, 0.03, 30, 30, 0.3]),
        # about an upright tank the heading is open; a vehicle that turns at lanes' ends has it within 21 degrees
        ([0.01, 0.01, np.deg2rad(13), 0.1, 0.1, 0.1], [0.3, 0.3, np.deg2rad(21), 1, 1, 1], [0.3, 0.3, 1.05, 1, 1, 1]),
    ],
)
def test_errors_within_three_sigmas_of_instruments_are_allowed(left_open, instruments, unsure) -> None:
    scans, known, unknown = (np.diag(np.square(sigmas)) for sigmas in (left_open, instruments, unsure))
    assert fixed_probability(scans, 0.2) < 0.4
    assert fixed_probability(scans, 0.2, known) > 0.99
    assert fixed_probability(scans, 0.2, unknown) == pytest.approx(fixed_probability(scans, 0.2))


def test_a_rival_lowers_the_probability_of_both() -> None:
    (alone,) = probabilities(hypothesis(60, 0.8))
    best, rival = probabilities(hypothesis(60, 0.8), hypothesis(58, 0.8))
    assert alone > 0.85 > best > rival > 0.01
    # a twin of the same peak, which the shift's wrap makes, is a rival like any other
    several = probabilities(hypothesis(60, 0.8), hypothesis(20, 0.8), hypothesis(19, 0.8))
    assert max(best + rival, sum(several)) <= 1 + 1e-12


@pytest.mark.parametrize("psr", [30.0, 1000.0])
def test_twins_share_the_probability_however_high_their_peaks(psr: float) -> None:
    first, second = probabilities(hypothesis(psr, 0.9), hypothesis(psr, 0.9))
    assert first == pytest.approx(second)
    assert first <= 0.5


def room(rng: np.random.Generator, marked: bool) -> np.ndarray:
    """A rectangular room about the sensor, symmetric except for a block in one corner if it is marked."""
    n, half = 3000, np.array([28.0, 15.0, 9.0])
    sides = [rng.uniform(-half, half, (n, 3)) for _ in range(6)]
    for k, points in enumerate(sides):
        points[:, k // 2] = (-1, 1)[k % 2] * half[k // 2]
    if marked:
        low, high = np.array([12.0, 3.0, -9.0]), np.array([26.0, 14.0, 2.0])
        faces = rng.uniform(low, high, (2 * n, 3))
        axis, upper = rng.integers(3, size=2 * n), rng.random(2 * n) < 0.5
        faces[np.arange(2 * n), axis] = np.where(upper, high[axis], low[axis])
        sides.append(faces)
    return np.vstack(sides) + rng.normal(0, 0.15, (sum(map(len, sides)), 3))


def registered_room(marked: bool) -> tuple[Registration, RigidTransform]:
    """Two scans of a room, registered, and the true T_target_source."""
    rng = np.random.default_rng(7)
    T = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_euler("ZYX", [25, 3, -4], degrees=True))
    target, source = room(rng, marked), T.inv().apply(room(rng, marked))
    return registered(SpectralRegistrar(choose_device(None), Grid(128, 0.6)), target, source), T


@pytest.mark.slow
def test_a_symmetric_room_is_refused_and_both_poses_are_kept() -> None:
    registration, T = registered_room(marked=False)
    assert not registration.accepted
    answers = [registration, *registration.alternatives]
    turns = [np.rad2deg((answer.T_target_source.rotation * T.rotation.inv()).magnitude()) for answer in answers]
    assert min(turns) < 3
    assert max(turns) > 177
    assert all(0 < answer.probability < 0.85 for answer in answers)
    assert all(np.linalg.eigvalsh(answer.covariance).min() > 0 for answer in answers)


@pytest.mark.slow
def test_the_same_room_with_a_block_in_a_corner_is_accepted() -> None:
    registration, T = registered_room(marked=True)
    assert registration.accepted
    assert np.rad2deg((registration.T_target_source.rotation * T.rotation.inv()).magnitude()) < 1


def test_a_rival_with_better_views_counts_despite_a_low_peak() -> None:
    best = hypothesis(60, 0.6)
    assert probabilities(best, hypothesis(5, 0.9))[0] < probabilities(best, hypothesis(5, 0.3))[0]


def test_few_poses_to_search_make_chance_agreement_rarer() -> None:
    both = hypothesis(15, 0.6), hypothesis(12, 0.55)
    assert probabilities(*both, search=-6.0)[0] > probabilities(*both, search=0.0)[0]
