"""The offset between two clocks, from simulated turn rates."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.clocks.time_offset import estimate_offset, heading_rates
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.tools.files.readers.navigation.logs import START, read, scans_at


def turning(rng: np.random.Generator, seconds: float = 600.0) -> tuple[np.ndarray, np.ndarray]:
    """Times at 50 Hz and turn rates [rad/s] of a vehicle that is steered at random: legs, turns and some yawing."""
    times = np.arange(0.0, seconds, 0.02)
    knots = np.arange(0.0, seconds + 8, 8.0)
    turns = np.where(rng.random(len(knots)) < 0.4, rng.normal(0, 0.15, len(knots)), 0.0)
    sway = 0.02 * np.interp(times, knots[::1], rng.normal(size=len(knots))) * np.sin(0.9 * times)
    return times, np.interp(times, knots, turns) + sway


def sampled(
    times: np.ndarray, rates: np.ndarray, step: float, noise: float, rng: np.random.Generator, first: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """What an instrument measures, every `step` seconds with some jitter."""
    at = np.arange(first, times[-1], step)
    at = np.sort(at + rng.uniform(-0.1, 0.1, len(at)) * step)
    return at, np.interp(at, times, rates) + rng.normal(0, noise, len(at))


@pytest.mark.parametrize("offset", [37.0, -18.0, 0.0, 3.21, -59.0])
@pytest.mark.parametrize("step", [0.1, 0.5])
def test_offsets_come_back(offset: float, step: float) -> None:
    """A heading of 10 or 1 Hz beside an IMU of 20 Hz with a bias and another scale, within 0.1 s and 4 sigmas."""
    for seed in range(3):
        rng = np.random.default_rng([seed, int(10 * step), int(offset + 100)])
        times, rates = turning(rng)
        heading = np.cumsum(rates) * 0.02
        at = np.arange(20.0, 580.0, step)
        degrees = np.degrees(0.3 - np.interp(at, times, heading)) % 360 + rng.normal(0, 0.05, len(at))
        imu_times, imu_rates = sampled(times, 1.1 * rates + 0.01, 0.05, 0.01, rng)
        estimate = estimate_offset(*heading_rates(at - offset, degrees), imu_times, imu_rates)
        assert abs(estimate.seconds - offset) < 0.1
        assert abs(estimate.seconds - offset) < 5 * estimate.sigma + 0.01
        assert estimate.correlation > 0.5


def test_rates_that_say_nothing_are_refused() -> None:
    rng = np.random.default_rng(5)
    times, rates = turning(rng)
    truth = sampled(times, rates, 0.1, 0.01, rng)
    still = np.full(6000, 0.3)
    grid = np.arange(6000) * 0.1
    noise = rng.normal(0, 0.1, 6000)
    circle = 0.2 * np.sin(2 * np.pi * grid / 20)
    for (a_times, a), (b_times, b), words in (
        ((grid, still), truth, "does not turn"),
        ((grid, 0 * still), (grid, 0 * still), "does not turn"),
        ((grid, noise), truth, "agree at no offset"),
        ((grid, circle), (grid + 7, circle), "nearly as well at"),
        ((grid, circle + noise / 30), (grid + 7, circle + noise[::-1] / 30), "nearly as well at"),
        ((grid[:100], truth[1][:100]), (grid[:100], truth[1][:100]), "less than 20 s in common"),
        ((grid[:2], still[:2]), truth, "three turn rates"),
        ((grid[::-1], still), truth, "ascend"),
        ((np.array([0.0, 0.1, 0.2, 1e12]), still[:4]), truth, "span 11574074 days, or have a jump"),
        (
            (np.array([0.0, 1.0, 2.0, 26 * 86_400.0]), still[:4]),
            truth,
            "span 26 days, or have a jump",
        ),  # took a gigabyte
    ):
        with pytest.raises(InputError, match=f"offset cannot be estimated: .*{words}.*--nav-offset"):
            estimate_offset(a_times, a, b_times, b)


def test_offsets_beyond_the_limit_are_refused() -> None:
    rng = np.random.default_rng(8)
    times, rates = turning(rng)
    a, b = sampled(times, rates, 0.1, 0.005, rng), sampled(times, rates, 0.1, 0.005, rng)
    with pytest.raises(InputError, match="cannot be estimated"):
        estimate_offset(a[0] - 90, a[1], *b)
    assert estimate_offset(a[0] - 90, a[1], *b, most=120).seconds == pytest.approx(90, abs=0.1)


def test_many_draws_are_right_or_refused() -> None:
    """Dives of any length, calm or not, instruments of any rate: whatever is not refused is within 0.1 s."""
    sigmas: list[float] = []
    for seed in range(120):
        rng = np.random.default_rng([29, seed])
        times, rates = turning(rng, float(rng.uniform(60, 600)))
        rates = rates * rng.uniform(0.1, 1)
        offset = float(rng.uniform(-40, 40))
        a, b = (
            sampled(times, rates, float(rng.choice([0.05, 0.1, 0.5, 1.0])), float(rng.choice([0.002, 0.01, 0.02])), rng)
            for _ in range(2)
        )
        try:
            estimate = estimate_offset(a[0] - offset, a[1], *b)
        except InputError:
            continue
        assert abs(estimate.seconds - offset) < 0.1, (seed, estimate, offset)
        sigmas.append((estimate.seconds - offset) / estimate.sigma)
    assert 15 < len(sigmas) < 110
    assert np.sqrt(np.mean(np.square(sigmas))) < 1.2


def test_navigation_is_moved_to_the_scans_clock(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    times, rates = turning(rng, 300)
    heading = np.degrees(1 - np.cumsum(rates) * 0.02) % 360
    rows = "".join(f"{START + t - 37:.3f},{h:.4f}\n" for t, h in zip(times[::10].tolist(), heading[::10], strict=True))
    scans = scans_at(START + 100, START + 150)
    notes: list[str] = []
    (tmp_path / "log.csv").write_text("Time,Heading\n" + rows)
    settings = NavigationSettings(offset=None, sigmas={"heading_deg": 1.0})
    imu = (START + times[::5], rates[::5] + rng.normal(0, 0.01, len(times[::5])))
    navigated = navigate(scans, tmp_path / "log.csv", settings, notes=notes, turn_rates=imu)
    assert any("37.0" in note and "by the turn rates" in note for note in notes)
    values, _ = read(tmp_path / "log.csv", "Time,Heading\n" + rows, NavigationSettings(offset=37.0), scans)
    for scan, value in zip(navigated.scans, values[:, 2], strict=True):
        assert scan.prior is not None
        yaw = scan.prior.T_world_sensor.rotation.as_euler("ZYX", degrees=True)[0]
        assert (90 - yaw - value + 180) % 360 - 180 == pytest.approx(0, abs=0.5)
    with pytest.raises(InputError, match="--nav-offset auto needs the sonar's own turn rates"):
        navigate(scans, tmp_path / "log.csv", settings)
