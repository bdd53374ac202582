"""What the experiment on kinds of scans runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, radians
from types import MappingProxyType

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.evaluation.methods import ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.evaluation.set_pairs import BATCH, batches
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, scan_kind
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments
from sonarmap.tools.methods.registry import find_method

SEED = 77014  # neither development nor the tests use pairs of this set
PAIRS = 100
QUICK_KINDS = ("patch", "swath")

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
class KindsSettings:
    """What is run.

    Attributes:
        kinds: keys of SCAN_KINDS.
        pairs: how many of each kind, rounded up to whole batches.
        seed: of the set of pairs, >= 0.
        edge: voxels per edge; their size is chosen for each pair.
        compared: the methods.
    """

    kinds: tuple[str, ...] = tuple(SCAN_KINDS)
    pairs: int = PAIRS
    seed: int = SEED
    edge: int = 128
    compared: ComparedMethods = field(default_factory=ComparedMethods)

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        for kind in self.kinds:
            scan_kind(kind)
        if self.pairs < 1 or self.seed < 0:
            raise InputError(f"{self.pairs} pairs of the set {self.seed}; there must be 1 or more, and the seed >= 0")

    @property
    def count(self) -> int:
        """Pairs of each kind, whole batches."""
        return batches(self.pairs) * BATCH

    def known(self, kind: str, method: str) -> tuple[str, ...]:
        """What a method is given of a kind's scans, each for itself: keys of PRIORS."""
        if "priors" not in find_method(method).options:
            return (NOTHING,)
        return (NOTHING, LEVELED, *([NAVIGATION] if kind == NAVIGATED else []))


def kinds_settings(request: Request) -> KindsSettings:
    """As the command line asks for it; `quick` is one batch of two kinds on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    return KindsSettings(
        kinds=QUICK_KINDS if request.quick else tuple(SCAN_KINDS),
        pairs=request.pairs or (BATCH if request.quick else PAIRS),
        seed=SEED if request.seed is None else request.seed,
        edge=request.grid or (64 if request.quick else 128),
        compared=compared_methods(request),
    )
