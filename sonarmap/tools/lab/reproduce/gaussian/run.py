"""Table 1 of the paper (Sect. 3, Figs. 20, 21): scans ever farther apart, with Gaussian noise along the beams."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

from sonarmap.kernels.device.device import Device
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.gaussian.figure import draw_gaussian
from sonarmap.tools.lab.reproduce.gaussian.section import gaussian_section
from sonarmap.tools.lab.reproduce.gaussian.series import Series
from sonarmap.tools.lab.reproduce.settings import as_asked, check_scenes, check_seeds, check_variances, paper_grid
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT

FIRST_SEED = 11  # windows, blurs and bounds were chosen on scenes and noises of smaller seeds


@dataclass(frozen=True, slots=True)
class GaussianSettings:
    """What is run."""

    scene: str = "floodgate"  # a key of SCENE_KINDS
    sigma2: tuple[float, ...] = (1.0, 2.0)  # variances of the range noise at the largest range [m^2], each
    seeds: int = 10  # how many scenes and noises, counted from `first_seed`
    first_seed: int = FIRST_SEED  # >= 0
    # voxels per edge, each; the grid is as large as the paper's, whatever their number
    edges: tuple[int, ...] = (128, 256)

    def __post_init__(self) -> None:
        check_scenes((self.scene,))
        check_variances(self.sigma2)
        check_seeds(self.seeds, self.first_seed)
        for edge in self.edges:
            paper_grid(edge)


class Gaussian(Experiment):
    """Registers S0..S9 to the reference scan, by every method, on every grid, under every noise and seed.

    A job is one scan, so that it takes seconds. Only one grid's plans, and one reference scan's preparation, are on the
    device at a time.
    """

    name = "gaussian"
    sources: ClassVar[tuple[str, ...]] = (
        "tools/lab/reproduce/settings.py",
        *("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate"),
        *(f"tools/lab/reproduce/{name}.py" for name in ("answer", "gaussian/series")),
    )
    make_section, draw_pictures = staticmethod(gaussian_section), staticmethod(draw_gaussian)

    def __init__(self, settings: GaussianSettings, device: Device) -> None:
        super().__init__(settings, device)
        self._series: Series | None = None

    def jobs(self) -> Sequence[str]:
        """Grid, noise, seed and scan, as in 128/1.0/11/S3."""
        settings: GaussianSettings = self.settings
        seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
        which = product(settings.edges, settings.sigma2, seeds, range(TABLE1_COUNT))
        return [f"{edge}/{sigma2!r}/{seed}/S{index}" for edge, sigma2, seed, index in which]

    def run(self, job: str) -> Outcome:
        """Register one scan by every method."""
        edge, sigma2, seed, step = job.split("/")
        if self._series is None or self._series.grid.edge != int(edge):
            self._series = None  # what it holds on the device goes before the next is made
            self._series = Series(self.device, paper_grid(int(edge)), self.settings.scene)
        registered = self._series.register(int(step.removeprefix("S")), int(seed), float(sigma2))
        return Outcome(tuple(row for row, _ in registered), tuple(seconds for _, seconds in registered))


def create(request: Request) -> Gaussian:
    """The experiment as the command line asks for it: Table 1 in full, or with --quick its first tenth."""
    settings = as_asked(GaussianSettings(), request, sigma2=(1.0,), seeds=1, edges=(128,))
    return Gaussian(settings, request.opened)
