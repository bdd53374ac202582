"""Whom to believe: the probability, what it falls with, and the answers that cannot be excluded."""

from dataclasses import replace
from math import erf

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.opencl.device import choose_device
from spectral.grid import Grid, choose_grid
from spectral.registration import SpectralRegistrar
from spectral.scan import Scan
from spectral.verify.hypothesis import Origin, Refined, Verified
from spectral.verify.icp import Fit
from spectral.verify.probability import LOGISTIC, Belief, believe
from tools.simulate.pairs.pair_set import evaluation_unrelated

CLEAR = {"psr": 80.0, "distinction": 10.0, "consistency": 0.8, "rival": 1.5}


def hypothesis(psr: float, consistency: float) -> Verified:
    """One whose witnesses say this."""
    fit = Fit(Rotation.identity(), np.zeros(3), np.eye(6), 0.1, 1000.0)
    return Verified(Refined(fit, Origin(0.4, 20.0), consistency), psr, psr, 0.5)


def think(found: list[Verified], edge: int = 128, sigma: float = 0.01) -> list[Belief]:
    """Of these hypotheses, on voxels of 0.5 m, each sure to sigma [rad, m]."""
    return believe(found, [np.eye(6) * sigma**2] * len(found), Grid(edge, 0.5), 0.85)


@pytest.mark.parametrize("witness", CLEAR)
def test_the_probability_falls_with_every_witness(witness: str) -> None:
    clear = LOGISTIC.probability(**CLEAR)
    assert 0.99 < clear < 1
    assert LOGISTIC.probability(**{**CLEAR, witness: CLEAR[witness] / 2}) < clear


def test_a_pose_that_is_left_open_is_not_believed() -> None:
    """3 voxels are 1.5 m: as many standard deviations hold 68.3 % within one, 95.4 % within two."""
    best = hypothesis(80, 0.85)
    sure, one, two = (think([best], sigma=sigma)[0].probability for sigma in (0.01, 1.5, 0.75))
    assert sure > 0.99
    turn = {sigma: erf(np.deg2rad(6) / sigma / np.sqrt(2)) for sigma in (1.5, 0.75)}
    assert one == pytest.approx(sure * 0.6827 * turn[1.5], rel=1e-3)
    assert two == pytest.approx(sure * 0.9545 * turn[0.75], rel=1e-3)
    assert not think([best], sigma=0.75)[0].accepted
    assert think([best], sigma=0.75)[0].possible


def test_a_rival_makes_both_doubtful() -> None:
    alone = think([hypothesis(60, 0.8)])
    pair = [hypothesis(60, 0.8), hypothesis(58, 0.8)]
    both = think(pair)
    assert alone[0].accepted
    assert not both[0].accepted
    assert both[1].possible
    assert both[0].probability > both[1].probability
    assert both[0].probability + both[1].probability <= 1


@pytest.mark.parametrize("psr", [30.0, 90.0, 1000.0])
def test_twins_share_the_probability_however_high_their_peaks(psr: float) -> None:
    first, second = think([hypothesis(psr, 0.9), hypothesis(psr, 0.9)])
    assert first.probability == pytest.approx(second.probability)
    assert first.probability <= 0.5


def test_several_answers_are_never_more_probable_than_one() -> None:
    """A twin of the same peak, which the shift's wrap makes, is a rival like any other."""
    found = [hypothesis(60, 0.8), hypothesis(20, 0.8), hypothesis(19, 0.8)]
    beliefs = think(found)
    assert sum(belief.probability for belief in beliefs) <= 1 + 1e-12


def test_a_rival_that_the_views_like_better_counts_even_where_its_peak_is_low() -> None:
    best = hypothesis(60, 0.6)
    assert think([best, hypothesis(5, 0.9)])[0].probability < think([best, hypothesis(5, 0.5)])[0].probability


def test_a_large_grid_asks_for_higher_peaks() -> None:
    best = hypothesis(12, 0.4)
    small, large = (think([best], edge=edge)[0].probability for edge in (128, 256))
    assert large < small


def room(rng: np.random.Generator, marked: bool) -> np.ndarray:
    """A rectangular room about the sensor; alike from both ends, but for a block in one corner where it is marked."""
    n, half = 3000, np.array([28.0, 15.0, 9.0])
    sides = []
    for axis in range(3):
        for side in (-1, 1):
            points = rng.uniform(-half, half, (n, 3))
            points[:, axis] = side * half[axis]
            sides.append(points)
    if marked:
        sides.append(rng.uniform([12.0, 3.0, -9.0], [26.0, 14.0, 2.0], (2 * n, 3)))
    return np.vstack(sides) + rng.normal(0, 0.15, (sum(map(len, sides)), 3))


def test_a_room_alike_from_both_ends_is_refused_and_both_answers_are_kept() -> None:
    rng = np.random.default_rng(7)
    T = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_euler("ZYX", [25, 3, -4], degrees=True))
    registrar = SpectralRegistrar(choose_device(None), Grid(128, 0.6))
    scans = [Scan(room(rng, False).astype(np.float32)), Scan(T.inv().apply(room(rng, False)).astype(np.float32))]
    found = registrar.register(*(registrar.prepare(scan) for scan in scans))
    assert not found.accepted
    turns = [found, *found.alternatives]
    yaws = [np.rad2deg((one.T_target_source.rotation * T.rotation.inv()).magnitude()) for one in turns]
    assert min(yaws) < 3
    assert max(yaws) > 177
    assert all(0 < one.probability < 0.85 for one in turns)
    assert all(np.linalg.eigvalsh(one.covariance).min() > 0 for one in turns)


def test_the_same_room_with_a_block_in_a_corner_is_believed() -> None:
    rng = np.random.default_rng(7)
    T = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_euler("ZYX", [25, 3, -4], degrees=True))
    registrar = SpectralRegistrar(choose_device(None), Grid(128, 0.6))
    scans = [Scan(room(rng, True).astype(np.float32)), Scan(T.inv().apply(room(rng, True)).astype(np.float32))]
    found = registrar.register(*(registrar.prepare(scan) for scan in scans))
    assert found.accepted
    assert np.rad2deg((found.T_target_source.rotation * T.rotation.inv()).magnitude()) < 1


@pytest.mark.parametrize("number", range(4))
def test_scans_that_share_nothing_are_refused(number: int) -> None:
    target, source = evaluation_unrelated(number, 4242).scans()
    registrar = SpectralRegistrar(choose_device(None), choose_grid((target, source)))
    found = registrar.register(registrar.prepare(target), registrar.prepare(source))
    assert not found.accepted
    assert found.probability < 0.85
    assert replace(found, alternatives=()).reason
