"""Every method on pairs not used in development: of every overlap, along the path of Table 1, and unrelated ones."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi
from typing import cast

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.result import Registrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.experiments import PAIR_SETS, Experiment, Outcome, Request, Settings, Value, as_asked
from sonarmap.tools.lab.reproduce.registrations import (
    OURS,
    SOURCES,
    answer,
    claims,
    compared_methods,
    errors,
    paper_grid,
    registrar,
)
from sonarmap.tools.lab.simulate.plan import table1_pair
from sonarmap.tools.lab.simulate.random_pairs import (
    EvaluationPair,
    Turn,
    UnrelatedPair,
    evaluation_pair,
    evaluation_unrelated,
)
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.overlap import OVERLAP_RADIUS, mutual_overlap
from sonarmap.tools.lab.simulate.trajectories import TABLE1_MOST

OVERLAP, PATHS, UNRELATED = PAIR_SETS
BATCH = 5  # pairs per job; in the set "overlap", one of each range of overlap
_FREE_SHARE = 5  # number of pairs with any yaw per pair with any rotation
# Neither development nor the tests use pairs of these seeds. Methods other than ours register fewer pairs, as they take
# ten times as long.
_USUAL = {
    "sets": (OVERLAP, PATHS, UNRELATED),
    "counts": {"yaw": 1000, "any": 1000 // _FREE_SHARE, UNRELATED: 500},  # numbers of related and unrelated pairs
    "peers": {"yaw": 300, "any": 300 // _FREE_SHARE, UNRELATED: 500},  # numbers of these that other methods register
    "seed": 20110,  # of these pairs
    # paths: seed k uses scene k modulo their number; sigma2: variances of the noise at the largest range [m^2]
    "scenes": ("floodgate", "harbor", "bridge", "wreck"),
    "sigma2": (1.0, 2.0, 4.0),
    "seeds": 20,
    "peer_seeds": 12,
    "first_seed": 101,
    "edge": 128,  # voxels per edge; the voxel fits each pair, except along paths: there the grid has the paper's extent
}
_QUICK = {"counts": {"yaw": BATCH, "any": BATCH, UNRELATED: BATCH}, "sigma2": (1.0,), "seeds": 1, "edge": 64}


@dataclass(frozen=True, slots=True)
class SetPair:
    """One simulated pair."""

    # cells that identify the pair; sets overlap and unrelated: turn, number, scene, sigma2 (0, 1 or 2: scaled to a
    # scene of 256 m), shared (the noise-free overlap), voxel_m; set paths: scene, seed, sigma2, step
    cells: dict[str, Value]
    # target, source: the scans
    target: Scan
    source: Scan
    truth: RigidTransform | None  # T_target_source between their frames; None if they share nothing
    grid: Grid


def create(request: Request) -> Experiment:
    """A job is five pairs by one method, as yaw/003/spectral or unrelated/003/spectral, or the scans of a path, as
    paths/floodgate/101/1.0/spectral. `quick` runs one job of each kind and method on grids of half the edge."""
    usual = _USUAL | compared_methods(request)
    if request.set:
        usual["sets"] = request.set
    if request.pairs:
        some = -(-request.pairs // _FREE_SHARE)
        usual["counts"] = usual["peers"] = {"yaw": request.pairs, "any": some, UNRELATED: request.pairs}
    if request.seeds:
        usual["peer_seeds"] = request.seeds
    settings = as_asked(request, usual, _QUICK | ({"counts": usual["counts"]} if request.pairs else {}))
    pairs_of = lru_cache(maxsize=1)(lambda batch: list(_pairs(batch, settings)))
    registrar_on = lru_cache(maxsize=len(settings.methods))(registrar)

    def run(job: str) -> Outcome:
        batch, _, method = job.rpartition("/")
        max_tilt = pi if batch.startswith("any") else None
        results = [
            _registered(pair, method, registrar_on(method, pair.grid, request.opened.selector, max_tilt))
            for pair in pairs_of(batch)
        ]
        return Outcome(tuple(row for row, _ in results), tuple(seconds for _, seconds in results))

    jobs = [job for name in settings.sets for job in _jobs(name, settings)]
    return Experiment("pairs", settings, jobs, run, (*SOURCES, "tools/lab/reproduce/pairs.py"), settings.methods)


def _jobs(name: str, settings: Settings) -> Iterator[str]:
    """The jobs of a set; jobs of the same pairs follow each other."""
    if name == PATHS:
        for k in range(settings.seeds):
            path = f"{PATHS}/{settings.scenes[k % len(settings.scenes)]}/{settings.first_seed + k}"
            methods = [method for method in settings.methods if method == OURS or k < settings.peer_seeds]
            yield from (f"{path}/{sigma2!r}/{method}" for sigma2 in settings.sigma2 for method in methods)
        return
    for part in ("yaw", "any") if name == OVERLAP else (UNRELATED,):
        ours, others = (-(-counts[part] // BATCH) for counts in (settings.counts, settings.peers))
        for k in range(ours):
            yield from (f"{part}/{k:03d}/{method}" for method in settings.methods if method == OURS or k < others)


def _pairs(batch: str, settings: Settings) -> Iterator[SetPair]:
    """The pairs of a job, the same for every method; a pair that cannot be simulated in its scene is left out."""
    part, *path, last = batch.split("/")
    if part == PATHS:
        scene, seed = path
        for step in range(TABLE1_MOST):
            target, source, truth = table1_pair(step, int(seed), float(last), scene)
            cells: dict[str, Value] = {"set": PATHS, "scene": scene, "seed": int(seed), "sigma2": float(last)}
            yield SetPair(cells | {"step": step}, target, source, truth, paper_grid(settings.edge))
        return
    for number in range(int(last) * BATCH, (int(last) + 1) * BATCH):
        # pairs of the turn "any" use the next seed
        try:
            if part == UNRELATED:
                yield unrelated(number, settings.seed, settings.edge)
            else:
                yield related(number, settings.seed + (part == "any"), cast(Turn, part), settings.edge)
        except InputError:
            continue


def _registered(pair: SetPair, method: str, registrar: Registrar) -> tuple[dict[str, Value], dict[str, Value]]:
    """The row of a pair, and the row of its time for preparing both scans and registering them."""
    registration, seconds = answer(registrar, pair.target, pair.source)
    cells = pair.cells | {"method": method}
    scored = {} if pair.truth is None else errors(registration, pair.truth, pair.grid.voxel)
    return cells | scored | claims(registration), cells | {"seconds": seconds}


def related(number: int, seed: int, turn: Turn, edge: int) -> SetPair:
    """Pair `number` of the set `seed`, on a grid of `edge` voxels per edge. Raises InputError: the scene has no such
    pair."""
    pair = evaluation_pair(number, seed, turn)
    scans = pair.scans()
    bare_target, bare_source, truth = replace(pair, noise=Noise()).scans()
    radius = OVERLAP_RADIUS * SCENE_KINDS[pair.scene].scale
    shared = mutual_overlap(bare_target.points, bare_source.points, truth, radius)
    return _set_pair({"set": OVERLAP, "turn": turn, "number": number}, pair, scans, shared, edge)


def unrelated(number: int, seed: int, edge: int) -> SetPair:
    """Pair `number` of the set `seed` of pairs that share nothing. Raises InputError: a scene has no free position."""
    pair = evaluation_unrelated(number, seed)
    cells: dict[str, Value] = {"set": UNRELATED, "turn": "none", "number": number}
    return _set_pair(cells, pair, (*pair.scans(), None), 0.0, edge)


def _set_pair(
    cells: dict[str, Value],
    pair: EvaluationPair | UnrelatedPair,
    scans: tuple[Scan, Scan, RigidTransform | None],
    shared: float,
    edge: int,
) -> SetPair:
    target, source, truth = scans
    grid = choose_grid((target, source), edge)
    sigma2 = pair.noise.sigma2 / SCENE_KINDS[pair.scene].scale ** 2
    cells |= {"scene": pair.scene, "sigma2": round(sigma2, 6), "shared": shared, "voxel_m": grid.voxel}
    return SetPair(cells, target, source, truth, grid)
