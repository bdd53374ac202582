"""Table 1 of the paper (Sect. 3, Figs. 20, 21): scans ever farther apart, with Gaussian noise along the beams."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from time import perf_counter
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar, LayeredScan
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, pair_error
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, Value, all_seeds, paper_grid
from sonarmap.tools.lab.reproduce.experiments import Request, as_asked
from sonarmap.tools.lab.reproduce.registrations import less_turns, parameter_cells
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT, TABLE1_RIG
from sonarmap.tools.lab.simulate.plan import table1_pair

# Windows, blurs and bounds were chosen on scenes and noises of smaller seeds; grids of `edges` voxels are as large as
# the paper's
_USUAL = {"scene": "floodgate", "sigma2": (1.0, 2.0), "seeds": 10, "first_seed": 11, "edges": (128, 256)}
SOURCES = (
    *("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("experiment", "registrations", "gaussian")),
)
RANKED = 12  # so many yaw peaks are looked at
# Name in tables and files -> configuration of the paper's chain: the steps of Sect. 2.11 once, along the highest yaw
# peak; with the rotation refined; and along six peaks, the defaults of the method `hemisphere`
VARIANTS: Mapping[str, HemisphereConfig] = MappingProxyType(
    {
        "paper": HemisphereConfig.paper(),
        "one peak": HemisphereConfig(yaw_peaks=1),
        "six peaks": HemisphereConfig(yaw_peaks=6),
    }
)
# What a config says of pairs alone; two that differ in nothing else prepare a scan alike.
_OF_PAIRS = ("yaw_peaks", "max_tilt", "refinements", "final_refinements", "search", "acceptance")


def create(request: Request) -> Experiment:
    """S0 to S9 on every grid, under every noise and seed; a job is one scan by every variant, as in 128/1.0/11/S3."""
    settings = as_asked(request, _USUAL, {"sigma2": (1.0,), "seeds": 1, "edges": (128,)})
    series: dict[int, Series] = {}

    def run(job: str) -> Outcome:
        edge, sigma2, seed, step = job.split("/")
        if int(edge) not in series:
            series.clear()  # what it holds on the device goes before the next is made
            series[int(edge)] = Series(request.opened, paper_grid(int(edge)), settings.scene)
        registered = series[int(edge)].register(int(step.removeprefix("S")), int(seed), float(sigma2))
        return Outcome(tuple(row for row, _ in registered), tuple(seconds for _, seconds in registered))

    which = product(settings.edges, settings.sigma2, all_seeds(settings), range(TABLE1_COUNT))
    jobs = [f"{edge}/{sigma2!r}/{seed}/S{index}" for edge, sigma2, seed, index in which]
    return Experiment("gaussian", settings, jobs, run, SOURCES)


class Series:
    """Registers pairs of Table 1 by every variant; each holds its own plan on the device.

    The variants take turns on each pair, so that what else the machine does strikes all alike. A scan is prepared once
    for all methods that prepare alike.
    """

    def __init__(self, device: Device, grid: Grid, scene: str) -> None:
        """Plan every method; a DeviceError says that the device cannot hold what the grid needs."""
        self.device, self.grid, self.scene = device, grid, scene
        self._registrars = {name: HemisphereRegistrar(device, grid, config) for name, config in VARIANTS.items()}
        self._reference: tuple[tuple[int, float], dict[str, LayeredScan]] | None = None

    def register(self, index: int, seed: int, sigma2: float) -> list[tuple[Row, Row]]:
        """S`index` by every method: its row, and its times [s], those of preparing it and of registering it.

        The reference scan is prepared once for all scans of a series. A row says which pair it is (see `table1_pair`)
        and, in "yaw_rank", the place of the right yaw among the RANKED highest yaw peaks of the first step, 1 for the
        highest and 0 where it is not among them: it depends on how the scans were prepared, not on what followed.

        Raises:
            InputError: a scan that shows too little to be registered.
        """
        target, source, truth = table1_pair(index, seed, sigma2, self.scene)
        if self._reference is None or self._reference[0] != (seed, sigma2):
            self._reference = (seed, sigma2), {name: prepared for name, (prepared, _) in self._prepare(target).items()}
        rows = []
        for name, (candidate, seconds) in self._prepare(source).items():
            reference = self._reference[1][name]
            registration = self._registrars[name].register(reference, candidate)
            which = {"grid": self.grid.edge, "sigma2": sigma2, "seed": seed, "scan": index, "method": name}
            rank = yaw_rank(self._registrars[name], reference, candidate, truth)
            pair: dict[str, Value] = {"scene": self.scene, "voxel_m": self.grid.voxel, **which, "yaw_rank": rank}
            row = row_of(registration, truth, candidate.volume.center, pair)
            rows.append((row, which | {"prepare_s": seconds, "register_s": registration.seconds}))
        # pyrefly: ignore[bad-return]
        return rows

    def _prepare(self, scan: Scan) -> dict[str, tuple[LayeredScan, float]]:
        """The scan as every method needs it, by the method's name, and the seconds that took."""
        shared: dict[HemisphereConfig, tuple[LayeredScan, float]] = {}
        for registrar in self._registrars.values():
            if preparation_of(registrar.config) not in shared:
                start = perf_counter()
                prepared = registrar.prepare(scan)
                self.device.queue.finish()  # so that the registration's seconds are its own
                shared[preparation_of(registrar.config)] = prepared, perf_counter() - start
        return {name: shared[preparation_of(registrar.config)] for name, registrar in self._registrars.items()}


def yaw_rank(registrar: HemisphereRegistrar, target: LayeredScan, source: LayeredScan, truth: RigidTransform) -> int:
    """The place of the right yaw among the RANKED highest peaks, each with its + 180 degrees; 0 where it is none."""
    peaks = registrar.hemisphere.yaw_candidates(target.layers, source.layers, RANKED)
    true = truth.rotation.as_euler("ZYX", degrees=True)[0]
    for k, peak in enumerate(peaks):
        off = peak.R.as_euler("ZYX", degrees=True)[0] - true
        if abs(less_turns(off)) <= RIGHT_DEG:
            return k // 2 + 1
    return 0


def preparation_of(config: HemisphereConfig) -> HemisphereConfig:
    """What of a config decides how a scan is prepared: the rest as it is by default."""
    by_default = HemisphereConfig()
    return replace(config, **{name: getattr(by_default, name) for name in _OF_PAIRS})


_COLUMNS = ("scene", "grid", "voxel_m", "sigma2", "seed", "scan", "method")


def row_of(registration: Registration, truth: RigidTransform, center: np.ndarray, pair: dict[str, Value]) -> Row:
    """The row of one registration.

    Its errors are those of T_target_source, so the translation's is at the sensor: it decides what is right. "center_m"
    is how far from its true place the scan's center comes to lie: it is far from its sensor, and what the rotation
    lacks moves one of them more than the other. "wrong_step" is the first of the paper's steps whose result is wrong:
    yaw, tilt or translation; "" where it is right. The cells "found_..." and "true_..." are Table 1's parameters, about
    the grid's center.

    Args:
        registration: of the pair.
        truth: the true T_target_source, between the sensor frames.
        center: (3,) [m, sensor frame of the source], where the scan's grid was centered.
        pair: the cells that say which pair and method it is, and the rank of the right yaw.
    """
    T, voxel = registration.T_target_source, float(pair["voxel_m"])
    error, steps = pair_error(T, truth), dict(registration.step_psr)
    center_m = float(np.linalg.norm(T.apply(center) - truth.apply(center)))
    is_right, turned_right = error.is_right(voxel), error.rotation_deg <= RIGHT_DEG
    estimated, true = (one.rotation.as_euler("ZYX", degrees=True)[0] for one in (T, truth))
    turned = "yaw" if abs(less_turns(estimated - true)) > RIGHT_DEG else "tilt"
    return {
        **{name: pair[name] for name in _COLUMNS},
        "right": is_right,
        "wrong_step": "" if is_right else "translation" if turned_right else turned,
        "rotation_deg": error.rotation_deg,
        "translation_m": error.translation_m,
        "translation_voxels": error.translation_m / voxel,
        "center_m": center_m,
        "right_at_center": turned_right and center_m <= RIGHT_VOXELS * voxel,
        "yaw_rank": pair["yaw_rank"],
        "accepted": bool(registration.accepted),
        "psr": float(registration.psr),
        **{f"{step}_psr": float(steps[step]) for step in ("rival", "yaw", "tilt")},
        "overlap": float(registration.overlap),
        **parameter_cells(about_center(T), "found"),
        **parameter_cells(about_center(truth), "true"),
    }


def about_center(T_target_source: RigidTransform) -> RigidTransform:
    """A transform between sensor frames, as one about the grid's center: there Table 1 states its values."""
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    return T_grid_rig * T_target_source * T_grid_rig.inv()
