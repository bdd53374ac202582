"""What the experiment on kinds of scans runs."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, radians
from types import MappingProxyType

from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, scan_kind
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments
from sonarmap.tools.methods.registry import find_method

SEED = 77014  # neither development nor the tests use pairs of this set
PAIRS = 100

NOTHING, LEVELED, NAVIGATION = "none", "attitude,depth", "navigation"
NAVIGATED = "swath"  # the kind that is registered with navigation too
NAVIGATION_OVERLAPS = (0.05, 0.4)  # those pairs share less
# What is known beforehand -> the instruments that measured it
PRIORS: Mapping[str, Instruments | None] = MappingProxyType(
    {
        NOTHING: None,
        LEVELED: Instruments(attitude=radians(1.5), heading=inf, depth=0.15, position=inf),
        NAVIGATION: Instruments(attitude=radians(1.5), heading=radians(1.5), depth=0.15, position=1.0),
    }
)


@dataclass(frozen=True, slots=True)
class KindsSettings(PairSetSettings):
    """What is run: so many pairs of each kind."""

    pairs: int = PAIRS
    seed: int = SEED
    kinds: tuple[str, ...] = tuple(SCAN_KINDS)  # keys of SCAN_KINDS

    def __post_init__(self) -> None:
        PairSetSettings.__post_init__(self)
        for kind in self.kinds:
            scan_kind(kind)

    def known(self, kind: str, method: str) -> tuple[str, ...]:
        """What a method is given of a kind's scans, each for itself: keys of PRIORS."""
        if "priors" not in find_method(method).options:
            return (NOTHING,)
        return (NOTHING, LEVELED, *([NAVIGATION] if kind == NAVIGATED else []))
