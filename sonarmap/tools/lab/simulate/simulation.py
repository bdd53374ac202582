"""A simulation from its settings: a scene, a path, a sensor and noise; scans and the truth come out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
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
from sonarmap.tools.lab.simulate.scenes.catalog import scene_kind
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.navigation import entropy_of
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb, measure, scan_of
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, Sensor, cast, cast_beams
from sonarmap.tools.lab.simulate.trajectories import (
    DIVING,
    SPACING,
    TABLE1_COUNT,
    TABLE1_MOST,
    check_dive,
    lawnmower,
    looking_round,
    loop,
    paper18,
    survey,
    table1,
)

Fault = Literal["empty", "noise"]
_UNUSABLE_STREAM = 37  # of the seed: what is drawn here leaves the other scans what they are
STRAY_ECHOES = (3, 12)  # of a nearly empty scan, least and most
NOISY_BEAMS = (0.05, 0.3)  # share of the beams that bring noise back, least and most
_WEAK = 0.002  # strength about which stray echoes lie, where the sensor's threshold is not above it


def choose_faults(share: float, count: int, seed: int, dive: int = 1) -> dict[int, Fault]:
    """Why round(share * count) of `count` scans are unusable, by their numbers; never the first.

    A larger share keeps those of a smaller one. Raises InputError: no share, or one that leaves no two usable scans.
    """
    if not 0 <= share < 1:
        raise InputError(f"unusable is {share}; wanted a share of the scans, 0 <= share < 1")
    number = round(share * count)
    if number > max(count - 2, 0):
        raise InputError(f"unusable is {share}: {number} of {count} scans, which leaves no two; wanted a smaller share")
    rng = np.random.default_rng(_unusable_seed(seed, dive))
    chosen = 1 + np.argsort(rng.random(max(count - 1, 0)), kind="stable")[:number]
    kinds = get_args(Fault)
    return {int(k): kinds[place % len(kinds)] for place, k in enumerate(chosen)}


def _unusable_scan(settings: "SimulationSettings", fault: Fault, number: int, name: str) -> Scan:
    """Echoes that no surface gave, spread evenly over the beams and the ranges."""
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


_BEAM_BYTES = 450  # of a beam while its echo is computed, as measured
_ECHO_BYTES = 16  # that stay of an echo
_SCAN_BYTES = 2000  # of a scan


def check_size(count: int, columns: int, rows: int) -> None:
    """Refuse more scans, all kept until the last is done, or more beams than this machine's memory holds. Raises
    InputError: saying how many would fit."""
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


# Of a survey where nothing else is said: speckle in full, as every single sonar image has it
SURVEY_NOISE = Noise(sigma2=1.0, outliers=0.01, dropouts=0.05, ghosts=0.02, speckle=1.0)


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """Everything that decides what is simulated: equal settings give equal scans, bit for bit."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    scene: str = "floodgate"  # a key of SCENE_KINDS
    trajectory: str = "survey"  # a key of TRAJECTORIES
    count: int = 12  # number of scans, from the start of the trajectory
    spacing: float = SPACING  # of a survey's or a lawnmower's scans along their path [m]; the others have their own
    sensor: Sensor = ECLIPSE  # what to see with; SENSORS holds the known ones
    noise: Noise = field(default=SURVEY_NOISE)  # what it does to the echoes
    seed: int = 0  # of the scene, the waves and the noise
    dive: int = 1  # 1, or another pass over the same scene, see trajectories.py
    unusable: float = 0.0  # share of the scans that show nothing of the scene
    # share of the time from one scan to the next in which the sensor takes its columns in turn, while it moves on; 0:
    # all at once
    sweep: float = 0.0
    turn: float = 0.0  # by which the sensor turns to and fro from one scan to the next, at the fastest [rad]

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
                "scans of a sensor that moves can be neither of trajectory table1 nor with ghosts (`ghosts=0`)"
            )
        if not 0 <= self.turn < np.pi:
            raise InputError(f"the turn is {self.turn} rad from scan to scan; wanted 0 or more, below half a turn")
        if self.turn and self.trajectory not in DIVING:
            raise InputError(f"the poses of {self.trajectory} are given; `turn` is for one of {', '.join(DIVING)}")
        check_dive(self.dive, self.trajectory)
        check_size(self.count, self.sensor.columns, self.sensor.rows)
        choose_faults(self.unusable, self.count, self.seed, self.dive)


@dataclass(frozen=True, slots=True)
class Simulation:
    """What the sensor wrote, and the truth."""

    settings: SimulationSettings  # from which the same scans come out again
    scans: tuple[Scan, ...]  # one per pose, in sensor frames; their stamps are the truth's
    truth: Trajectory  # T_world_sensor of every scan; the world is the scene's frame, East-North-Up
    # why a scan is unusable, by its number; none for the others
    faults: Mapping[int, Fault] = field(default_factory=dict)


def simulate(settings: SimulationSettings, progress: Callable[[int], None] = lambda done: None) -> Simulation:
    """All scans of a simulation; `progress` hears the number of scans done, after each. Raises InputError: more scans
    than the trajectory has, a pose that sees nothing."""
    truth = trajectory_of(settings)
    way = None
    if settings.sweep:  # while the last scan is taken the sensor goes on as it would to another one
        longer = trajectory_of(replace(settings, count=settings.count + 1))
        way = ContinuousTrajectory.through(longer, np.zeros((len(longer), 6, 6)))
    faults = choose_faults(settings.unusable, len(truth), settings.seed, settings.dive)
    scans = []
    for number in range(len(truth)):
        name = f"scan_{number:03d}"
        if number in faults:
            scans.append(_unusable_scan(settings, faults[number], number, name))
        else:
            scans.append(observe(settings, truth.T_world_sensor[number], number, name, way))
        progress(number + 1)
    return Simulation(settings, tuple(scans), truth, faults)


def trajectory_of(settings: SimulationSettings) -> Trajectory:
    """The poses of a simulation's scans."""
    trajectory = TRAJECTORIES[settings.trajectory](settings)
    return looking_round(trajectory, settings.turn) if settings.turn else trajectory


def observe(
    settings: SimulationSettings,
    T_world_sensor: RigidTransform,
    number: int,
    name: str,
    way: ContinuousTrajectory | None = None,
) -> Scan:
    """The scan `number` of a simulation, from one pose, or on a way past it; the seed, the dive and the number decide
    its noise."""
    key = entropy_of(number, dive=settings.dive)
    rng = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
    scene, sensor, noise = build_scene(settings.scene, settings.seed), settings.sensor, settings.noise
    if way is not None:
        return _on_the_way(settings, way, number, rng, name)
    echoes = measure(scene, sensor, T_world_sensor, cast(scene, sensor, T_world_sensor), noise, rng)
    return scan_of(echoes, sensor, stamp=float(number), name=name)


def _on_the_way(
    settings: SimulationSettings, way: ContinuousTrajectory, number: int, rng: np.random.Generator, name: str
) -> Scan:
    """A scan whose columns are taken in turn, its points as the sensor has them at the time of each."""
    sensor = settings.sensor
    after = settings.sweep * np.arange(sensor.columns) / sensor.columns
    T = way.at(number + after)[0].T_world_sensor
    column = np.tile(np.arange(sensor.columns), sensor.rows)
    directions = Rotation.from_quat(T.rotation.as_quat()[column]).apply(sensor.directions().reshape(-1, 3))
    scene = build_scene(settings.scene, settings.seed)
    echoes = disturb(cast_beams(scene, sensor, T.translation[column], directions), sensor, settings.noise, rng)
    times = np.broadcast_to(after, echoes.ranges.shape)
    return scan_of(echoes, sensor, stamp=float(number), name=name, times=times)


def settings_from_json(content: Any) -> SimulationSettings:
    """Settings from what a description.json holds under "settings"; missing ones take their defaults. Raises
    InputError: an unknown key or a value that does not fit, all of them named."""
    try:
        return TypeAdapter(SimulationSettings).validate_python(content)
    except ValidationError as error:
        faults = "; ".join(
            f"{'.'.join(map(str, fault['loc'])) or 'settings'}: {fault['msg'].removeprefix('Value error, ')}"
            for fault in error.errors()
        )
        raise InputError(f"the settings of the simulation cannot be used: {faults}") from error


def _table1(settings: SimulationSettings) -> Trajectory:
    poses = table1(TABLE1_MOST)
    if not 1 <= settings.count <= len(poses):
        raise InputError(
            f"Table 1 has {1 + TABLE1_COUNT} scans, the reference and S0 to S{TABLE1_COUNT - 1}, and with S10 to "
            f"S{TABLE1_MOST - 1} {len(poses)}; {settings.count} were asked for"
        )
    return poses.take(range(settings.count))


TRAJECTORIES: MappingProxyType[str, Callable[[SimulationSettings], Trajectory]] = MappingProxyType(
    {
        "survey": lambda of: survey(of.scene, of.count, of.seed, of.spacing, of.dive, of.sensor.max_range),
        "loop": lambda of: loop(of.scene, of.count, of.seed, of.dive, of.sensor.max_range),
        "lawnmower": lambda of: lawnmower(of.scene, of.count, of.seed, of.spacing, of.dive, of.sensor.max_range),
        "paper18": lambda of: paper18(of.scene, of.count, of.seed, of.sensor),
        "table1": _table1,
    }
)
