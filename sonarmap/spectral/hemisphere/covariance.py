"""A first size of a registration's error, for the paper's chain: from the translation's peak and the angular bin."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.pomf.peak import Peak
from sonarmap.spectral.covariance import covariance_at_sensor
from sonarmap.spectral.grid import Grid

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
    return covariance_at_sensor(about_center, center)


def peak_width(peak: Peak) -> np.ndarray:
    """(3, 3) [voxels^2]: the covariance of the Gaussian that fits the peak's neighborhood.

    From the curvature of its logarithm; a direction in which the neighborhood does not fall off is as wide as the
    neighborhood can tell, 3 voxels.
    """
    height = np.log(np.maximum(peak.neighborhood.astype(np.float64) / peak.value, 0.05))
    curvature = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            if a == b:
                curvature[a, a] = 2 * height[1, 1, 1] - height[_at(a, 1)] - height[_at(a, -1)]
            else:
                curvature[a, b] = -0.25 * sum(p * q * height[_at(a, p, b, q)] for p in (-1, 1) for q in (-1, 1))
    values, vectors = np.linalg.eigh(curvature)
    widths = 1.0 / np.maximum(values, 1.0 / 9.0)
    return (vectors * widths) @ vectors.T


def _at(*steps: int) -> tuple[int, int, int]:
    """Index of the neighborhood after steps given as axis, step, axis, step, ..."""
    index = [1, 1, 1]
    for axis, step in zip(steps[::2], steps[1::2], strict=True):
        index[axis] += step
    return index[0], index[1], index[2]
