"""Whether `map` sees that scans contradict the navigation, or by how much its clock is off (`--nav-offset auto`)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.navigation import NavigationReading, PriorsFile, scans_with_priors
from sonarmap.tools.command.navigation_check import contradiction_of
from sonarmap.tools.files.readers.instruments import poses_of
from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.recordings import START, imu_batch, recording, written
from tests.tools.files.readers.navigation.test_contradictions import TIGHT, measured, path, priors, signed


class Truthful:
    """Registers scans by the truth, and fails where it is asked to."""

    def __init__(self, truth: np.ndarray, failing: frozenset[int] = frozenset()) -> None:
        self.poses, self.failing, self.asked = poses_of(truth), failing, 0

    def prepare(self, scan: Scan) -> int:
        assert scan.prior is None
        number = int(scan.stamp)
        if number in self.failing:
            raise InputError("too little structure")
        return number

    def register(self, target: int, source: int) -> Registration:
        self.asked += 1
        T: RigidTransform = self.poses[target].inv() * self.poses[source]
        return Registration(T, TIGHT, psr=9.0, overlap=0.8, accepted=True, seconds=0.0, reason="")


def scans_with(values: np.ndarray) -> list[Scan]:
    points = np.ones((1, 3), np.float32)
    return [Scan(points, stamp=k, prior=prior, name=f"s{k}") for k, prior in enumerate(priors(values))]


def test_a_mistake_is_named_from_few_pairs() -> None:
    rng = np.random.default_rng(1)
    truth = path(rng, 60)
    registrar = Truthful(truth, frozenset({3, 20}))
    values = measured(truth, rng)
    verdict = contradiction_of(scans_with(signed(2)(values)), [0] * 60, registrar, quiet=True)  # type: ignore[arg-type]
    assert verdict is not None
    assert verdict.instead == ("heading_deg with its sign turned",)
    assert registrar.asked <= 16
    assert contradiction_of(scans_with(values), [0] * 60, registrar, quiet=True) is None  # type: ignore[arg-type]


def test_few_scans_and_those_without_priors_or_of_other_surveys_are_not_asked() -> None:
    truth = path(np.random.default_rng(3), 20)
    registrar, scans = Truthful(truth), scans_with(signed(2)(truth))
    bare = [replace(scan, prior=None) for scan in scans]
    for given, surveys in ((scans[:2], [0] * 2), (scans[:5], [0] * 5), (bare, [0] * 20), (scans, list(range(20)))):
        assert contradiction_of(given, surveys, registrar, quiet=True) is None  # type: ignore[arg-type]
    assert registrar.asked == 0


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
    navigated = scans_with_priors(scans, PriorsFile(nav), settings, files=[path])
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
            scans_with_priors(scans, PriorsFile(nav), settings, files=files)
