"""A first covariance: the translation's from the shape of its peak, the rotation's from the angular bin.

It is a plausible size, not a calibrated one.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.peak import Peak
from spectral.grid import Grid
from spectral.translation import peak_width

# A peak so many deviations high, for every voxel of the grid's edge, is placed to within the quantization alone; the
# error of lower ones grows with the inverse of their height. On the 54 simulated pairs that this was chosen on, the
# normalized squared error averages 6.2; on 45 others 4.7. Six degrees of freedom should give 6.
_CLEAR_PSR = 0.7
_QUANTIZATION = 1.0 / 12.0  # variance of a number rounded to whole voxels or bins


def covariance(peak: Peak, R_target_source: Rotation, center: np.ndarray, grid: Grid, bin_angle: float) -> np.ndarray:
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
    shift = np.eye(6)  # adjoint of the translation from the source's sensor to its grid center
    shift[3:, :3] = _cross(center)
    moved = shift @ about_center @ shift.T
    return (moved + moved.T) / 2


def _cross(v: np.ndarray) -> np.ndarray:
    """(3, 3): _cross(v) @ w is the cross product of v and w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
