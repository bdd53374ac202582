"""How sure a registration is: 6x6 covariances of T_target_source.

`peak_covariance` is a first size, for the paper's chain: the translation's from the shape of its peak, the rotation's
from the angular bin. `fit_covariance` is calibrated, for what was refined on the surfaces.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.pomf.peak import Peak
from spectral.grid import Grid
from spectral.translation import peak_width
from spectral.verify.hypothesis import Verified

# A peak so many deviations high, for every voxel of the grid's edge, is placed to within the quantization alone; the
# error of lower ones grows with the inverse of their height. On the 54 simulated pairs that this was chosen on, the
# normalized squared error averages 6.2; on 45 others 4.7. Six degrees of freedom should give 6.
_CLEAR_PSR = 0.7
_QUANTIZATION = 1.0 / 12.0  # variance of a number rounded to whole voxels or bins


def peak_covariance(
    peak: Peak, R_target_source: Rotation, center: np.ndarray, grid: Grid, bin_angle: float
) -> np.ndarray:
    """The 6x6 covariance of T_target_source, rotation first, body tangent of the source's sensor frame [rad, m].

    Args:
        peak: of the translation correlation, in the target's orientation [voxels].
        R_target_source: the estimate.
        center: (3,) the source's grid center [m, source sensor frame]. Rotation and translation are independent
            about this point, not about the sensor.
        grid: that both scans share.
        bin_angle: angle of one bin of the rotation's correlations [rad].
    """
    slack = max(1.0, _CLEAR_PSR * grid.edge / max(peak.psr, 1e-3)) ** 2
    rotation = np.eye(3) * bin_angle**2 * _QUANTIZATION * slack
    width = peak_width(peak) * _QUANTIZATION * slack * grid.voxel**2
    R = R_target_source.as_matrix()
    about_center = np.zeros((6, 6))
    about_center[:3, :3] = rotation
    about_center[3:, 3:] = R.T @ width @ R
    return _at_sensor(about_center, center)


@dataclass(frozen=True, slots=True)
class Calibration:
    """How far off refined registrations were, on simulated pairs; docs/registration.md tells on which.

    The information that both scans' planes share says along which directions a pose is fixed, and how well these are
    relative to each other. Its scale is not that of independent points: neighbors share their plane, and what one
    viewpoint sees of a voxel is not what another does. The scale was fitted, by maximum likelihood.

    Attributes:
        scale: logarithm of the variance at 1 of the others.
        residual, psr: its powers of the rms distance to the planes [voxels] and of the peak-to-sidelobe ratio.
        quantization: no direction's variance falls below it [voxels^2]: a two-hundredth of a voxel is what the voxels'
            means leave even where there is no noise.
    """

    scale: float = 13.67
    residual: float = 3.65
    psr: float = -1.43
    quantization: float = 2.5e-5

    def variance(self, one: Verified) -> float:
        """What the inverse of the information is multiplied by [voxels^2]."""
        residual, psr = max(one.fit.residual, 1e-2), max(one.psr, 3.0)
        return float(np.exp(self.scale) * residual**self.residual * psr**self.psr)


CALIBRATION = Calibration()


def fit_covariance(one: Verified, center: np.ndarray, grid: Grid, calibration: Calibration = CALIBRATION) -> np.ndarray:
    """The 6x6 covariance of T_target_source, rotation first, body tangent of the source's sensor frame [rad, m].

    Rotation and translation are estimated jointly: along a wall that shows nothing else the variance is large, and for
    a single plane that of three directions, though never beyond half a turn and the grid.

    Args:
        one: the refined hypothesis.
        center: (3,) the source's grid center [m, source sensor frame].
        grid: that both scans share.
        calibration: of the scale.
    """
    unknown = np.diag(np.repeat([np.pi, float(grid.edge)], 3) ** -2.0)
    fit = one.fit
    total, turns = fit.pairs, float(np.trace(fit.information[:3, :3]))
    if total <= 0 or turns <= 0:
        about_center = np.linalg.inv(unknown)
    else:
        # turns in units of what they move the points by, so that directions can be compared
        lever = np.sqrt(turns / total)
        units = np.repeat([lever, 1.0], 3)
        share, axes = np.linalg.eigh(fit.information / np.outer(units, units) / total)
        variances = calibration.variance(one) / (np.maximum(share, 1e-12) * total) + calibration.quantization
        information = (axes / variances) @ axes.T * np.outer(units, units)
        about_center = np.linalg.inv(information + unknown)
    # from a turn of the target's axes and a shift along them to the source's own
    back = np.kron(np.eye(2), fit.R.as_matrix().T)
    meters = np.repeat([1.0, grid.voxel], 3)
    return _at_sensor(back @ about_center @ back.T * np.outer(meters, meters), center)


def _at_sensor(about_center: np.ndarray, center: np.ndarray) -> np.ndarray:
    """A covariance about the source's grid center (3,) [m], carried to its sensor: the adjoint of that translation."""
    shift = np.eye(6)
    shift[3:, :3] = _cross(center)
    moved = shift @ about_center @ shift.T
    return (moved + moved.T) / 2


def _cross(v: np.ndarray) -> np.ndarray:
    """(3, 3): _cross(v) @ w is the cross product of v and w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
