"""The pairs that the evaluation registers, and experiments that register batches of them, each by one method."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import ClassVar, cast

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.answer import answer, claims, errors
from sonarmap.tools.lab.reproduce.evaluation.pairs_section import draw_pairs, pairs_section
from sonarmap.tools.lab.reproduce.evaluation.settings import (
    ANY_SHARE,
    BATCH,
    PairsSettings,
    pair_set_settings,
)
from sonarmap.tools.lab.reproduce.evaluation.unrelated_section import draw_unrelated, unrelated_section
from sonarmap.tools.lab.reproduce.experiment import ByMethod, Outcome, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import METHOD_SOURCES, compared_methods, registrar
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.simulate.pairs.pair_set import evaluation_pair, evaluation_unrelated
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.overlap import OVERLAP_RADIUS, mutual_overlap

UNRELATED_PAIRS = 500
SOURCES = (*METHOD_SOURCES, *(f"tools/lab/reproduce/evaluation/{name}.py" for name in ("pair_set", "settings")))


@dataclass(frozen=True, slots=True)
class SetPair:
    """One simulated pair."""

    # turn, number, scene, sigma2 (0, 1 or 2: as if the scene were of 256 m), shared (the noise-free overlap), voxel_m
    cells: dict[str, Value]
    # target, source: the scans
    target: Scan
    source: Scan
    truth: RigidTransform | None  # T_target_source between their frames; None where they share nothing
    grid: Grid  # as the pair's own extent has it chosen


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


class PairSetExperiment(ByMethod):
    """Registers batches of pairs; a job's key is a batch's, then a slash and a method."""

    sources: ClassVar[tuple[str, ...]] = SOURCES

    @abstractmethod
    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair of a batch, by its number in the set; None where its scene has no such pair."""

    def run(self, job: str) -> Outcome:
        """Register a batch by one method."""
        batch, _, method = job.rpartition("/")
        rows = []
        for pair in self.scans(batch):
            built = registrar(method, pair.grid, self.device, pi if batch.startswith("any") else None)
            registration = answer(built, pair.target, pair.source)
            scored = {} if pair.truth is None else errors(registration, pair.truth, pair.grid.voxel)
            rows.append(pair.cells | {"method": method} | scored | claims(registration))
        return Outcome(tuple(rows))

    def make_scans(self, batch: str) -> Sequence[SetPair]:
        """The pairs of a batch that there are."""
        first = int(batch.rpartition("/")[2]) * BATCH
        pairs = [self.pair(batch, number) for number in range(first, first + BATCH)]
        return [pair for pair in pairs if pair is not None]


class Pairs(PairSetExperiment):
    """Registers the pairs of a set; a job is five of them and one method."""

    name = "pairs"
    make_section, draw_pictures = staticmethod(pairs_section), staticmethod(draw_pairs)

    def jobs(self) -> Sequence[str]:
        """Turn, batch and method, as in yaw/003/spectral."""
        settings: PairsSettings = self.settings
        return [
            f"{turn}/{k:03d}/{method}"
            for turn, count in settings.counts.items()
            for k in range(count // BATCH)
            for method in self.methods
            if k < settings.registers(method, turn) // BATCH
        ]

    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair of the batch's turn; those with the turn "any" are of the next set."""
        turn = cast(Turn, batch.partition("/")[0])
        return related(number, self.settings.seed + (turn == "any"), turn, self.settings.edge)


def create_pairs(request: Request) -> Pairs:
    """The experiment as the command line asks for it; `quick` is one batch of each turn on half the voxels."""
    usual = PairsSettings(compared=compared_methods(request))
    if request.pairs or request.quick:
        count = request.pairs or BATCH
        some = -(-count // ANY_SHARE)
        usual = replace(usual, yaw=count, any=some)
        usual = replace(usual, peers={"yaw": count, "any": some}) if request.pairs else usual
    return Pairs(as_asked(usual, request, edge=64), request.opened.selector)


class Unrelated(PairSetExperiment):
    """Registers pairs of strangers; a job is five of them and one method."""

    name = "unrelated"
    make_section, draw_pictures = staticmethod(unrelated_section), staticmethod(draw_unrelated)

    def jobs(self) -> Sequence[str]:
        """Batch and method, as in 003/spectral."""
        return [f"{k:03d}/{method}" for k in range(self.settings.count // BATCH) for method in self.methods]

    def pair(self, batch: str, number: int) -> SetPair | None:
        """A pair that shares nothing."""
        return unrelated(number, self.settings.seed, self.settings.edge)


def create_unrelated(request: Request) -> Unrelated:
    """The experiment as the command line asks for it; `quick` is one batch on half the voxels."""
    return Unrelated(pair_set_settings(request, UNRELATED_PAIRS, quick_pairs=BATCH), request.opened.selector)
