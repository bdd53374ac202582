"""Table 1 of the paper (Sect. 3, Figs. 20, 21): scans ever farther apart, with Gaussian noise along the beams."""

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.device import Device, choose_device
from kernels.errors import InputError
from spectral.grid import Grid, scan_center
from spectral.registration import SpectralRegistrar
from tools.follow import Follow
from tools.reproduce.methods import METHODS
from tools.reproduce.trial import Trial
from tools.simulate.scenes import SCENES
from tools.simulate.series import TABLE1_COUNT, TABLE1_RIG, table1_pair

EXTENT = 256.0  # of the grid [m]; the paper has 256 voxels of about 1 m


@dataclass(frozen=True, slots=True)
class GaussianSettings:
    """What is run.

    Attributes:
        scene: a key of SCENES.
        sigma2: variances of the range noise at the largest range [m^2], each.
        seeds: how many scenes and noises, counted from `first_seed`.
        first_seed: >= 0.
        edge: voxels per edge; the grid is as large as the paper's, whatever their number.
    """

    scene: str = "floodgate"
    sigma2: tuple[float, ...] = (1.0, 2.0)
    seeds: int = 3
    first_seed: int = 1
    edge: int = 128

    def __post_init__(self) -> None:
        if self.scene not in SCENES:
            raise InputError(f"no scene is called {self.scene!r}; there are {', '.join(SCENES)}")
        if not self.sigma2 or not all(np.isfinite(v) and v >= 0 for v in self.sigma2):
            given = ", ".join(f"{v:g}" for v in self.sigma2) or "no value"
            raise InputError(f"--sigma2: {given}; wanted variances of 0 m^2 or more, as in --sigma2 1 --sigma2 2")
        if self.seeds < 1 or self.first_seed < 0:
            raise InputError(
                f"{self.seeds} seeds from {self.first_seed} on; wanted at least one, and none below 0, "
                "as in --seeds 3 --seed 1"
            )
        Grid(self.edge, 1.0)

    @property
    def grid(self) -> Grid:
        """The grid that all pairs share."""
        return Grid(self.edge, EXTENT / self.edge)


@dataclass(frozen=True, slots=True)
class GaussianRow:
    """One registration: S`index` to the reference scan, by one method.

    Attributes:
        sigma2, seed, index: which pair, see `table1_pair`.
        method: a key of METHODS.
        trial: what was found, beside the truth.
    """

    sigma2: float
    seed: int
    index: int
    method: str
    trial: Trial


@dataclass(frozen=True, slots=True)
class GaussianResult:
    """All registrations, ordered by noise, seed, scan and method.

    Attributes:
        settings: from which the same rows come out again, but for their seconds.
        device: the name of what it ran on.
        rows: every single registration.
        seconds: of the whole run [s].
    """

    settings: GaussianSettings
    device: str
    rows: tuple[GaussianRow, ...]
    seconds: float

    def of(self, sigma2: float, method: str) -> tuple[GaussianRow, ...]:
        """The rows of one noise and one method."""
        return tuple(row for row in self.rows if (row.sigma2, row.method) == (sigma2, method))


def run_gaussian(selector: str | None, settings: GaussianSettings, follow: Follow) -> GaussianResult:
    """Register S0..S9 to the reference scan, by every method, under every noise and seed.

    The methods take turns on each pair, so that what else the machine does strikes all alike. Each holds its own
    plan on the device.

    Args:
        selector: of the device, as `choose_device` takes it.
        settings: what to run.
        follow: how to tell of the progress.

    Raises:
        InputError: a scan that shows too little to be registered.
        DeviceError: there is no such device, or it is too small.
    """
    start = perf_counter()
    device = choose_device(selector)
    registrars = {name: SpectralRegistrar(device, settings.grid, method.config) for name, method in METHODS.items()}
    _warm_up(registrars, settings)
    rows: list[GaussianRow] = []
    with follow("registering", len(settings.sigma2) * settings.seeds * TABLE1_COUNT) as step:
        for sigma2 in settings.sigma2:
            for seed in range(settings.first_seed, settings.first_seed + settings.seeds):
                for index, trials in enumerate(_series(registrars, settings, seed, sigma2, device)):
                    rows += [GaussianRow(sigma2, seed, index, name, trial) for name, trial in trials.items()]
                    step(f"sigma^2 {sigma2:g}, seed {seed}, S{index}")
    return GaussianResult(settings, device.name, tuple(rows), perf_counter() - start)


def about_center(T_target_source: RigidTransform) -> RigidTransform:
    """A transform between sensor frames, as one about the grid's center: there Table 1 states its values."""
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    return T_grid_rig * T_target_source * T_grid_rig.inv()


def _warm_up(registrars: dict[str, SpectralRegistrar], settings: GaussianSettings) -> None:
    """Every method once untimed: kernels are compiled at their first launch."""
    target, source, _ = table1_pair(0, settings.first_seed, settings.sigma2[0], settings.scene)
    for registrar in registrars.values():
        registrar.register(registrar.prepare(target), registrar.prepare(source))


def _series(
    registrars: dict[str, SpectralRegistrar], settings: GaussianSettings, seed: int, sigma2: float, device: Device
) -> Iterator[dict[str, Trial]]:
    """S0..S9 by every method; the reference scan is prepared once."""
    prepared = {}
    for index in range(TABLE1_COUNT):
        target, source, truth = table1_pair(index, seed, sigma2, settings.scene)
        prepared = prepared or {name: registrar.prepare(target) for name, registrar in registrars.items()}
        trials = {}
        for name, registrar in registrars.items():
            candidate = registrar.prepare(source)
            device.queue.finish()  # so that the registration's seconds are its own
            registration = registrar.register(prepared[name], candidate)
            trials[name] = Trial(registration, truth, scan_center(source), settings.grid.voxel)
        yield trials
