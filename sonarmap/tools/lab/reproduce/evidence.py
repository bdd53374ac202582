"""Recorded pairs: a spectral registration that records the evidence of all its hypotheses as rows, and their reader."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from math import nan, pi
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.fit import Fit, PriorTerm
from sonarmap.spectral.verify.hypothesis import Evidence, Hypothesis
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from sonarmap.spectral.verify.verifier import Observability
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.experiments import Row, Value
from sonarmap.tools.lab.reproduce.pairs import LEVELED, NAVIGATION, NOTHING, PRIORS, SetPair, related, unrelated
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.lab.simulate.kinds.kind import RELIEF_OF
from sonarmap.tools.lab.simulate.plan import louder, plan
from sonarmap.tools.lab.simulate.random_pairs import Turn
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.simulation import Simulation, observe, simulate

STILL, UNRELATED, SURVEY = "still", "unrelated", "survey"
# Usual number of draws of each set: one of a kind has five registrations, one of a survey about 35. A sixth of the
# still pairs has half of the voxels per edge, another twice as many.
DRAWS = dict.fromkeys(SCAN_KINDS, 300) | {STILL: 1200, UNRELATED: 1200, SURVEY: 240}
# Values of the cell "known", beside the names of priors: the pose is expected, correctly or wrongly
EXPECTED, ELSEWHERE = "expected", "expected elsewhere"
_TURNS: tuple[Turn, ...] = ("view", "yaw", "any")
# Standard deviations of expected poses, used in turn: shift [voxels] and rotation [rad]
_WINDOWS = ((1.0, 0.05), (4.0, 0.1), (12.0, 0.3))
_SCANS = 16  # of a survey
_SENSORS = (None, "sonar3d15", "paper")  # of surveys, used in turn; None: the scene's default
_NOISES = (1.0, 1.5, 2.0)  # of surveys, used in turn, relative to the usual noise
_FAR = (2, 4, 8)  # index differences of the non-consecutive pairs of a survey
_RESTING = 4  # number of pairs of a sensor that hardly moves between its scans


@dataclass(frozen=True, slots=True)
class EvidencePair(SetPair):
    """A pair to register once; its cells are set, number, scene, relief, known, apart (difference of the indices)."""

    expected: ExpectedPose | None = None  # as predicted by a vehicle's motion; None: unknown
    any_tilt: bool = False  # whether roll and pitch are unbounded


def draw(name: str, number: int, seed: int, edge: int) -> Iterator[EvidencePair]:
    """The pairs of draw `number` of a set of DRAWS: a kind of scan or one of STILL, UNRELATED and SURVEY. None if a
    scene has no such pair; the arguments determine the pairs."""
    rng = np.random.default_rng([seed, number, 1 + sorted(DRAWS).index(name)])
    draws = {STILL: _still, UNRELATED: _of_unrelated, SURVEY: _survey}.get(name)
    try:
        pairs = list(_kind(name, number, seed, edge, rng) if draws is None else draws(number, seed, edge, rng))
    except InputError:
        return
    for pair in pairs:
        yield replace(pair, cells={"set": name, "number": number} | pair.cells)


def _kind(name: str, number: int, seed: int, edge: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """A pair of a kind without priors, with priors of instruments, and expected near correct and wrong poses."""
    pair = kind_pair(name, number, seed)
    grid, truth = choose_grid((pair.target, pair.source), edge), pair.T_target_source
    for known in (NOTHING, LEVELED, NAVIGATION):
        instruments = PRIORS[known]
        measured = pair if instruments is None else pair.with_priors(instruments)
        yield EvidencePair(_cells(pair.scene, known), measured.target, measured.source, truth, grid)
    yield from _about(EvidencePair(_cells(pair.scene, NOTHING), pair.target, pair.source, truth, grid), number, rng)


def _about(pair: EvidencePair, number: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """A pair expected near its true pose, if it has one, and expected near a wrong pose."""
    away = Rotation.from_euler("z", rng.uniform(0.8, 5.5)), pair.grid.voxel * rng.uniform(-40, 40, 3) * [1, 1, 0.2]
    right = RigidTransform.identity() if pair.truth is None else pair.truth
    wrong = RigidTransform.from_components(right.translation + away[1], away[0] * right.rotation)
    if pair.truth is not None:
        yield _expected(pair, EXPECTED, right, number, rng)
    yield _expected(pair, ELSEWHERE, wrong, number, rng)


def _expected(
    pair: EvidencePair, known: str, about: RigidTransform, number: int, rng: np.random.Generator
) -> EvidencePair:
    """A pair with an expected pose, drawn around `about` with one of the standard deviations _WINDOWS."""
    shift, turn = _WINDOWS[number % len(_WINDOWS)]
    sigmas = np.repeat([turn, shift * pair.grid.voxel], 3)
    error = sigmas * rng.standard_normal(6)
    T = RigidTransform.from_components(about.translation + error[3:], Rotation.from_rotvec(error[:3]) * about.rotation)
    return replace(pair, cells=pair.cells | {"known": known}, expected=ExpectedPose.along_target(T, sigmas))


def _still(number: int, seed: int, edge: int, _rng: np.random.Generator) -> Iterator[EvidencePair]:
    """Two views of a scene, each taken at rest, with each kind of relative rotation in turn."""
    turn, size = _TURNS[number % 3], {1: edge // 2, 4: 2 * edge}.get(number % 6, edge)
    pair = related(number, seed, turn, size)
    cells = _cells(str(pair.cells["scene"]), NOTHING)
    yield EvidencePair(cells, pair.target, pair.source, pair.truth, pair.grid, any_tilt=turn == "any")


def _of_unrelated(number: int, seed: int, edge: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """Two views of scenes that share nothing, without an expected pose and with a wrong one."""
    pair = unrelated(number, seed, {1: edge // 2, 4: 2 * edge}.get(number % 6, edge))
    free = EvidencePair(_cells(str(pair.cells["scene"]), NOTHING), pair.target, pair.source, None, pair.grid)
    yield free
    yield from _about(free, number, rng)


def _survey(number: int, seed: int, edge: int, rng: np.random.Generator) -> Iterator[EvidencePair]:
    """Pairs of scans along a path: consecutive, farther apart, with an expected pose, and of a sensor at rest."""
    scene = tuple(SCENE_KINDS)[number % len(SCENE_KINDS)]
    lap = number // len(SCENE_KINDS)
    path, noise = ("lawnmower", "survey")[lap % 2], _NOISES[number // 3 % 3]

    def seen_by(sensor: str | None) -> Simulation:
        return simulate(replace(louder(plan(scene, path, sensor, seed + number), noise), count=_SCANS))

    try:
        simulated = seen_by(_SENSORS[number % 3])
    except InputError:  # the sensor reaches no surface
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


def _cells(scene: str, known: str) -> dict[str, Value]:
    return {"scene": scene, "relief": RELIEF_OF[scene], "known": known, "apart": 0}


_NOWHERE = (180.0, 1e3)  # errors of a pair without a true pose [degrees, voxels]


class Recorder(SpectralRegistrar):
    """A spectral registrar that also records the evidence of the last pair."""

    _measured: tuple[HypothesisTest, Sequence[Hypothesis], Observability] | None = None

    def _conclude(self, test: HypothesisTest, hypotheses: Sequence[Hypothesis], seen: Observability) -> Registration:
        self._measured = test, hypotheses, seen
        return super()._conclude(test, hypotheses, seen)

    def _looked_at_again(self, target: SpectralScan, source: SpectralScan, bounds: Bounds) -> None:
        """Skip the coarse-grid retry, so that all evidence is from the registrar's own grid."""

    def cells(self, truth: RigidTransform | None) -> list[dict[str, Value]]:
        """A row per hypothesis of the pair that was registered since the last call, best first; none without a pair.

        Each row has the evidence and the error; the first one also has what `fit_of` and `seen_of` read.
        """
        if self._measured is None:
            return []
        (test, hypotheses, seen), self._measured = self._measured, None
        T = [test.transform(hypothesis.fit) for hypothesis in hypotheses]
        rows: list[dict[str, Value]] = []
        for rank, hypothesis in enumerate(hypotheses):
            row: dict[str, Value] = {"rank": rank} | _error(T[rank], truth, self.grid.voxel)
            row |= {f"e_{name}": float(value) for name, value in asdict(hypothesis.evidence).items()}
            row |= {"e_rotation": hypothesis.rotation_score, "e_candidate": hypothesis.candidate_psr}
            row["numbers"] = _text(away=(T[0].inv() * T[rank]).as_exp_coords())
            rows.append(row)
        best = hypotheses[0].fit
        xi = np.full(6, nan) if truth is None else (T[0].inv() * truth).as_exp_coords()
        centers = [scan.volume.center for scan in (test.target, test.source)]
        rows[0] |= {
            "refused": bool(test.bounds.refusal(T[0].rotation, T[0].translation)),
            "search": test.bounds.search(self.grid.extent),
        }
        rows[0]["numbers"] = _text(xi=xi, centers=centers, fit=asdict(best), seen=asdict(seen))
        return rows


def fit_of(numbers: dict[str, Any]) -> Fit:
    """The fit of the best hypothesis, from the parsed text `numbers` of its row."""
    arrays: dict[str, Any] = {
        name: np.array(value) if isinstance(value, list) else value for name, value in numbers["fit"].items()
    }
    prior: dict[str, Any] | None = arrays.pop("prior")
    term = None if prior is None else PriorTerm(**{name: np.array(value) for name, value in prior.items()})
    return Fit(**arrays | {"R": Rotation.from_quat(arrays["R"]), "prior": term})


def seen_of(numbers: dict[str, Any]) -> Observability:
    """The observability of the best hypothesis, from the same text."""
    return Observability(**{name: np.array(value) for name, value in numbers["seen"].items()})


def _text(**values: Any) -> str:
    return json.dumps(values, default=_plain)


def _plain(value: Any) -> Any:
    return value.as_quat().tolist() if isinstance(value, Rotation) else np.asarray(value).tolist()


def _error(T: RigidTransform, truth: RigidTransform | None, voxel: float) -> dict[str, Value]:
    if truth is None:
        return {"rotation_deg": _NOWHERE[0], "off_voxels": _NOWHERE[1]}
    error = pair_error(T, truth)
    return {"rotation_deg": error.rotation_deg, "off_voxels": error.translation_m / voxel}


class Recording:
    """Registers the pairs of a draw, and prepares each scan once per grid."""

    def __init__(self, device: Device) -> None:
        self._recorder = cache(partial(Recorder, device))
        self._prepared: dict[object, SpectralScan] = {}

    def rows(self, pair: EvidencePair) -> list[Row]:
        """A row per hypothesis; none if a scan has too few points, or no hypothesis is possible."""
        config = SpectralConfig(max_tilt=pi) if pair.any_tilt else SpectralConfig()
        recorder = self._recorder(pair.grid, config)
        try:
            target, source = (self._prepare(recorder, scan) for scan in (pair.target, pair.source))
        except InputError:
            return []
        if pair.expected is None:
            recorder.register(target, source)
        else:
            recorder.register_expected(target, source, pair.expected)
        pair_cells = pair.cells | {"edge": pair.grid.edge, "voxel_m": pair.grid.voxel}
        pair_cells |= {"related": pair.truth is not None}
        return [pair_cells | cells for cells in recorder.cells(pair.truth)]

    def _prepare(self, recorder: Recorder, scan: Scan) -> SpectralScan:
        key = id(recorder), id(scan.points)
        if key not in self._prepared:
            self._prepared[key] = recorder.prepare(scan)
        return replace(self._prepared[key], prior=scan.prior)


@dataclass(frozen=True, slots=True)
class RecordedPair:
    """A pair with the evidence of its registration, as read from rows."""

    cells: Row  # of the pair: set, number, scene, relief, known, apart, edge, voxel_m, related, search, refused
    hypotheses: tuple[Hypothesis, ...]  # best first; all have the fit of the best one
    T: tuple[RigidTransform, ...]  # pose of each hypothesis relative to the best one
    off: np.ndarray  # (n, 2) errors of the hypotheses [degrees, voxels]
    seen: Observability  # of the best hypothesis
    xi: np.ndarray  # (6,) error of the best hypothesis, truth = T Exp(xi); NaN without a true pose
    centers: tuple[np.ndarray, np.ndarray]  # (3,) of the grid, in the frames of target and source [m]

    @property
    def grid(self) -> Grid:
        """The grid that both scans share."""
        return Grid(int(self.cells["edge"]), float(self.cells["voxel_m"]))


def recorded_pairs(rows: Iterable[Row]) -> list[RecordedPair]:
    """The pairs in rows of `Recording`."""
    by_pair: list[list[Row]] = []
    for row in rows:
        if row["rank"] == 0:
            by_pair.append([])
        by_pair[-1].append(row)
    return [_pair(pair_rows) for pair_rows in by_pair]


def _pair(rows: Sequence[Row]) -> RecordedPair:
    numbers = [json.loads(str(row["numbers"])) for row in rows]
    fit = fit_of(numbers[0])
    T = [RigidTransform.identity(), *(RigidTransform.from_exp_coords(other["away"]) for other in numbers[1:])]
    target, source = numbers[0]["centers"]
    return RecordedPair(
        cells=rows[0],
        hypotheses=tuple(_hypothesis(row, fit) for row in rows),
        T=tuple(T),
        off=np.array([[float(row["rotation_deg"]), float(row["off_voxels"])] for row in rows]),
        seen=seen_of(numbers[0]),
        xi=np.array(numbers[0]["xi"], np.float64),
        centers=(np.array(target), np.array(source)),
    )


def _hypothesis(row: Row, fit: Fit) -> Hypothesis:
    evidence = Evidence(**{name: float(row[f"e_{name}"]) for name in Evidence.__dataclass_fields__})
    return Hypothesis(fit, float(row["e_rotation"]), float(row["e_candidate"]), evidence)
