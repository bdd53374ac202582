"""Table 1 of the paper (Sect. 3, Figs. 20, 21): scans ever farther apart, with Gaussian noise along the beams."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import ClassVar

from sonarmap.kernels.device.device import Device
from sonarmap.tools.lab.reproduce.experiment import Outcome, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.gaussian.figure import draw_parameters, draw_rates
from sonarmap.tools.lab.reproduce.gaussian.row import GaussianRow, GaussianTime
from sonarmap.tools.lab.reproduce.gaussian.section import parameters_picture, rates_picture, section
from sonarmap.tools.lab.reproduce.gaussian.series import Series
from sonarmap.tools.lab.reproduce.gaussian.settings import EXTENT, FIRST_SEED, GaussianSettings, grid_of
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT


class Gaussian:
    """Registers S0..S9 to the reference scan, by every method, on every grid, under every noise and seed.

    A job is one scan, so that it takes seconds. Only one grid's plans, and one reference scan's preparation, are on the
    device at a time.
    """

    name: ClassVar[str] = "gaussian"
    sources: ClassVar[tuple[str, ...]] = ("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate")

    def __init__(self, settings: GaussianSettings, device: Device) -> None:
        self.settings, self._device = settings, device
        self._series: Series | None = None
        seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
        self._pairs = {
            f"{edge}/{sigma2!r}/{seed}/S{index}": (edge, sigma2, seed, index)
            for edge, sigma2, seed, index in product(settings.edges, settings.sigma2, seeds, range(TABLE1_COUNT))
        }

    def jobs(self) -> Sequence[str]:
        """Grid, noise, seed and scan, as in 128/1.0/11/S3."""
        return list(self._pairs)

    def run(self, job: str) -> Outcome:
        """Register one scan by every method.

        Raises:
            InputError: a scan that shows too little to be registered.
            DeviceError: the device is too small.
        """
        edge, sigma2, seed, index = self._pairs[job]
        if self._series is None or self._series.grid.edge != edge:
            self._series = None  # what it holds on the device goes before the next is made
            self._series = Series(self._device, grid_of(edge), self.settings.scene)
        registered = self._series.register(index, seed, sigma2)
        return Outcome(tuple(row.cells() for row, _ in registered), tuple(time.cells() for _, time in registered))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """Our results next to the paper's, and which step fails first."""
        rows, times = (
            _rows(outcomes),
            [GaussianTime.of(cells) for outcome in outcomes.values() for cells in outcome.seconds],
        )
        return section(self.settings.scene, EXTENT, rows, times)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """One picture per grid after Figs. 20 and 21, and one of the success rates."""
        rows = _rows(outcomes)
        for edge in self.settings.edges:
            first = [row for row in rows if (row.grid, row.seed) == (edge, self.settings.first_seed)]
            draw_parameters(folder / parameters_picture(edge), first)
        draw_rates(folder / rates_picture(), rows)


def create(request: Request) -> Gaussian:
    """The experiment as the command line asks for it: Table 1 in full, or with --quick its first tenth.

    Raises:
        InputError: an option's value will not do.
    """
    quick = request.quick
    settings = GaussianSettings(
        scene=request.scene or "floodgate",
        sigma2=request.sigma2 or ((1.0,) if quick else (1.0, 2.0)),
        seeds=request.seeds or (1 if quick else 10),
        first_seed=FIRST_SEED if request.seed is None else request.seed,
        edges=(request.grid,) if request.grid else ((128,) if quick else (128, 256)),
    )
    return Gaussian(settings, request.opened)


def _rows(outcomes: Mapping[str, Outcome]) -> list[GaussianRow]:
    return [GaussianRow.of(cells) for outcome in outcomes.values() for cells in outcome.rows]
