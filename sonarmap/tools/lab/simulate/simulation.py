"""Simulation of scans and their true poses from settings: a scene, a trajectory, a sensor and noise."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.counted import sized
from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.continuous import ContinuousTrajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.memory import available_memory
from sonarmap.tools.lab.simulate import trajectories
from sonarmap.tools.lab.simulate.scenes.catalog import scene_kind
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.navigation import entropy_of
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb, measure, scan_of
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, Sensor, cast, cast_beams

Fault = Literal["empty", "noise"]
_UNUSABLE_STREAM = 37  # of the seed, so that the other scans do not depend on these draws
STRAY_ECHOES = (3, 12)  # number in a nearly empty scan, least and most
NOISY_BEAMS = (0.05, 0.3)  # share of the beams with an echo in a scan of noise, least and most
_WEAK = 0.002  # least strength of stray echoes, if the sensor's threshold is not above it


def choose_faults(share: float, count: int, seed: int, dive: int = 1) -> dict[int, Fault]:
    """Choose the unusable scans, round(share * count) of `count`, never the first: {number of the scan: fault}.

    A larger share includes the choice of a smaller one. Raises InputError: `share` is invalid or leaves no two scans.
    """
    if not 0 <= share < 1:
        raise InputError(f"unusable is {share}; wanted a share of the scans, 0 <= share < 1")
    number = round(share * count)
    if number > max(count - 2, 0):
        raise InputError(f"unusable is {share}: {number} of {count} scans, which leaves no two; wanted a smaller share")
    rng = np.random.default_rng(_unusable_seed(seed, dive))
    chosen = 1 + np.argsort(rng.random(max(count - 1, 0)), kind="stable")[:number]
    faults = get_args(Fault)
    return {int(number): faults[order % len(faults)] for order, number in enumerate(chosen)}


def _unusable_scan(settings: "SimulationSettings", fault: Fault, number: int, name: str) -> Scan:
    """A scan of random echoes, uniform over the beams and the ranges."""
    sensor = settings.sensor
    rng = np.random.default_rng(_unusable_seed(settings.seed, settings.dive, number))
    beams = sensor.rows * sensor.columns
    low, high = STRAY_ECHOES if fault == "empty" else [round(share * beams) for share in NOISY_BEAMS]
    chosen = rng.choice(beams, min(int(rng.integers(low, high + 1)), beams), replace=False)
    ranges = rng.uniform(sensor.min_range, sensor.max_range, len(chosen))
    strength = max(sensor.threshold, _WEAK) * (1 + rng.standard_exponential(len(chosen)))
    points = sensor.directions().reshape(-1, 3)[chosen] * ranges[:, None]
    return Scan(points.astype(np.float32), strength.astype(np.float32), stamp=float(number), name=name)


def _unusable_seed(seed: int, dive: int, *key: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(entropy_of(seed, _UNUSABLE_STREAM, dive=dive), spawn_key=key)


_BEAM_BYTES = 450  # memory of a beam while its echo is computed
_ECHO_BYTES = 16  # memory of an echo of a finished scan
_SCAN_BYTES = 2000  # memory of a finished scan besides its echoes


def check_size(count: int, columns: int, rows: int) -> None:
    """Check that `count` scans, all kept until the last is done, fit in this machine's memory. Raises InputError: they
    do not; the message says how many would."""
    available, beams = available_memory(), columns * rows
    one_scan = beams * (_BEAM_BYTES + _ECHO_BYTES)
    if one_scan > available:
        most_beams = available // (_BEAM_BYTES + _ECHO_BYTES)
        raise InputError(
            f"a sensor of {columns:,} columns and {rows:,} rows needs {sized(one_scan)} of memory for one scan, and "
            f"this machine has {sized(available)} to spare; give at most {most_beams:,} beams, columns times rows"
        )
    per_scan = beams * _ECHO_BYTES + _SCAN_BYTES
    most_scans = max(1, (available - beams * _BEAM_BYTES) // per_scan)
    if count > most_scans:
        needed = sized(beams * _BEAM_BYTES + count * per_scan)
        raise InputError(
            f"{count:,} scans of {beams:,} beams need {needed} of memory, and this machine has {sized(available)} to "
            f"spare; give at most {most_scans:,} scans (`count`), or a sensor of fewer beams"
        )


# Default noise of a survey, with full speckle as in every single sonar image
SURVEY_NOISE = Noise(sigma2=1.0, outliers=0.01, dropouts=0.05, ghosts=0.02, speckle=1.0)


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """Everything that determines a simulation: equal settings give equal scans, bit for bit."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    scene: str = "floodgate"  # a key of SCENE_KINDS
    trajectory: str = "survey"  # a key of TRAJECTORIES
    count: int = 12  # number of scans, from the start of the trajectory
    spacing: float = trajectories.SPACING  # between scans of a survey or lawnmower [m]; others have their own
    sensor: Sensor = ECLIPSE  # SENSORS holds the predefined ones
    noise: Noise = field(default=SURVEY_NOISE)  # of ranges and strengths
    seed: int = 0  # of the scene, the waves and the noise
    dive: int = 1  # number of the pass over the scene, from 1; see trajectories.py
    unusable: float = 0.0  # share of the scans that show nothing of the scene
    # share of the time between two scans in which the moving sensor measures its columns one after another; 0: all at
    # once
    sweep: float = 0.0
    turn: float = 0.0  # largest turn between two scans of a sensor that turns to and fro [rad]

    def __post_init__(self) -> None:
        scene_kind(self.scene)
        if self.trajectory not in TRAJECTORIES:
            raise InputError(f"no trajectory is called {self.trajectory!r}; there are {', '.join(TRAJECTORIES)}")
        if self.seed < 0:
            raise InputError(f"the seed is {self.seed}; wanted a number >= 0")
        if not 0 <= self.sweep <= 1:
            raise InputError(f"the sweep is {self.sweep}; wanted a share of the time between two scans, 0 to 1")
        if self.sweep and (self.trajectory == "table1" or self.noise.ghosts):
            raise InputError(
                "a sweep works neither with the trajectory table1 nor with ghosts; leave it out, or give `ghosts=0`"
            )
        if not 0 <= self.turn < np.pi:
            raise InputError(f"the turn is {self.turn} rad from scan to scan; wanted 0 or more, below half a turn")
        if self.turn and self.trajectory not in (diving := trajectories.DIVING):
            raise InputError(f"the poses of {self.trajectory} are fixed; `turn` works with one of {', '.join(diving)}")
        trajectories.check_dive(self.dive, self.trajectory)
        check_size(self.count, self.sensor.columns, self.sensor.rows)
        choose_faults(self.unusable, self.count, self.seed, self.dive)


@dataclass(frozen=True, slots=True)
class Simulation:
    """Simulated scans and their true poses."""

    settings: SimulationSettings  # that reproduce the scans
    scans: tuple[Scan, ...]  # one per pose, in sensor frames; their stamps are the truth's
    truth: Trajectory  # T_world_sensor of every scan; the world is the scene's frame, East-North-Up
    # faults of the unusable scans, by number of the scan
    faults: Mapping[int, Fault] = field(default_factory=dict)


def simulate(settings: SimulationSettings, progress: Callable[[int], None] = lambda done: None) -> Simulation:
    """Simulate all scans; after each, `progress` is called with the number done. Raises InputError: the trajectory has
    fewer scans, or a pose sees nothing."""
    truth = trajectory_of(settings)
    motion = None
    if settings.sweep:  # one more pose: the sensor also moves during the last scan
        longer = trajectory_of(replace(settings, count=settings.count + 1))
        motion = ContinuousTrajectory.through(longer, np.zeros((len(longer), 6, 6)))
    faults = choose_faults(settings.unusable, len(truth), settings.seed, settings.dive)
    scans = []
    for number in range(len(truth)):
        name = f"scan_{number:03d}"
        if number in faults:
            scans.append(_unusable_scan(settings, faults[number], number, name))
        else:
            scans.append(observe(settings, truth.T_world_sensor[number], number, name, motion))
        progress(number + 1)
    return Simulation(settings, tuple(scans), truth, faults)


def trajectory_of(settings: SimulationSettings) -> Trajectory:
    """The poses of a simulation's scans."""
    trajectory = TRAJECTORIES[settings.trajectory](settings)
    return trajectories.looking_round(trajectory, settings.turn) if settings.turn else trajectory


def observe(
    settings: SimulationSettings,
    T_world_sensor: RigidTransform,
    number: int,
    name: str,
    motion: ContinuousTrajectory | None = None,
) -> Scan:
    """Scan `number` of a simulation from one pose or, with `motion`, from its pose at the time of each column. Its
    noise depends only on the seed, the dive and the number."""
    key = entropy_of(number, dive=settings.dive)
    rng = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
    scene, sensor, noise = build_scene(settings.scene, settings.seed), settings.sensor, settings.noise
    if motion is not None:
        return _moving_scan(settings, motion, number, rng, name)
    echoes = measure(scene, sensor, T_world_sensor, cast(scene, sensor, T_world_sensor), noise, rng)
    return scan_of(echoes, sensor, stamp=float(number), name=name)


def _moving_scan(
    settings: SimulationSettings, motion: ContinuousTrajectory, number: int, rng: np.random.Generator, name: str
) -> Scan:
    """A scan whose columns are measured one after another; points are in the sensor frame of their own time."""
    sensor = settings.sensor
    after = settings.sweep * np.arange(sensor.columns) / sensor.columns
    T = motion.at(number + after)[0].T_world_sensor
    column = np.tile(np.arange(sensor.columns), sensor.rows)
    directions = Rotation.from_quat(T.rotation.as_quat()[column]).apply(sensor.directions().reshape(-1, 3))
    scene = build_scene(settings.scene, settings.seed)
    echoes = disturb(cast_beams(scene, sensor, T.translation[column], directions), sensor, settings.noise, rng)
    times = np.broadcast_to(after, echoes.ranges.shape)
    return scan_of(echoes, sensor, stamp=float(number), name=name, times=times)


def settings_from_json(content: Any) -> SimulationSettings:
    """Settings from the "settings" of a description.json; missing ones take their defaults. Raises InputError: unknown
    keys or invalid values, all of them named."""
    try:
        return TypeAdapter(SimulationSettings).validate_python(content)
    except ValidationError as error:
        faults = "; ".join(
            f"{'.'.join(map(str, fault['loc'])) or 'settings'}: {fault['msg'].removeprefix('Value error, ')}"
            for fault in error.errors()
        )
        raise InputError(f"the settings of the simulation cannot be used: {faults}") from error


TRAJECTORIES: Mapping[str, Callable[[SimulationSettings], Trajectory]] = {
    "survey": lambda of: trajectories.survey(of.scene, of.count, of.seed, of.spacing, of.dive, of.sensor.max_range),
    "loop": lambda of: trajectories.loop(of.scene, of.count, of.seed, of.dive, of.sensor.max_range),
    "lawnmower": lambda of: trajectories.lawnmower(
        of.scene, of.count, of.seed, of.spacing, of.dive, of.sensor.max_range
    ),
    "paper18": lambda of: trajectories.paper18(of.scene, of.count, of.seed, of.sensor),
    "table1": lambda of: trajectories.first_of_table1(of.count),
}
