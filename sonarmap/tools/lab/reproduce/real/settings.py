"""What the experiment on real scans runs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.simulate.sensing.navigation import KINDS, Instruments, instruments_for

SIGMAS = (1.5, 3.0, 0.15, 3.0)  # of KINDS in their order [degrees, degrees, m, m]


@dataclass(frozen=True, slots=True)
class RealSettings:
    """What is run."""

    sets: Mapping[str, str]  # the digest of each set's files, by its name
    edge: int = 128  # voxels per edge
    voxel: float | None = None  # their size [m]; None to choose it for each pair
    max_tilt: float = 35.0  # largest roll and pitch between two scans [degrees], of the methods that bound them
    # of KINDS, those instruments whose measurements are drawn about the truth; the methods that use priors register
    # every pair with them and without
    known: tuple[str, ...] = ()
    sigmas: tuple[float, ...] = SIGMAS  # their standard deviations, of KINDS in order [degrees, degrees, m, m]
    # seeds, seed: how many times these errors are drawn for each pair, and the first seed, >= 0
    seeds: int = 5
    seed: int = 0
    first_only: bool = False  # whether to register only the first pair of every set
    compared: ComparedMethods = field(default_factory=ComparedMethods)  # the methods
    left_out: tuple[str, ...] = ()  # folders beside the sets that have no gt.log

    def __post_init__(self) -> None:
        Grid(self.edge, 1.0 if self.voxel is None else self.voxel)
        if not 0 < self.max_tilt <= 180 or self.seed < 0 or self.seeds < 1:
            raise InputError(
                f"the largest tilt is {self.max_tilt:g} degrees, with {self.seeds} seeds from {self.seed} on; wanted a "
                "tilt above 0 and at most 180 degrees, 1 or more seeds, and the first >= 0"
            )
        if len(self.sigmas) != len(KINDS) or not all(0 < sigma < math.inf for sigma in self.sigmas):
            raise InputError(
                f"the standard deviations are {', '.join(f'{sigma:g}' for sigma in self.sigmas)}; wanted four numbers "
                f"above 0, of {', '.join(KINDS)} [degrees, degrees, m, m]"
            )
        if self.known:
            instruments_for(self.known)

    @property
    def instruments(self) -> Instruments:
        """Those that are known, with their standard deviations."""
        in_radians = {"attitude", "heading"}
        sigmas = {
            kind: math.radians(sigma) if kind in in_radians else sigma
            for kind, sigma in zip(KINDS, self.sigmas, strict=True)
        }
        return Instruments(**{kind: sigmas[kind] if kind in self.known else math.inf for kind in KINDS})

    @property
    def draws(self) -> dict[str, int]:
        """The seeds of the drawn measurements, by all that decides those of a pair in one word; empty for none."""
        sigmas = dict(zip(KINDS, self.sigmas, strict=True))
        words = ",".join(f"{kind}={sigmas[kind]:g}" for kind in self.known)
        seeds = range(self.seed, self.seed + self.seeds) if self.known else ()
        return {f"{words},seed={seed}": seed for seed in seeds}


def real_settings(request: Request, sets: Mapping[str, str], left_out: tuple[str, ...] = ()) -> RealSettings:
    """As the command line asks for it; `quick` is the first pair of every set on half the voxels."""
    idle = [name for name in ("known_sigmas", "seeds", "seed") if request.known is None and name in request.given]
    if idle:
        flag = f"--{idle[0].replace('_', '-')}"
        raise InputError(f"{flag} has no effect without --known; give --known too, or leave it out")
    known = () if request.known is None else tuple(dict.fromkeys(request.known.split(",")))
    usual = RealSettings(
        sets=sets,
        known=tuple(kind for kind in KINDS if kind in known) if set(known) <= set(KINDS) else known,
        sigmas=_numbers(request.known_sigmas) if request.known_sigmas is not None else SIGMAS,
        compared=compared_methods(request),
        left_out=left_out,
    )
    return as_asked(usual, request, edge=64, seeds=1, first_only=True)


def _numbers(text: str) -> tuple[float, ...]:
    """Numbers separated by commas; NaN for what is none."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        return (math.nan,)
