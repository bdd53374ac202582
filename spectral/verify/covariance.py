"""How sure a refined registration is: the 6x6 covariance of T_target_source, calibrated on simulated pairs."""

from dataclasses import dataclass

import numpy as np

from spectral.covariance import covariance_at_sensor
from spectral.grid import Grid
from spectral.verify.hypothesis import Hypothesis


@dataclass(frozen=True, slots=True)
class Calibration:
    """How far off refined registrations were, on simulated pairs; docs/registration.md names them.

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

    def variance(self, hypothesis: Hypothesis) -> float:
        """What the inverse of the information is multiplied by [voxels^2]."""
        residual, psr = max(hypothesis.fit.residual, 1e-2), max(hypothesis.psr, 3.0)
        return float(np.exp(self.scale) * residual**self.residual * psr**self.psr)


CALIBRATION = Calibration()


def fit_covariance(
    hypothesis: Hypothesis, center: np.ndarray, grid: Grid, calibration: Calibration = CALIBRATION
) -> np.ndarray:
    """The 6x6 covariance of T_target_source, rotation first, body tangent of the source's sensor frame [rad, m].

    Rotation and translation are estimated jointly: along a wall that shows nothing else the variance is large, and for
    a single plane that of three directions, though never beyond half a turn and the grid.

    Args:
        hypothesis: refined, its `psr` measured on the whole grid.
        center: (3,) the source's grid center [m, source sensor frame].
        grid: that both scans share.
        calibration: of the scale.
    """
    unknown = np.diag(np.repeat([np.pi, float(grid.edge)], 3) ** -2.0)
    fit = hypothesis.fit
    total, turns = fit.pairs, float(np.trace(fit.information[:3, :3]))
    if total <= 0 or turns <= 0:
        about_center = np.linalg.inv(unknown)
    else:
        # turns in units of what they move the points by, so that directions can be compared
        lever = np.sqrt(turns / total)
        units = np.repeat([lever, 1.0], 3)
        share, axes = np.linalg.eigh(fit.information / np.outer(units, units) / total)
        variances = calibration.variance(hypothesis) / (np.maximum(share, 1e-12) * total) + calibration.quantization
        information = (axes / variances) @ axes.T * np.outer(units, units)
        about_center = np.linalg.inv(information + unknown)
    # from a turn of the target's axes and a shift along them to the source's own
    back = np.kron(np.eye(2), fit.R.as_matrix().T)
    meters = np.repeat([1.0, grid.voxel], 3)
    return covariance_at_sensor(back @ about_center @ back.T * np.outer(meters, meters), center)
