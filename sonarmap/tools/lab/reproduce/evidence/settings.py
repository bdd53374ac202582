"""Which pairs are recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.settings import check_pairs
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS

SEED = 880_301  # neither the evaluations nor the tests use pairs of this set
STILL, UNRELATED, SURVEY, DISTORTED = "still", "unrelated", "survey", "distorted"
# How many draws there are of each set. A draw of a kind is registered five times, one of a survey 35 times.
_COUNTS = dict.fromkeys(SCAN_KINDS, 300) | {STILL: 1200, UNRELATED: 1200, SURVEY: 240, DISTORTED: 300}


@dataclass(frozen=True, slots=True)
class EvidenceSettings:
    """What is run."""

    counts: Mapping[str, int] = field(default_factory=lambda: MappingProxyType(_COUNTS))  # draws of each set
    seed: int = SEED
    edge: int = 128  # voxels per edge; a sixth of the still pairs has half, another twice as many

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        check_pairs(min(self.counts.values()), self.seed)
