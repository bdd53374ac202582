"""The compared methods, and cells of a row with a registration's values and errors."""

from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.result import Registrar, Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.experiments import Request, Row, Value
from sonarmap.tools.methods.registry import Setup, find_method, is_installed

OURS = "spectral"
EVALUATED = (OURS, "hemisphere", "kiss", "fpfh-ransac", "icp", "icp-plane", "gicp")
EXTENT = 256.0  # edge of the paper's grid [m]
PARAMETERS = ("x_m", "y_m", "z_m", "yaw_deg", "roll_deg", "pitch_deg")


def compared_methods(request: Request) -> dict[str, tuple[str, ...]]:
    """The settings "methods", which are the requested ones or all that are installed, and "left_out".

    Raises InputError: a requested method is unknown or not installed.
    """
    if request.method:
        for name in request.method:
            if not is_installed(name):
                registrar(name, Grid(16, 1.0), None)  # raises an error that says what to install
        return {"methods": request.method, "left_out": ()}
    left_out = tuple(name for name in EVALUATED if not is_installed(name))
    return {"methods": tuple(name for name in EVALUATED if name not in left_out), "left_out": left_out}


def registrar(name: str, grid: Grid, device: str | None, max_tilt: float | None = None) -> Registrar:
    """A method of METHODS with its default settings; `max_tilt` [rad] applies if the method bounds roll and pitch.

    Raises InputError, DeviceError: the method is unknown, its package is not installed, or the device is too small.
    """
    method = find_method(name)
    changes = {} if max_tilt is None or "max_tilt" not in method.options else {"max_tilt": max_tilt}
    return method.make(Setup(grid, device, changes=changes))


def finish_device(registrar: Registrar) -> None:
    """Wait for the device of a method, if it uses one."""
    device = getattr(registrar, "device", None)
    if device is not None:
        device.queue.finish()


def answer(registrar: Registrar, target: Scan, source: Scan) -> tuple[Registration, float]:
    """Prepare and register two scans, and the time of that [s]; an InputError of the method becomes a refused
    registration."""
    finish_device(registrar)
    start = perf_counter()
    try:
        registration = registrar.register(registrar.prepare(target), registrar.prepare(source))
    except InputError as error:
        registration = refused(str(error))
    return registration, perf_counter() - start


def refused(reason: str) -> Registration:
    """A refused registration: the identity, without a covariance."""
    nothing = np.full((6, 6), np.nan)
    return Registration(RigidTransform.identity(), nothing, float("nan"), 0.0, False, 0.0, reason)


def parameter_cells(T: RigidTransform, which: str) -> dict[str, float]:
    """Cells of PARAMETERS, in the paper's order; `which` is the prefix of their names, "found" or "true"."""
    yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True).tolist()
    values = (*T.translation.tolist(), yaw, roll, pitch)
    return {f"{which}_{name}": value for name, value in zip(PARAMETERS, values, strict=True)}


def transform(row: Row, which: str) -> RigidTransform:
    """The "found" or "true" transform in the cells of `parameter_cells`."""
    x, y, z, yaw, roll, pitch = (float(row[f"{which}_{name}"]) for name in PARAMETERS)
    return RigidTransform.from_components([x, y, z], Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True))


def scores(registration: Registration, truth: RigidTransform | None, voxel: float) -> dict[str, Value]:
    """Cells of the errors of a registration, if the truth is known, and of the values that it reports."""
    return ({} if truth is None else errors(registration, truth, voxel)) | claims(registration)


def claims(registration: Registration) -> dict[str, Value]:
    """Cells of the values that a registration reports; sigma_deg and sigma_m are along the worst direction."""
    sigma_deg, sigma_m = float("nan"), float("nan")
    if np.isfinite(covariance := registration.covariance).all():
        worst = (np.linalg.eigvalsh(block)[-1] for block in (covariance[:3, :3], covariance[3:, 3:]))
        turn, sigma_m = (float(np.sqrt(max(variance, 0.0))) for variance in worst)
        sigma_deg = float(np.rad2deg(turn))
    return {
        "accepted": bool(registration.accepted),
        "probability": float(getattr(registration, "probability", float("nan"))),
        "psr": float(registration.psr),
        "overlap": float(registration.overlap),
        "sigma_deg": sigma_deg,
        "sigma_m": sigma_m,
        "reason": registration.reason,
    }


def errors(registration: Registration, truth: RigidTransform, voxel: float) -> dict[str, Value]:
    """Cells of the errors of a registration against the true T_target_source; `voxel` is the grid's [m]."""
    error = pair_error(registration.T_target_source, truth)
    return {
        "right": error.is_right(voxel),
        "rotation_deg": error.rotation_deg,
        "translation_m": error.translation_m,
        "translation_voxels": error.translation_m / voxel,
        "nees": nees(registration.T_target_source, registration.covariance, truth),
    }


def nees(T_estimate: RigidTransform, covariance: np.ndarray, truth: RigidTransform) -> float:
    """The normalized estimation error squared: xi' covariance^-1 xi with truth = T_estimate Exp(xi).

    With a right covariance it is chi-squared with 6 degrees of freedom (Bar-Shalom, Li and Kirubarajan 2001, Sect. 5.4,
    doi 10.1002/0471221279). NaN if the covariance, rotation first [rad, m], is not positive definite.
    """
    xi = (T_estimate.inv() * truth).as_exp_coords()
    try:
        whitened = np.linalg.solve(np.linalg.cholesky(covariance), xi)
    except np.linalg.LinAlgError:
        return float("nan")
    return float(whitened @ whitened)


def less_turns(angle: float) -> float:
    """An angle reduced to -180..180 [degrees]."""
    return (angle + 180) % 360 - 180


def paper_grid(edge: int) -> Grid:
    """A grid of `edge` voxels per edge with the extent of the paper's, which has 256 voxels of about 1 m."""
    Grid(edge, 1.0)  # its error names the edge, not the voxel
    return Grid(edge, EXTENT / edge)
