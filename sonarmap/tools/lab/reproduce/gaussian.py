"""Table 1 of the paper (Sect. 3, Figs. 20, 21): scans ever farther apart, with Gaussian noise along the beams."""

from itertools import product
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import HemisphereRegistrar, LayeredScan
from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, pair_error
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Row, Value, all_seeds, as_asked
from sonarmap.tools.lab.reproduce.registrations import less_turns, paper_grid, parameter_cells
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT, TABLE1_RIG
from sonarmap.tools.lab.simulate.plan import table1_pair

# Blurs and bounds were chosen on scenes and noises of smaller seeds; grids of `edges` voxels are as large as
# the paper's
_USUAL = {"scene": "floodgate", "sigma2": (1.0, 2.0), "seeds": 10, "first_seed": 11, "edges": (128, 256)}
SOURCES = (
    *("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("registrations", "gaussian")),
)


def create(request: Request) -> Experiment:
    """S0 to S9 on every grid, under every noise and seed; a job is one scan, as in 128/1.0/11/S3."""
    settings = as_asked(request, _USUAL, {"sigma2": (1.0,), "seeds": 1, "edges": (128,)})
    series: dict[int, Series] = {}

    def run(job: str) -> Outcome:
        edge, sigma2, seed, step = job.split("/")
        if int(edge) not in series:
            series.clear()  # what it holds on the device goes before the next is made
            series[int(edge)] = Series(request.opened, paper_grid(int(edge)), settings.scene)
        row, seconds = series[int(edge)].register(int(step.removeprefix("S")), int(seed), float(sigma2))
        return Outcome((row,), (seconds,))

    which = product(settings.edges, settings.sigma2, all_seeds(settings), range(TABLE1_COUNT))
    jobs = [f"{edge}/{sigma2!r}/{seed}/S{index}" for edge, sigma2, seed, index in which]
    return Experiment("gaussian", settings, jobs, run, SOURCES)


class Series:
    """Registers pairs of Table 1."""

    def __init__(self, device: Device, grid: Grid, scene: str) -> None:
        """Plan the method; a DeviceError says that the device cannot hold what the grid needs."""
        self.device, self.grid, self.scene = device, grid, scene
        self._registrar = HemisphereRegistrar(device, grid)
        self._reference: tuple[tuple[int, float], LayeredScan] | None = None

    def register(self, index: int, seed: int, sigma2: float) -> tuple[Row, Row]:
        """S`index`: its row, and its times [s], those of preparing it and of registering it.

        The reference scan is prepared once for all scans of a series. A row says which pair it is (see `table1_pair`).

        Raises:
            InputError: a scan that shows too little to be registered.
        """
        target, source, truth = table1_pair(index, seed, sigma2, self.scene)
        if self._reference is None or self._reference[0] != (seed, sigma2):
            self._reference = (seed, sigma2), self._registrar.prepare(target)
        start = perf_counter()
        candidate = self._registrar.prepare(source)
        self.device.queue.finish()  # so that the registration's seconds are its own
        seconds = perf_counter() - start
        registration = self._registrar.register(self._reference[1], candidate)
        which = {"grid": self.grid.edge, "sigma2": sigma2, "seed": seed, "scan": index}
        pair: dict[str, Value] = {"scene": self.scene, "voxel_m": self.grid.voxel, **which}
        row = row_of(registration, truth, candidate.volume.center, pair)
        return row, which | {"prepare_s": seconds, "register_s": registration.seconds}


_COLUMNS = ("scene", "grid", "voxel_m", "sigma2", "seed", "scan")


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
        pair: the cells that say which pair it is.
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
