"""What an experiment on pairs of the evaluation's set runs."""

from dataclasses import dataclass, field

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.evaluation.methods import ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.evaluation.set_pairs import SET_SEED
from sonarmap.tools.lab.reproduce.experiments import Request


@dataclass(frozen=True, slots=True)
class PairSetSettings:
    """What is run.

    Attributes:
        pairs: how many, at least 1.
        seed: of the set, >= 0.
        edge: voxels per edge; their size is chosen for each pair.
        compared: the methods.
    """

    pairs: int
    seed: int = SET_SEED
    edge: int = 128
    compared: ComparedMethods = field(default_factory=ComparedMethods)

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0)
        if self.pairs < 1 or self.seed < 0:
            raise InputError(f"{self.pairs} pairs of the set {self.seed}; there must be 1 or more, and the seed >= 0")


def pair_set_settings(request: Request, pairs: int, quick_pairs: int) -> PairSetSettings:
    """As the command line asks for it.

    Args:
        request: the options.
        pairs: how many where no option says it.
        quick_pairs: how many then in a quick run, which takes half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    return PairSetSettings(
        pairs=request.pairs or (quick_pairs if request.quick else pairs),
        seed=SET_SEED if request.seed is None else request.seed,
        edge=request.grid or (64 if request.quick else 128),
        compared=compared_methods(request),
    )
