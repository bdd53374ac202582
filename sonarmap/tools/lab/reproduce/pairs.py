"""Every method on pairs not used in development.

`create` is for pairs of every overlap, along the path of Table 1, and unrelated ones, `create_kinds` for pairs of every
kind of scan, with and without priors of instruments.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, pi, radians
from typing import cast

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.geometry import cross_matrices
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.lab.reproduce.experiments import PAIR_SETS, Experiment, Outcome, Request, Settings, Value, as_asked
from sonarmap.tools.lab.reproduce.registrations import OURS, answer, compared_methods, paper_grid, registrar, scores
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from sonarmap.tools.lab.simulate.plan import table1_pair
from sonarmap.tools.lab.simulate.random_pairs import Turn, evaluation_pair, evaluation_unrelated
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.trajectories import TABLE1_MOST
from sonarmap.tools.lab.simulate.viewpoints import OVERLAP_RADIUS, mutual_overlap
from sonarmap.tools.methods.registry import find_method

OVERLAP, PATHS, UNRELATED = PAIR_SETS
SOURCES = (
    *("tools/lab/simulate", "tools/lab/evaluate", "spectral/grid.py"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("registrations", "pairs")),
)
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
        rows, times = [], []
        for pair in pairs_of(batch):
            built = registrar_on(method, pair.grid, request.opened.selector, max_tilt)
            registration, seconds = answer(built, pair.target, pair.source)
            cells = pair.cells | {"method": method}
            rows.append(cells | scores(registration, pair.truth, pair.grid.voxel))
            times.append(cells | {"seconds": seconds})
        return Outcome(tuple(rows), tuple(times))

    jobs = [job for name in settings.sets for job in _jobs(name, settings)]
    return Experiment("pairs", settings, jobs, run, SOURCES, settings.methods)


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


def related(number: int, seed: int, turn: Turn, edge: int) -> SetPair:
    """Pair `number` of the set `seed`, on a grid of `edge` voxels per edge. Raises InputError: the scene has no such
    pair."""
    pair = evaluation_pair(number, seed, turn)
    scans = pair.scans()
    bare_target, bare_source, truth = replace(pair, noise=Noise()).scans()
    radius = OVERLAP_RADIUS * SCENE_KINDS[pair.scene].scale
    shared = mutual_overlap(bare_target.points, bare_source.points, truth, radius)
    cells: dict[str, Value] = {"set": OVERLAP, "turn": turn, "number": number, "scene": pair.scene}
    return _set_pair(cells, pair.noise, scans, shared, edge)


def unrelated(number: int, seed: int, edge: int) -> SetPair:
    """Pair `number` of the set `seed` of pairs that share nothing. Raises InputError: a scene has no free position."""
    pair = evaluation_unrelated(number, seed)
    cells: dict[str, Value] = {"set": UNRELATED, "turn": "none", "number": number, "scene": pair.scene}
    return _set_pair(cells, pair.noise, (*pair.scans(), None), 0.0, edge)


def _set_pair(
    cells: dict[str, Value], noise: Noise, scans: tuple[Scan, Scan, RigidTransform | None], shared: float, edge: int
) -> SetPair:
    target, source, truth = scans
    grid = choose_grid((target, source), edge)
    sigma2 = noise.sigma2 / SCENE_KINDS[str(cells["scene"])].scale ** 2
    cells |= {"sigma2": round(sigma2, 6), "shared": shared, "voxel_m": grid.voxel}
    return SetPair(cells, target, source, truth, grid)


# Neither development nor the tests use pairs of this seed
_KINDS = {"kinds": tuple(SCAN_KINDS), "pairs": 100, "seed": 77014, "edge": 128}
NOTHING, LEVELED, NAVIGATION = "none", "attitude,depth", "navigation"
NAVIGATED = "swath"  # the kind that is also registered with navigation
NAVIGATION_OVERLAPS = (0.05, 0.4)  # range of the overlap of these pairs
# Name of the priors -> the instruments that measure them
PRIORS: Mapping[str, Instruments | None] = {
    NOTHING: None,
    LEVELED: Instruments(attitude=radians(1.5), heading=inf, depth=0.15, position=inf),
    NAVIGATION: Instruments(attitude=radians(1.5), heading=radians(1.5), depth=0.15, position=1.0),
}
DIRECTIONS = (1, 2, 3)


def create_kinds(request: Request) -> Experiment:
    """A job is five pairs of a kind by one method with some priors, as swath/none/003/spectral; `quick` runs one batch
    of two kinds on grids of half the edge."""
    usual = _KINDS | compared_methods(request)
    settings = as_asked(request, usual, {"kinds": ("patch", "swath"), "pairs": BATCH, "edge": 64})

    @lru_cache(maxsize=1)
    def pairs_of(kind: str, navigated: bool, batch: int) -> list[tuple[KindPair, Grid]]:
        """Pairs of a batch without priors, each with its grid; a pair that cannot be simulated is left out."""
        pairs = []
        for number in range(batch * BATCH, (batch + 1) * BATCH):
            try:
                pair = kind_pair(kind, number, settings.seed, NAVIGATION_OVERLAPS if navigated else None)
            except InputError:
                continue
            pairs.append((pair, choose_grid((pair.target, pair.source), settings.edge)))
        return pairs

    def run(job: str) -> Outcome:
        kind, known, batch, method = job.split("/")
        pairs = pairs_of(kind, known == NAVIGATION, int(batch))
        device = request.opened.selector
        return Outcome(tuple(_kind_row(pair, grid, known, method, device) for pair, grid in pairs))

    jobs = [
        f"{kind}/{known}/{batch:03d}/{method}"
        for kind in settings.kinds
        for batch in range(-(-settings.pairs // BATCH))
        for known in PRIORS
        for method in settings.methods
        if known == NOTHING or ("priors" in find_method(method).options and (known != NAVIGATION or kind == NAVIGATED))
    ]
    return Experiment("kinds", settings, jobs, run, SOURCES, settings.methods)


def _kind_row(pair: KindPair, grid: Grid, known: str, method: str, device: str | None) -> dict[str, Value]:
    instruments = PRIORS[known]
    measured = pair if instruments is None else pair.with_priors(instruments)
    registration, _ = answer(registrar(method, grid, device), measured.target, measured.source)
    cells: dict[str, Value] = {name: getattr(pair, name) for name in ("kind", "number", "scene", "relief", "shared")}
    cells |= {"priors": known, "method": method, "voxel_m": grid.voxel}
    cells |= scores(registration, pair.T_target_source, grid.voxel)
    if known == NAVIGATION and measured.target.prior is not None and measured.source.prior is not None:
        cells |= navigation_cells(registration, pair.T_target_source, measured.target.prior, measured.source.prior)
    return cells


def navigation_cells(
    registration: Registration, truth: RigidTransform, target: PosePrior, source: PosePrior
) -> dict[str, Value]:
    """Standard deviations and signed errors of a registration and of navigation alone, along three directions [m].

    The directions are the eigenvectors of the translation's covariance in the target's axes, ordered by growing
    standard deviation. The priors measure both poses completely. Empty if the registration has no covariance.
    """
    covariance = np.asarray(registration.covariance)[3:, 3:]
    if not np.isfinite(covariance).all():
        return {}
    R = registration.T_target_source.rotation.as_matrix()  # the covariance is in the source's axes
    variances, axes = np.linalg.eigh(R @ covariance @ R.T)
    navigated = target.T_world_sensor.inv() * source.T_world_sensor
    navigation_sigmas = np.sqrt(np.einsum("ik,ij,jk->k", axes, navigation_covariance(target, source), axes))
    columns = {
        "sigma_m": np.sqrt(np.maximum(variances, 0.0)),
        "navigation_sigma_m": navigation_sigmas,
        "error_m": (registration.T_target_source.translation - truth.translation) @ axes,
        "navigation_error_m": (navigated.translation - truth.translation) @ axes,
    }
    return {
        f"direction{number}_{name}": float(values[number - 1])
        for number in DIRECTIONS
        for name, values in columns.items()
    }


def navigation_covariance(target: PosePrior, source: PosePrior) -> np.ndarray:
    """(3, 3) covariance of the translation of T_target_source by the priors, in the target's axes [m^2]: from the
    errors of both positions and of the target's rotation."""
    baseline = source.T_world_sensor.translation - target.T_world_sensor.translation
    lever = cross_matrices(baseline[None])[0]
    world = np.diag(target.sigmas[3:] ** 2 + source.sigmas[3:] ** 2)
    world += lever @ np.diag(target.sigmas[:3] ** 2) @ lever.T
    R = target.T_world_sensor.rotation.as_matrix()
    return R.T @ world @ R
