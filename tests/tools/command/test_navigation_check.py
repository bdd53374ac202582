"""Whether `map` sees that scans contradict the navigation, or by how much its clock is off (`--nav-offset auto`)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.navigation import (
    ContradictedError,
    NavigationReading,
    PriorsFile,
    contradiction_of,
    refusing,
    scans_with_priors,
)
from sonarmap.tools.files.readers.instruments import poses_of
from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.recordings import START, imu_batch, recording, written
from tests.samples.surveys import step_pair
from tests.tools.files.readers.navigation.test_contradictions import TIGHT, measured, path, priors, signed


def scans_with(values: np.ndarray) -> list[Scan]:
    points = np.ones((1, 3), np.float32)
    return [Scan(points, stamp=k, prior=prior, name=f"s{k}") for k, prior in enumerate(priors(values))]


def free_pairs(truth: np.ndarray, numbers: Sequence[int]) -> list[RegisteredPair]:
    """Consecutive scans as the truth has them."""
    poses = poses_of(truth)
    return [step_pair(k, poses[k].inv() * poses[k + 1], TIGHT) for k in numbers]


def test_a_mistake_is_named_and_refused() -> None:
    rng = np.random.default_rng(1)
    truth = path(rng, 60)
    values, free = measured(truth, rng), free_pairs(truth, range(0, 45, 3))
    verdict = contradiction_of(scans_with(signed(2)(values)), free)
    assert verdict is not None
    assert verdict.instead == ("heading_deg with the opposite sign",)
    with pytest.raises(ContradictedError, match=r"they agree with heading_deg .*In log\.csv: give --nav-frame"):
        refusing(scans_with(signed(2)(values)), "log.csv")(free)
    assert contradiction_of(scans_with(values), free) is None
    refusing(scans_with(values), "log.csv")(free)
    assert contradiction_of(scans_with(signed(2)(values)), free[:5]) is None


OFFSET, SECONDS, HZ = 37.0, 120.0, 50


def yaw(times: np.ndarray) -> np.ndarray:
    """A vehicle that turns now this way, now that [rad, positive to the left]."""
    rng = np.random.default_rng(6)
    periods, phases, sizes = rng.uniform(5, 31, 9), rng.uniform(0, 6.3, 9), rng.uniform(0.05, 0.3, 9)
    return (sizes * np.sin(2 * np.pi * times[:, None] / periods + phases)).sum(axis=1)


def imu() -> list[bytes]:
    """In the file's axes, z down: a turn to the left is negative."""
    packets = []
    for number in range(int(SECONDS)):
        times = number + np.arange(HZ) / HZ
        rates = np.zeros((HZ, 3))
        rates[:, 2] = -np.gradient(yaw(times), 1 / HZ)
        packets.append(rip.packb(imu_batch(number, times.tolist(), np.tile([0, 0, -9.81], (HZ, 1)), rates)))
    return packets


@pytest.fixture
def dive(tmp_path: Path) -> tuple[tuple[Scan, ...], Path]:
    path = written(tmp_path / "dive.sonar", recording(4))
    path.write_bytes(path.read_bytes() + b"".join(imu()))
    times = np.arange(-20, SECONDS + 20, 0.25)
    headings = np.degrees(-yaw(times)) % 360
    lines = [f"{int(START) + OFFSET + time:.3f},{heading:.2f},1" for time, heading in zip(times, headings, strict=True)]
    (tmp_path / "nav.csv").write_text("\n".join(["stamp,heading_deg,heading_sigma_deg", *lines, ""]))
    return read_scans([path]).scans, path


def test_a_clock_37_seconds_ahead(dive: tuple[tuple[Scan, ...], Path], capsys: pytest.CaptureFixture[str]) -> None:
    scans, path = dive
    nav = path.with_name("nav.csv")
    settings = NavigationReading(nav_offset="auto").settings(nav)
    navigated = scans_with_priors(scans, PriorsFile([nav]), settings, files=[path])
    priors = [scan.prior for scan in navigated.scans if scan.prior is not None]
    assert len(priors) == len(scans)
    headings = [np.degrees(prior.T_world_sensor.rotation.as_euler("ZYX")[0]) for prior in priors]
    expected = 90 + np.degrees(yaw(np.array([scan.stamp - int(START) for scan in scans])))
    np.testing.assert_allclose(headings, expected, atol=1.5)  # 0.1 s of a turn of 15 degrees a second
    said = " ".join(capsys.readouterr().err.split())
    added = float(said.split(" s are added")[0].split()[-1])
    assert added == pytest.approx(-OFFSET, abs=0.1)


def test_without_an_imu_it_is_refused(dive: tuple[tuple[Scan, ...], Path]) -> None:
    scans, path = dive
    nav = path.with_name("nav.csv")
    settings = NavigationReading(nav_offset="auto").settings(nav)
    bare = written(path.with_name("bare.sonar"), recording(4))
    for files in ((), (bare,), (nav,)):
        with pytest.raises(InputError, match="--nav-offset auto needs the sonar's own turn rates"):
            scans_with_priors(scans, PriorsFile([nav]), settings, files=files)
