"""Which pairs are traced."""

from dataclasses import dataclass

from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.evidence.settings import STILL
from sonarmap.tools.lab.reproduce.settings import check_pairs
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS

SEED = 39_017  # neither the fits nor the tests use pairs of this set
STEPS = (8, 9, 10, 11, 12)  # of the continued Table 1
VARIANCES = (1.0, 2.0, 4.0)  # of the range noise there, at the largest range [m^2]
KINDS = (*SCAN_KINDS, STILL)


@dataclass(frozen=True, slots=True)
class FunnelSettings:
    """What is run."""

    pairs: int = 100  # of each kind; of each step and variance of Table 1 a fifth as many
    seed: int = SEED
    edge: int = 128  # voxels per edge

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_pairs(self.pairs, self.seed)
