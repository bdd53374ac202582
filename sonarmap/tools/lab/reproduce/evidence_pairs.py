"""The pairs whose evidence is recorded: every kind of scan, surveys near and far, unrelated and faulty scans."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.experiment import Value
from sonarmap.tools.lab.reproduce.kinds import LEVELED, NAVIGATION, NOTHING, PRIORS
from sonarmap.tools.lab.reproduce.pairs import related, unrelated
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.lab.simulate.kinds.kind import relief_of
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn
from sonarmap.tools.lab.simulate.plan import louder, plan
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.simulation import Simulation, observe, simulate

STILL, UNRELATED, SURVEY, DISTORTED = "still", "unrelated", "survey", "distorted"
# What is known beforehand, beside what instruments measure: where the pair is expected, rightly or wrongly
EXPECTED, ELSEWHERE = "expected", "expected elsewhere"
_TURNS: tuple[Turn, ...] = ("view", "yaw", "any")
# Standard deviations of expected poses, in turns [voxels; rad]
_WINDOWS = ((1.0, 0.05), (4.0, 0.1), (12.0, 0.3))
# Of a survey: how many scans, by which sensor (None: the scene's) and with how much of the usual noise in turns, and
# how many scans apart its pairs are
_SCANS, _SENSORS, _NOISES = 16, (None, "sonar3d15", "paper"), (1.0, 1.5, 2.0)
_FAR = (2, 4, 8)
_RESTING = 4  # pairs of a sensor that hardly moves between its scans
# What is done to one of two scans, in turns: a sign of y, and the factors of a wrong speed of sound
_FACTORS = (-1.0, 0.95, 1.05)


@dataclass(frozen=True, slots=True)
class EvidencePair:
    """One pair that is registered once."""

    cells: dict[str, Value]  # set, number, scene, relief, known, apart (scans of a survey between)
    target: Scan
    source: Scan
    truth: RigidTransform | None  # T_target_source; None where no answer is right
    grid: Grid
    expected: ExpectedPose | None = None  # where a vehicle's motion would expect it
    any_tilt: bool = False  # whether roll and pitch have no bound


def draw(name: str, number: int, seed: int, edge: int) -> Iterator[EvidencePair]:
    """The pairs of draw `number` of a set, a kind of scan or one of the four above; none where a scene has no such
    pair. The same numbers, the same pairs."""
    rng = np.random.default_rng([seed, number, sorted((*SCAN_KINDS, STILL, UNRELATED, SURVEY, DISTORTED)).index(name)])
    draws = {STILL: _still, UNRELATED: _of_unrelated, SURVEY: _survey, DISTORTED: _distorted}.get(name)
    try:
        pairs = list(_kind(name, number, seed, edge, rng) if draws is None else draws(number, seed, edge, rng))
    except InputError:
        return
    for pair in pairs:
        yield replace(pair, cells={"set": name, "number": number} | pair.cells)


def _kind(name: str, number: int, seed: int, edge: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """A pair of a kind, with nothing known, with instruments, about where it is expected, and elsewhere."""
    pair = kind_pair(name, number, seed)
    grid, truth = choose_grid((pair.target, pair.source), edge), pair.T_target_source
    for known in (NOTHING, LEVELED, NAVIGATION):
        instruments = PRIORS[known]
        given = pair if instruments is None else pair.with_priors(instruments)
        yield EvidencePair(_cells(pair.scene, known), given.target, given.source, truth, grid)
    yield from _about(EvidencePair(_cells(pair.scene, NOTHING), pair.target, pair.source, truth, grid), number, rng)


def _about(pair: EvidencePair, number: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """A pair about where it is expected, and about another place."""
    away = Rotation.from_euler("z", rng.uniform(0.8, 5.5)), pair.grid.voxel * rng.uniform(-40, 40, 3) * [1, 1, 0.2]
    right = RigidTransform.identity() if pair.truth is None else pair.truth
    wrong = RigidTransform.from_components(right.translation + away[1], away[0] * right.rotation)
    if pair.truth is not None:
        yield _expected(pair, EXPECTED, right, number, rng)
    yield _expected(pair, ELSEWHERE, wrong, number, rng)


def _expected(
    pair: EvidencePair, known: str, about: RigidTransform, number: int, rng: np.random.Generator
) -> EvidencePair:
    """A pair that is expected near a pose, as far off as its standard deviations say."""
    shift, turn = _WINDOWS[number % len(_WINDOWS)]
    sigmas = np.repeat([turn, shift * pair.grid.voxel], 3)
    off = sigmas * rng.standard_normal(6)
    T = RigidTransform.from_components(about.translation + off[3:], Rotation.from_rotvec(off[:3]) * about.rotation)
    return replace(pair, cells=pair.cells | {"known": known}, expected=ExpectedPose.along_target(T, sigmas))


def _still(number: int, seed: int, edge: int, _rng: np.random.Generator) -> Iterator[EvidencePair]:
    """Two views of a sensor that stands still, of any turn."""
    turn, size = _TURNS[number % 3], {1: edge // 2, 4: 2 * edge}.get(number % 6, edge)
    pair = related(number, seed, turn, size)
    if pair is not None:
        cells = _cells(str(pair.cells["scene"]), NOTHING)
        yield EvidencePair(cells, pair.target, pair.source, pair.truth, pair.grid, any_tilt=turn == "any")


def _of_unrelated(number: int, seed: int, edge: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """Two views of scenes that share nothing: freely, and about where they are said to be."""
    pair = unrelated(number, seed, {1: edge // 2, 4: 2 * edge}.get(number % 6, edge))
    if pair is not None:
        free = EvidencePair(_cells(str(pair.cells["scene"]), NOTHING), pair.target, pair.source, None, pair.grid)
        yield free
        yield from _about(free, number, rng)


def _survey(number: int, seed: int, edge: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """Scans along a path: consecutive ones, farther ones, and one of these about where it is expected."""
    scene = tuple(SCENE_KINDS)[number % len(SCENE_KINDS)]
    lap = number // len(SCENE_KINDS)
    path, noise = ("lawnmower", "survey")[lap % 2], _NOISES[number // 3 % 3]

    def seen_by(sensor: str | None) -> Simulation:
        return simulate(replace(louder(plan(scene, path, sensor, seed + number), noise), count=_SCANS))

    try:
        simulated = seen_by(_SENSORS[number % 3])
    except InputError:  # it reaches no surface
        simulated = seen_by(None)
    poses, grid = simulated.truth.T_world_sensor, choose_grid(simulated.scans, edge)

    def between(i: int, j: int) -> EvidencePair:
        cells = _cells(scene, NOTHING) | {"apart": j - i}
        return EvidencePair(cells, simulated.scans[i], simulated.scans[j], poses[i].inv() * poses[j], grid)

    yield from (between(i, i + 1) for i in range(_SCANS - 1))
    for apart in _FAR:
        for i in rng.choice(_SCANS - apart, 4, replace=False).tolist():
            yield between(i, i + apart)
            yield from _about(between(i, i + apart), number, rng) if apart == _FAR[0] else ()
    for n, i in enumerate(rng.choice(_SCANS, _RESTING, replace=False).tolist()):
        drift = RigidTransform.from_components(
            grid.voxel * rng.uniform(0.1, 4.0) * rng.standard_normal(3) / 2,
            Rotation.from_euler("ZYX", rng.normal(0.0, [3.0, 1.0, 1.0]), degrees=True),
        )
        again = observe(simulated.settings, poses[i] * drift, _SCANS + n, "again")
        yield EvidencePair(_cells(scene, NOTHING) | {"apart": 0}, simulated.scans[i], again, drift, grid)


def _distorted(number: int, seed: int, edge: int, _rng: np.random.Generator) -> Iterator[EvidencePair]:
    """Two consecutive scans of a survey, one of them mirrored or scaled: no pose is right."""
    scene = tuple(SCENE_KINDS)[number % len(SCENE_KINDS)]
    simulated = simulate(replace(plan(scene, "lawnmower", None, seed + 500_000 + number), count=3))
    factor = _FACTORS[number // len(SCENE_KINDS) % len(_FACTORS)]
    target, source = simulated.scans[0], simulated.scans[1]
    factors = np.array([1.0, factor, 1.0] if factor < 0 else [factor] * 3, np.float32)
    poses = simulated.truth.T_world_sensor
    truth = None if factor < 0 else poses[0].inv() * poses[1]
    cells = _cells(scene, NOTHING) | {"factor": factor}
    yield EvidencePair(
        cells, target, replace(source, points=source.points * factors), truth, choose_grid((target, source), edge)
    )


def _cells(scene: str, known: str) -> dict[str, Value]:
    return {"scene": scene, "relief": relief_of(scene), "known": known, "apart": 0}
