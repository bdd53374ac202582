"""The pairs that the evaluation registers: which they are, and what is known of them."""

from dataclasses import dataclass, replace

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.experiment import Value
from sonarmap.tools.lab.simulate.pairs.pair_set import evaluation_pair, evaluation_unrelated
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.overlap import OVERLAP_RADIUS, mutual_overlap

SET_SEED = 20110  # neither development nor the tests use pairs of this set
BATCH = 5  # pairs of a job: one of every range of overlap


@dataclass(frozen=True, slots=True)
class SetPair:
    """One simulated pair.

    Attributes:
        cells: turn, number, scene, sigma2 (0, 1 or 2: as if the scene were of 256 m), shared (the noise-free overlap),
            voxel_m.
        target, source: the scans.
        truth: T_target_source between their frames; None where they share nothing.
        grid: as the pair's own extent has it chosen.
    """

    cells: dict[str, Value]
    target: Scan
    source: Scan
    truth: RigidTransform | None
    grid: Grid


def batches(pairs: int) -> int:
    """How many batches make at least so many pairs."""
    return -(-pairs // BATCH)


def related(number: int, seed: int, turn: Turn, edge: int) -> SetPair | None:
    """Pair `number` of the set `seed`, on a grid of `edge` voxels; None where the scene has no such pair."""
    pair = evaluation_pair(number, seed, turn)
    scale = SCENE_KINDS[pair.scene].scale
    try:
        target, source, truth = pair.scans()
        bare_target, bare_source, _ = replace(pair, noise=Noise()).scans()
    except InputError:
        return None
    shared = mutual_overlap(bare_target.points, bare_source.points, truth, OVERLAP_RADIUS * scale)
    grid = choose_grid((target, source), edge)
    cells = _cells(turn, number, pair.scene, pair.noise, shared, grid)
    return SetPair(cells, target, source, truth, grid)


def unrelated(number: int, seed: int, edge: int) -> SetPair | None:
    """Pair `number` of the set `seed` of pairs that share nothing; None where a scene has no clear place."""
    pair = evaluation_unrelated(number, seed)
    try:
        target, source = pair.scans()
    except InputError:
        return None
    grid = choose_grid((target, source), edge)
    return SetPair(_cells("none", number, pair.scene, pair.noise, 0.0, grid), target, source, None, grid)


def _cells(turn: str, number: int, scene: str, noise: Noise, shared: float, grid: Grid) -> dict[str, Value]:
    sigma2 = noise.sigma2 / SCENE_KINDS[scene].scale ** 2
    cells: dict[str, Value] = {"turn": turn, "number": number, "scene": scene}
    return cells | {"sigma2": round(sigma2, 6), "shared": shared, "voxel_m": grid.voxel}
