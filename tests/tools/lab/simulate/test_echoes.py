"""Echo strengths: the beam pattern, speckle, the threshold that narrows the field, and ranges in steps."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import RigidTransform
from scipy.stats import kstest

from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.scenes.solids import box
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb, scan_of
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, PAPER, Echoes, Sensor, bare, cast
from tests.samples.scenes.simulated import COARSE, QUIET

ALL = Noise(sigma2=1.5, outliers=0.05, dropouts=0.1, ghosts=0.2, speckle=1.0)


def generator(seed: int = 7) -> np.random.Generator:
    return np.random.default_rng(seed)


def varied(shape: tuple[int, int] = (60, 90)) -> tuple[Echoes, Echoes]:
    """Echoes of many ranges and strengths, a tenth of them missing, and ghosts behind half of the beams."""
    rng = generator(2)
    missing, far = rng.random(shape) < 0.1, rng.random(shape) < 0.5
    ranges = np.where(missing, np.inf, rng.uniform(2, 60, shape))
    ghosts = np.where(far, np.inf, rng.uniform(60, 110, shape))
    return (
        Echoes(ranges, np.where(missing, 0.0, rng.uniform(0, 1, shape))),
        Echoes(ghosts, np.where(far, 0.0, rng.uniform(0, 0.3, shape))),
    )


def test_the_pattern_and_the_absorption_weaken_the_echo_of_a_wall():
    scene = Scene("wall", box((30.5, 0, 0), (1.0, 400.0, 400.0)))
    sensor = replace(COARSE, edge_loss=13.0, absorption=0.4)
    echoes = cast(scene, sensor, RigidTransform.identity())
    cosine = sensor.directions()[..., 0]
    off_middle = np.rad2deg(np.arccos(cosine))
    decibel = 20 * np.log10(cosine) - 2 * 0.4 * 30 / cosine - 13.0 * (off_middle / 45) ** 2
    assert_allclose(10 * np.log10(echoes.strengths), decibel, rtol=1e-6)


def test_full_speckle_is_exponential_and_keeps_the_mean():
    echoes = Echoes(np.full((200, 300), 40.0), np.full((200, 300), 0.7))
    strengths = disturb(echoes, bare(ECLIPSE), Noise(speckle=1.0), generator()).strengths.ravel()
    # the standard error of the mean of n exponentials is mean / sqrt(n); four of them
    assert_allclose(strengths.mean(), 0.7, rtol=4 / np.sqrt(strengths.size))
    assert kstest(strengths, "expon", args=(0, 0.7)).pvalue > 1e-3
    amplitude = np.sqrt(strengths)
    assert kstest(amplitude, "rayleigh", args=(0, np.sqrt(0.35))).pvalue > 1e-3
    partial = disturb(echoes, bare(ECLIPSE), Noise(speckle=0.3), generator()).strengths
    assert_allclose(partial.mean(), 0.7, rtol=0.01)
    assert_allclose(partial.std(), 0.3 * 0.7, rtol=0.03)
    assert partial.min() >= 0.7 * 0.7


@pytest.mark.parametrize("noise", [QUIET, Noise(speckle=0.5), ALL])
def test_a_higher_threshold_keeps_a_subset_of_the_beams(noise: Noise):
    echoes, ghosts = varied()
    before = None
    for threshold in (0.0, 0.05, 0.2, 0.6):
        heard = disturb(echoes, replace(ECLIPSE, threshold=threshold), noise, generator(), ghosts).ranges
        kept = np.isfinite(heard)
        if before is not None:
            assert (kept & np.isinf(before)).sum() == 0
            assert kept.sum() < np.isfinite(before).sum()
            assert_array_equal(heard[kept], before[kept])
        before = heard


@pytest.mark.parametrize("change", [{"speckle": 0.0}, {"outliers": 0.0}, {"dropouts": 0.0}, {"ghosts": 0.0}])
def test_switching_one_noise_off_keeps_the_draws_of_the_others(change: dict[str, float]):
    echoes, ghosts = varied()
    sensor = bare(ECLIPSE)
    all_on = disturb(echoes, sensor, ALL, generator(), ghosts).ranges
    without = disturb(echoes, sensor, replace(ALL, **change), generator(), ghosts).ranges
    same = (all_on == without).mean()
    least = {"speckle": 1.0, "outliers": 0.94, "dropouts": 0.89, "ghosts": 0.85}[next(iter(change))]
    assert same >= least
    assert same < 1 or "speckle" in change


@pytest.mark.parametrize(("sensor", "step"), [(ECLIPSE, 0.025), (replace(PAPER, resolution=0.3), 0.3)])
def test_ranges_are_multiples_of_the_resolution(sensor: Sensor, step: float):
    echoes, ghosts = varied()
    heard = disturb(echoes, replace(sensor, threshold=0.0), QUIET, generator()).ranges
    seen = np.isfinite(echoes.ranges)
    assert_array_equal(np.isfinite(heard), seen)
    assert np.abs(heard[seen] - echoes.ranges[seen]).max() <= step / 2 + 1e-12
    noisy = disturb(echoes, sensor, ALL, generator(), ghosts).ranges
    steps = noisy[np.isfinite(noisy)] / step
    assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert sensor.min_range <= noisy.min()
    assert noisy[np.isfinite(noisy)].max() <= sensor.max_range


def test_wide_lobes_give_neighbors_equal_ranges_and_lose_fewer_echoes():
    rng = np.random.default_rng(3)
    echoes = Echoes(rng.uniform(20, 60, (96, 128)), np.full((96, 128), 0.5))
    sensor = replace(bare(ECLIPSE), threshold=0.3)
    noises = [Noise(sigma2=0.1, speckle=1.0, lobe=lobe) for lobe in (0.0, 1.0, 1.0)]
    thin, wide, again = (disturb(echoes, sensor, noise, generator()).ranges for noise in noises)
    assert_array_equal(again, wide)
    seen = np.isfinite(wide)
    assert np.isfinite(thin).mean() < seen.mean()
    equal = wide[:, 1:] == wide[:, :-1]
    assert 0.35 < equal[seen[:, 1:] & seen[:, :-1]].mean() < 0.8
    assert not (thin[:, 1:] == thin[:, :-1])[np.isfinite(thin[:, 1:])].any()


def test_a_scan_carries_the_strengths_of_its_own_points():
    echoes, ghosts = varied((ECLIPSE.rows, ECLIPSE.columns))
    heard = disturb(echoes, ECLIPSE, ALL, generator(), ghosts)
    scan = scan_of(heard, ECLIPSE)
    kept = np.isfinite(heard.ranges)
    assert_array_equal(scan.strength, heard.strengths[kept].astype(np.float32))
    assert_allclose(np.linalg.norm(scan.points, axis=1), heard.ranges[kept], rtol=1e-6)
    assert 0.1 < kept.mean() < 0.9
