"""Every pair of folders of real scans with known truth, by every method, with the priors that there are and without."""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import radians
from pathlib import Path
from time import perf_counter
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.result import Registrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.navigation.priors import with_priors
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.lab.reproduce.answer import answer, claims, errors, finish_device
from sonarmap.tools.lab.reproduce.experiment import ByMethod, Outcome, Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request, folder_of
from sonarmap.tools.lab.reproduce.methods import ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.real.real_set import RealPair, RealSet, read_sets, without_truth
from sonarmap.tools.lab.reproduce.real.section import draw_real, real_section
from sonarmap.tools.lab.simulate.sensing.priors import KINDS, Instruments, instruments_for, measure_pose
from sonarmap.tools.methods.registry import Setup, find_method

DRAWS = 5
SIGMAS = (1.5, 3.0, 0.15, 3.0)  # of KINDS in their order [degrees, degrees, m, m]
MAX_TILT = 35.0  # degrees


@dataclass(frozen=True, slots=True)
class RealSettings:
    """What is run.

    Attributes:
        sets: the digest of each set's files, by its name.
        edge: voxels per edge.
        voxel: their size [m]; None to choose it for each pair.
        max_tilt: largest roll and pitch between two scans [degrees], of the methods that bound them.
        known: of KINDS, those instruments whose measurements are drawn about the truth; the methods that use priors
            register every pair with them and without.
        sigmas: their standard deviations, of KINDS in order [degrees, degrees, m, m].
        seeds, seed: how many times these errors are drawn for each pair, and the first seed, >= 0.
        first_only: whether to register only the first pair of every set.
        compared: the methods.
        left_out: folders beside the sets that have no gt.log.
    """

    sets: Mapping[str, str]
    edge: int = 128
    voxel: float | None = None
    max_tilt: float = MAX_TILT
    known: tuple[str, ...] = ()
    sigmas: tuple[float, ...] = SIGMAS
    seeds: int = DRAWS
    seed: int = 0
    first_only: bool = False
    compared: ComparedMethods = field(default_factory=ComparedMethods)
    left_out: tuple[str, ...] = ()

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
        units = {"attitude": np.pi / 180, "heading": np.pi / 180}
        sigmas = dict(zip(KINDS, self.sigmas, strict=True))
        return Instruments(
            **{kind: sigmas[kind] * units.get(kind, 1.0) if kind in self.known else math.inf for kind in KINDS}
        )

    @property
    def draws(self) -> dict[str, int]:
        """The seeds of the drawn measurements, by all that decides those of a pair in one word; empty for none."""
        sigmas = dict(zip(KINDS, self.sigmas, strict=True))
        words = ",".join(f"{kind}={sigmas[kind]:g}" for kind in self.known)
        seeds = range(self.seed, self.seed + self.seeds) if self.known else ()
        return {f"{words},seed={seed}": seed for seed in seeds}


def real_settings(request: Request, sets: Mapping[str, str], left_out: tuple[str, ...] = ()) -> RealSettings:
    """As the command line asks for it; `quick` is the first pair of every set on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    idle = [name for name in ("known_sigmas", "seeds", "seed") if request.known is None and name in request.given]
    if idle:
        flag = f"--{idle[0].replace('_', '-')}"
        raise InputError(f"{flag} has no effect without --known; give --known too, or leave it out")
    known = () if request.known is None else tuple(dict.fromkeys(request.known.split(",")))
    return RealSettings(
        sets=sets,
        edge=request.grid or (64 if request.quick else 128),
        voxel=request.voxel,
        max_tilt=MAX_TILT if request.max_tilt is None else request.max_tilt,
        known=tuple(kind for kind in KINDS if kind in known) if set(known) <= set(KINDS) else known,
        sigmas=_numbers(request.known_sigmas) if request.known_sigmas is not None else SIGMAS,
        seeds=request.seeds or (1 if request.quick else DRAWS),
        seed=request.seed or 0,
        first_only=request.quick,
        compared=compared_methods(request),
        left_out=left_out,
    )


def _numbers(text: str) -> tuple[float, ...]:
    """Numbers separated by commas; NaN for what is none."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        return (math.nan,)


NOTHING, FILE = "nothing", "priors.csv"
_TARGET_STREAM, _SOURCE_STREAM = 81, 82


class Real(ByMethod):
    """Registers pairs of real scans; a job is one pair, what is known beforehand, and one method."""

    name: ClassVar[str] = "real"
    sources: ClassVar[tuple[str, ...]] = (
        *(f"tools/{folder}" for folder in ("files/readers", "lab/evaluate", "lab/reproduce/answer.py")),
        *("tools/lab/reproduce/real/real_set.py", "tools/lab/simulate/sensing/priors.py", "spectral/grid.py"),
    )
    # the digest of a set and the drawn priors are part of a job's key: another set makes no job run again
    deciding: ClassVar[tuple[str, ...]] = ("edge", "voxel", "max_tilt")

    def __init__(self, sets: Sequence[RealSet], settings: RealSettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        super().__init__(settings, device)
        self._scans = lru_cache(maxsize=1)(self._read)  # kept for the next method
        self._sets = {real_set.key: real_set for real_set in sets}

    def jobs(self) -> Sequence[str]:
        """Set, pair, what is known and method, as in kitchen@1f0c.../0-2/nothing/spectral."""
        return [
            f"{real_set.key}/{pair.name}/{known}/{method}"
            for real_set in self._sets.values()
            for pair in (real_set.pairs[:1] if self.settings.first_only else real_set.pairs)
            for known in self._variants(real_set)
            for method in self.methods
            if known == NOTHING or "priors" in find_method(method).options
        ]

    def run(self, job: str) -> Outcome:
        """Register one pair by one method."""
        key, pair_name, known, method = job.split("/")
        real_set = self._sets[key]
        pair = next(pair for pair in real_set.pairs if pair.name == pair_name)
        *scans, grid = self._scans(pair.target, pair.source)
        target, source = self._with_priors(scans, real_set, pair, known)
        built = self._registrar(method, grid)
        finish_device(built)
        start = perf_counter()
        registration = answer(built, target, source)
        seconds = perf_counter() - start
        cells = {
            "set": real_set.name,
            "pair": pair.name,
            "known": ", ".join(self.settings.known) if known in self.settings.draws else known,
            "draw": str(self.settings.draws.get(known, "")),
            "method": method,
        }
        scored = errors(registration, pair.T_target_source, grid.voxel)
        row = cells | {"voxel_m": grid.voxel} | scored | claims(registration)
        return Outcome((row,), (cells | {"seconds": seconds},))

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """What every method gets right and believes, set by set and pair by pair."""
        return real_section(rows, seconds, self.settings)

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        """Outcomes by set and method, and the errors of all pairs."""
        draw_real(folder, rows, self.settings)

    def _variants(self, real_set: RealSet) -> list[str]:
        """What is known beforehand, each for itself."""
        return [NOTHING, *([FILE] if real_set.priors else []), *self.settings.draws]

    def _read(self, target: Path, source: Path) -> tuple[Scan, Scan, Grid]:
        """The scans of a pair, and the grid for them."""
        scans = read_scan(target), read_scan(source)
        return *scans, choose_grid(scans, self.settings.edge, self.settings.voxel)

    def _with_priors(self, scans: Sequence[Scan], real_set: RealSet, pair: RealPair, known: str) -> Sequence[Scan]:
        """The scans with what is known of them: a row of the file, or measurements drawn about the truth."""
        if known == NOTHING:
            return scans
        if known == FILE and real_set.priors is not None:
            return with_priors(scans, real_set.priors, allow_unknown=True)
        poses = RigidTransform.identity(), pair.T_target_source  # the world is the target's frame
        entropy = [self.settings.draws[known], zlib.crc32(f"{real_set.name}/{pair.name}".encode())]
        return [
            replace(
                scan,
                prior=measure_pose(pose, self.settings.instruments, np.random.default_rng([*entropy, stream])),
            )
            for scan, pose, stream in zip(scans, poses, (_TARGET_STREAM, _SOURCE_STREAM), strict=True)
        ]

    def _registrar(self, method: str, grid: Grid) -> Registrar:
        bounded = "max_tilt" in find_method(method).options
        changes = {"max_tilt": radians(self.settings.max_tilt)} if bounded else {}
        return find_method(method).make(Setup(grid, self.device, changes=changes))


def create(request: Request) -> Real:
    """The experiment as the command line asks for it.

    Raises:
        InputError: the folder, a gt.log in it, or an option's value will not do.
    """
    folder = folder_of(request)
    sets = read_sets(folder)
    settings = real_settings(request, {real_set.name: real_set.digest for real_set in sets}, without_truth(folder))
    return Real(sets, settings, request.opened.selector)
