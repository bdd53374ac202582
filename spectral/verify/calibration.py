# pyright: strict
"""How far off refined registrations are: fitted on simulated pairs of every kind, which docs/registration.md names."""

from dataclasses import dataclass

import numpy as np

# Surfaces are never taken to be nearer than this [voxels].
_NARROWEST = 0.02


@dataclass(frozen=True, slots=True)
class Calibration:
    """The scale of the covariance, and what it never falls below.

    The information that both scans' planes share says along which directions a pose is fixed, and how well these are
    relative to each other. Its scale is not that of independent points: neighbors share their plane, and what one
    viewpoint sees of a voxel is not what another does. To this come errors that all points of a scan share, which
    nothing in the pair shows: a speed of sound or a range that is off moves all that a sensor sees to or from it, and
    a vehicle that moves during the scan, or was placed by odometry, bends it.

    Attributes:
        scale: logarithm of the variance at 1 of the others.
        width, psr: its powers of how far the surfaces are apart [voxels] and of the peak-to-sidelobe ratio.
        bent: variance that is added in all directions [voxels^2], turns taken times their lever.
        stretched: share by which the ranges of a scan are off.
        usual_psr: stands for the ratio while it is not measured yet.
    """

    scale: float = 6.4
    width: float = 1.52
    psr: float = -0.31
    bent: float = 9e-3
    stretched: float = 0.0086
    usual_psr: float = 60.0

    def variance(self, width: float, psr: float | None = None) -> float:
        """What the inverse of the information is multiplied by [voxels^2]."""
        ratio = self.usual_psr if psr is None else psr
        return float(np.exp(self.scale) * max(width, _NARROWEST) ** self.width * max(ratio, 3.0) ** self.psr)

    def numbers(self, width: float, psr: float) -> tuple[tuple[str, float], ...]:
        """What the variance depends on, as logarithms by name, each after "c_"."""
        return ("c_width", float(np.log(max(width, _NARROWEST)))), ("c_psr", float(np.log(max(psr, 3.0))))

    def systematic(self, from_target: np.ndarray, from_source: np.ndarray, lever: float) -> np.ndarray:
        """(6, 6) the covariance of errors that all points share, of a turn and a shift [rad, voxels].

        Args:
            from_target, from_source: (3,) from each sensor to the source's grid center, in one frame's axes [voxels].
            lever: what a turn moves the points by [voxels].
        """
        covariance = self.bent * np.diag(np.repeat([max(lever, 1.0) ** -2, 1.0], 3))
        for away in (from_target, from_source):
            covariance[3:, 3:] += self.stretched**2 * np.outer(away, away)
        return covariance


CALIBRATION = Calibration()
