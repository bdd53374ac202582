"""What the experiment on pairs of every overlap runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS, ComparedMethods
from sonarmap.tools.lab.reproduce.evaluation.set_pairs import BATCH, SET_SEED, batches
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn

ANY_SHARE = 5  # for so many pairs with the turn "yaw" one with the turn "any"


@dataclass(frozen=True, slots=True)
class PairsSettings:
    """What is run.

    Attributes:
        yaw, any: how many pairs of each turn, rounded up to whole batches; those of "any" are others.
        peers: how many pairs of each turn, from the first, the methods other than ours register, as they take ten times
            as long; they are spread over the overlaps as evenly as the whole set.
        seed: of the set.
        edge: voxels per edge; their size is chosen for each pair.
        compared: the methods.
    """

    yaw: int = 1000
    any: int = 1000 // ANY_SHARE
    peers: Mapping[Turn, int] = field(default_factory=lambda: MappingProxyType({"yaw": 300, "any": 300 // ANY_SHARE}))
    seed: int = SET_SEED
    edge: int = 128
    compared: ComparedMethods = field(default_factory=ComparedMethods)

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
