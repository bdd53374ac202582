"""What the experiments on unseen pairs run."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import OURS, ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.settings import (
    as_asked,
    check_pairs,
    check_scenes,
    check_seeds,
    check_variances,
    paper_grid,
)
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn

FIRST_SEED = 101  # neither development nor the tests use scenes and noise of these seeds


@dataclass(frozen=True, slots=True)
class StepsSettings:
    """What is run."""

    # keys of SCENE_KINDS; the seeds go round over them
    scenes: tuple[str, ...] = ("floodgate", "harbor", "bridge", "wreck")
    sigma2: tuple[float, ...] = (1.0, 2.0, 4.0)  # variances of the range noise at the largest range [m^2], each
    seeds: int = 20  # how many scenes and noises, counted from `first_seed`
    # how many of them, from the first, the methods other than ours register, as they take ten times as long
    peers: int = 12
    first_seed: int = FIRST_SEED  # >= 0
    edge: int = 128  # voxels per edge; the grid is as large as the paper's, whatever their number
    compared: ComparedMethods = field(default_factory=ComparedMethods)  # the methods

    def __post_init__(self) -> None:
        check_scenes(self.scenes)
        check_variances(self.sigma2)
        check_seeds(self.seeds, self.first_seed)

    @property
    def grid(self) -> Grid:
        """That all pairs share."""
        return paper_grid(self.edge)


SET_SEED = 20110  # neither development nor the tests use pairs of this set
BATCH = 5  # pairs of a job: one of every range of overlap


@dataclass(frozen=True, slots=True)
class PairSetSettings:
    """What is run."""

    pairs: int  # how many, at least 1, rounded up to whole batches
    seed: int = SET_SEED  # of the set, >= 0
    edge: int = 128  # voxels per edge; their size is chosen for each pair
    compared: ComparedMethods = field(default_factory=ComparedMethods)  # the methods

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_pairs(self.pairs, self.seed)

    @property
    def count(self) -> int:
        """Pairs in whole batches."""
        return batches(self.pairs) * BATCH


def pair_set_settings(request: Request, pairs: int, quick_pairs: int) -> PairSetSettings:
    """As the command line asks for it; a quick run takes `quick_pairs` on half the voxels."""
    usual = PairSetSettings(pairs, compared=compared_methods(request))
    return as_asked(usual, request, pairs=quick_pairs, edge=64)


def batches(pairs: int) -> int:
    """How many batches make at least so many pairs."""
    return -(-pairs // BATCH)


ANY_SHARE = 5  # for so many pairs with the turn "yaw" one with the turn "any"


@dataclass(frozen=True, slots=True)
class PairsSettings:
    """What is run."""

    # yaw, any: how many pairs of each turn, rounded up to whole batches; those of "any" are others
    yaw: int = 1000
    any: int = 1000 // ANY_SHARE
    # how many pairs of each turn, from the first, the methods other than ours register, as they take ten times as long;
    # they are spread over the overlaps as evenly as the whole set
    peers: Mapping[Turn, int] = field(default_factory=lambda: MappingProxyType({"yaw": 300, "any": 300 // ANY_SHARE}))
    seed: int = SET_SEED  # of the set
    edge: int = 128  # voxels per edge; their size is chosen for each pair
    compared: ComparedMethods = field(default_factory=ComparedMethods)  # the methods

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        if self.yaw < 1 or self.any < 1 or self.seed < 0:
            raise InputError(
                f"{self.yaw} and {self.any} pairs of the set {self.seed}; each must be 1 or more, and the seed >= 0"
            )

    @property
    def counts(self) -> dict[Turn, int]:
        """Pairs of each turn."""
        return {"yaw": batches(self.yaw) * BATCH, "any": batches(self.any) * BATCH}

    def registers(self, method: str, turn: Turn) -> int:
        """How many pairs of a turn a method registers."""
        count = self.counts[turn]
        return count if method == OURS else min(count, batches(self.peers[turn]) * BATCH)
