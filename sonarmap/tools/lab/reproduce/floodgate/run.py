"""The flood gate (paper Sect. 4, Table 2, Figs. 22 to 31): maps of eighteen scans, made by chaining registrations."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from time import perf_counter
from typing import Any, ClassVar

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.result import Registrar, Registration
from sonarmap.tools.lab.reproduce.answer import finish_device
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.floodgate.chain import (
    COMPARED,
    PAIR,
    POSE,
    TRUTH,
    VOXEL,
    pair_row,
    pose_rows,
    runs,
    survey,
)
from sonarmap.tools.lab.reproduce.floodgate.figure import draw_floodgate
from sonarmap.tools.lab.reproduce.floodgate.section import floodgate_section
from sonarmap.tools.lab.reproduce.settings import EXTENT, as_asked, check_seeds, paper_grid
from sonarmap.tools.lab.simulate.paths.stations import PAPER_COUNT
from sonarmap.tools.methods.registry import ALL_METHODS, build, is_installed

# The paper's three, and ours
PAPER_METHODS = ("icp", "planes", "hemisphere", "spectral")
# Methods of today; the last is left out where its package is not installed
OTHER_METHODS = ("icp-plane", "fpfh-ransac", "kiss")
PAPER_EDGES = (128, 256)
MAP = "map"


@dataclass(frozen=True, slots=True)
class FloodgateSettings:
    """What is run."""

    methods: tuple[str, ...] = (*PAPER_METHODS, *OTHER_METHODS)  # keys of COMPARED
    edges: tuple[int, ...] = PAPER_EDGES  # voxels per edge of the grids, for the methods that have one
    seeds: int = 3  # how many surveys, each with a bed, a sea and a noise of its own, counted from `first_seed`
    first_seed: int = 1  # >= 0
    scans: int = PAPER_COUNT  # of each survey, from its start
    left_out: tuple[str, ...] = ()  # methods that would have run were their packages installed

    def __post_init__(self) -> None:
        unknown = [name for name in self.methods if name not in COMPARED]
        if unknown or not self.methods:
            raise InputError(f"no method is called {', '.join(unknown) or 'nothing'}; there are {', '.join(COMPARED)}")
        check_seeds(self.seeds, self.first_seed)
        if not 2 <= self.scans <= PAPER_COUNT:
            raise InputError(f"{self.scans} scans; there must be 2 to {PAPER_COUNT}")
        for edge in self.edges:
            Grid(edge, 1.0)

    @property
    def all_seeds(self) -> range:
        """Of the surveys."""
        return range(self.first_seed, self.first_seed + self.seeds)


class Floodgate(Experiment):
    """Every method registers every scan to the one before it; a map is what chaining these makes."""

    name = "floodgate"
    sources: ClassVar[tuple[str, ...]] = (
        "tools/lab/reproduce/settings.py",
        *("tools/lab/simulate", "tools/lab/evaluate", "tools/lab/reproduce/answer.py"),
        *("tools/lab/reproduce/floodgate/chain.py", *ALL_METHODS),
    )
    make_section, draw_pictures = staticmethod(floodgate_section), staticmethod(draw_floodgate)

    def __init__(self, settings: FloodgateSettings, device: Device | None = None) -> None:
        """`device` is needed to run jobs, not to show what they found."""
        super().__init__(settings, device)
        self._current: tuple[tuple[int, str, int], Registrar, dict[int, Any]] | None = None
        self._step = cache(self._measure)

    def jobs(self) -> Sequence[str]:
        """seed/method/grid/source for every pair, and seed/method/grid/map for what is made of them."""
        settings: FloodgateSettings = self.settings
        parts = [*(f"{source:02d}" for source in range(1, settings.scans)), MAP]
        jobs = []
        for seed in settings.all_seeds:
            jobs.append(f"{seed}/{TRUTH}/0/{MAP}")
            jobs += [f"{seed}/{m}/{e}/{part}" for m, e in runs(settings.methods, settings.edges) for part in parts]
        return jobs

    def run(self, job: str) -> Outcome:
        """Register one pair, or chain the pairs of one survey, which are registered anew where that is not just done.

        Raises:
            InputError: a scan shows too little.
        """
        first, method, second, part = job.split("/")
        seed, edge = int(first), int(second)
        run: dict[str, Value] = {"seed": seed, "method": method, "grid": edge}
        now = survey(seed, self.settings.scans)
        if part == MAP:
            sources = range(1, self.settings.scans)
            steps = [self._step(seed, method, edge, k)[0].T_target_source for k in sources] if method != TRUTH else None
            return Outcome(tuple({"row": POSE} | run | row for row in pose_rows(now, steps)))
        source = int(part)
        found, prepare, register = self._step(seed, method, edge, source)
        row = {"row": PAIR} | run | pair_row(now, source, found.T_target_source, bool(found.accepted))
        return Outcome((row,), (run | {"scan": source, "prepare_s": prepare, "register_s": register},))

    def _measure(self, seed: int, method: str, edge: int, source: int) -> tuple[Registration, float, float]:
        """One registration; times of preparing the source and of the pair, whose target is prepared [s]."""
        registrar, prepared = self._registrar(seed, method, edge)
        scans = survey(seed, self.settings.scans).scans
        if source - 1 not in prepared:
            prepared[source - 1] = registrar.prepare(scans[source - 1])
            finish_device(registrar)
        start = perf_counter()
        prepared[source] = registrar.prepare(scans[source])
        finish_device(registrar)
        middle = perf_counter()
        result = registrar.register(prepared[source - 1], prepared[source])
        end = perf_counter()
        for old in [k for k in prepared if k != source]:
            del prepared[old]
        return result, middle - start, end - middle

    def _registrar(self, seed: int, method: str, edge: int) -> tuple[Registrar, dict[int, Any]]:
        """The registrar of one survey and the scans that it holds prepared; one at a time, for the device's memory.

        A new one first registers a scan to itself, untimed: kernels are compiled and packages imported then.
        """
        key = (seed, method, edge)
        if self._current is None or self._current[0] != key:
            self._current = None
            grid = paper_grid(edge) if edge else Grid(round(EXTENT / VOXEL), VOXEL)
            registrar = build(method, grid, self.device.selector if self.device else None, seed)
            scan = registrar.prepare(survey(seed, self.settings.scans).scans[0])
            registrar.register(scan, scan)
            self._current = (key, registrar, {})
        return self._current[1], self._current[2]


def create(request: Request) -> Floodgate:
    """The experiment as the command line asks for it: `quick` is one survey by the paper's methods, on one grid."""
    methods = PAPER_METHODS if request.quick else FloodgateSettings().methods
    left_out = tuple(name for name in methods if not is_installed(name))
    usual = FloodgateSettings(tuple(name for name in methods if name not in left_out), left_out=left_out)
    return Floodgate(as_asked(usual, request, edges=PAPER_EDGES[:1], seeds=1), request.device)
