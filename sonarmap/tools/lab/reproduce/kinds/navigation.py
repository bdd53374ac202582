"""A registration compared with navigation alone, along the directions of its own covariance."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.covariance_at_sensor import cross_matrices
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.lab.reproduce.experiment import Row, Value

FIXED = 1 / 3  # of navigation's standard deviation: where the estimate's is less, the terrain fixes the direction
DIRECTIONS = (1, 2, 3)


@dataclass(frozen=True, slots=True)
class Direction:
    """One of three directions of a registration's translation, at right angles to each other."""

    # sigma, navigation_sigma: standard deviations of the estimate and of navigation alone [m]
    sigma: float
    navigation_sigma: float
    # error, navigation_error: how far they are off [m], with their signs
    error: float
    navigation_error: float

    @property
    def is_fixed(self) -> bool:
        """Whether the covariance says that the scans fix this direction far better than navigation."""
        return self.sigma < FIXED * self.navigation_sigma


def navigation_cells(
    registration: Registration, truth: RigidTransform, target: PosePrior, source: PosePrior
) -> dict[str, Value]:
    """The cells that `directions` reads, for directions 1, 2, 3 with growing standard deviations.

    The directions are the eigenvectors of the covariance of the translation, in the target's axes.

    Args:
        registration: the estimate.
        truth: the true T_target_source.
        target, source: what navigation says of the two scans; all of it is measured.

    Returns:
        Nothing where the registration has no covariance.
    """
    covariance = np.asarray(registration.covariance)[3:, 3:]
    if not np.isfinite(covariance).all():
        return {}
    R = registration.T_target_source.rotation.as_matrix()  # the covariance is along the source's axes
    variances, axes = np.linalg.eigh(R @ covariance @ R.T)
    navigated = target.T_world_sensor.inv() * source.T_world_sensor
    known = np.sqrt(np.einsum("ik,ij,jk->k", axes, navigation_covariance(target, source), axes))
    columns = {
        "sigma_m": np.sqrt(np.maximum(variances, 0.0)),
        "navigation_sigma_m": known,
        "error_m": (registration.T_target_source.translation - truth.translation) @ axes,
        "navigation_error_m": (navigated.translation - truth.translation) @ axes,
    }
    return {
        f"direction{number}_{name}": float(values[number - 1])
        for number in DIRECTIONS
        for name, values in columns.items()
    }


def directions(row: Row) -> list[Direction]:
    """Those of a row; none where it has no such cells."""
    names = Direction.__dataclass_fields__
    if f"direction{DIRECTIONS[0]}_sigma_m" not in row:
        return []
    return [Direction(**{name: float(row[f"direction{number}_{name}_m"]) for name in names}) for number in DIRECTIONS]


def navigation_covariance(target: PosePrior, source: PosePrior) -> np.ndarray:
    """(3, 3) of the translation of the measured T_target_source, in the target's axes [m^2].

    Both positions err, and so does the target's rotation, which turns the whole way to the source.
    """
    way = source.T_world_sensor.translation - target.T_world_sensor.translation
    lever = cross_matrices(way[None])[0]
    world = np.diag(target.sigmas[3:] ** 2 + source.sigmas[3:] ** 2)
    world += lever @ np.diag(target.sigmas[:3] ** 2) @ lever.T
    R = target.T_world_sensor.rotation.as_matrix()
    return R.T @ world @ R
