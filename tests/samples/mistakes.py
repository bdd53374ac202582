"""Dives of a minute with a log of navigation, and mistakes of instruments in them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sonarmap.slam.motion.continuous import ContinuousTrajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.instruments import COLUMNS, SIGMA_COLUMNS, sigmas_of, values_of
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments, measure_poses
from sonarmap.tools.lab.simulate.simulation import simulate, trajectory_of

SECONDS, START, RATE = 60, 1_782_898_200.0, 2.0  # a scan a second; rows of the log a second
DEPTH = COLUMNS.index("depth_m")
HEADING = COLUMNS.index("heading_deg")


@dataclass(frozen=True, slots=True)
class SimulatedDive:
    """Scans, and rows of a log at its own times."""

    scans: tuple[Scan, ...]
    times: np.ndarray  # (n,) of the rows [s]
    values: np.ndarray  # (n, 6) in the order of COLUMNS
    sigmas: np.ndarray  # (6,) standard deviations of the values
    arm: float  # length of a wrong lever arm in this scene [m]

    def each(self, change: Callable[[Scan, int], Scan]) -> "SimulatedDive":
        return replace(self, scans=tuple(change(scan, k) for k, scan in enumerate(self.scans)))

    def column(self, number: int, change: Callable[[np.ndarray], np.ndarray]) -> "SimulatedDive":
        values = self.values.copy()
        values[:, number] = change(values[:, number])
        return replace(self, values=values)

    def write_log(self, path: Path) -> Path:
        lines = [",".join(("stamp", *COLUMNS, *SIGMA_COLUMNS))]
        for time, row in zip(self.times.tolist(), self.values.tolist(), strict=True):
            lines.append(",".join([f"{time:.3f}", *(f"{value:.4f}" for value in (*row, *self.sigmas.tolist()))]))
        path.write_text("\n".join(lines) + "\n")
        return path


def simulated_dive(scene: str, seed: int, fix_sigma: float, arm: float = 0.0) -> SimulatedDive:
    """A survey of SECONDS scans with the scene's usual spacing. `fix_sigma`: of positions [m]."""
    settings = replace(plan(scene, seed=seed), count=SECONDS)
    truth = trajectory_of(replace(settings, count=SECONDS + 1))
    path = ContinuousTrajectory.through(truth, np.zeros((len(truth), 6, 6)))
    after = np.arange(0.0, SECONDS, 1 / RATE)
    priors = measure_poses(path.at(after)[0].T_world_sensor, Instruments(position=fix_sigma), seed)
    values = np.array([values_of(prior.T_world_sensor) for prior in priors])
    scans = tuple(replace(scan, stamp=START + scan.stamp) for scan in simulate(settings).scans)
    return SimulatedDive(scans, START + after, values, sigmas_of(priors[0]), arm)


def _points(dive: SimulatedDive, by: tuple[float, float, float]) -> SimulatedDive:
    return dive.each(lambda scan, _: replace(scan, points=scan.points * np.array(by, np.float32)))


def _sentinels(dive: SimulatedDive) -> SimulatedDive:
    some = np.random.default_rng(8).random(len(dive.times)) < 0.15
    return dive.column(DEPTH, lambda depths: np.where(some, -9999.0, depths))


def _lever_arm(dive: SimulatedDive) -> SimulatedDive:
    """The log is of a place behind the sonar."""
    heading = np.radians(dive.values[:, HEADING])
    values = dive.values.copy()
    values[:, 3:5] -= dive.arm * np.column_stack([np.sin(heading), np.cos(heading)])
    return replace(dive, values=values)


def _rails(dive: SimulatedDive) -> SimulatedDive:
    """Two rails ahead of the sonar, with a tenth of the points."""
    rng = np.random.default_rng(9)

    def change(scan: Scan, _: int) -> Scan:
        count = len(scan.points) // 10
        along, beside = rng.uniform(0.8, 1.1, count), rng.choice([-0.3, 0.3], count)
        rails = np.column_stack([along, beside, np.full(count, -0.2)]) + rng.normal(0, 0.01, (count, 3))
        return Scan(np.vstack([scan.points, rails]).astype(np.float32), stamp=scan.stamp, name=scan.name)

    return dive.each(change)


def _milliseconds(dive: SimulatedDive) -> SimulatedDive:
    return dive.each(lambda scan, _: replace(scan, times=np.linspace(0, 700, len(scan.points), dtype=np.float32)))


def _lost(dive: SimulatedDive) -> SimulatedDive:
    rng = np.random.default_rng(10)
    return replace(dive, scans=tuple(scan for scan in dive.scans if rng.random() > 0.2))


def _hangs(dive: SimulatedDive) -> SimulatedDive:
    """The sonar sends one scan for eight seconds."""
    same = dive.scans[30]
    return dive.each(lambda scan, k: replace(same, stamp=scan.stamp, name=scan.name) if 30 < k <= 38 else scan)


# What is wrong: the mistake, and what a sentence that finds it says.
MISTAKES: dict[str, tuple[Callable[[SimulatedDive], SimulatedDive], str]] = {
    "z down": (lambda dive: _points(dive, (1, -1, -1)), r"upside down.*--frame"),
    "y right": (lambda dive: _points(dive, (1, -1, 1)), r"scans mirrored.*--frame"),
    "heading's sign": (lambda dive: dive.column(HEADING, lambda h: -h % 360), r"heading_deg with the opposite sign"),
    "heading 25 deg off": (
        lambda dive: dive.column(HEADING, lambda h: (h + 25) % 360),
        r"heading_deg turned by -?2\d degrees|headings fit if .?2\d\.\d degrees",
    ),
    "depth's sign": (lambda dive: dive.column(DEPTH, lambda d: -d), r"depth_m with the opposite sign"),
    "log 2 s late": (
        lambda dive: replace(dive, times=dive.times + 2),
        r"the rows (of the scans|\d+ scans) before|times are [\d.]+ s earlier",
    ),
    "log in local time": (lambda dive: replace(dive, times=dive.times + 3600), r"local time.*--nav-offset"),
    "clock set back": (
        lambda dive: dive.each(lambda scan, k: replace(scan, stamp=scan.stamp - 3600 * (k >= 30))),
        r"not later than that of the shot before.*NTP",
    ),
    "sentinels": (_sentinels, r"depths are left out.*-9999"),
    "lever arm": (_lever_arm, r"m forward and .*--mount"),
    "speed of sound": (lambda dive: _points(dive, (1.05, 1.05, 1.05)), r"--range-scale 0\.9\d|--sound-speed"),
    "own structure": (_rails, r"--exclude-box"),
    "point times": (_milliseconds, r"taken as milliseconds"),
    "lost scans": (_lost, r"missing by their times"),
    "hangs": (_hangs, r"repeat an earlier one"),
}
