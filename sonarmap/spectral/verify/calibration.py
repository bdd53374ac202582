"""How far off refined registrations are: fitted on simulated pairs of every kind, which docs/simulation.md names."""

from dataclasses import dataclass

import numpy as np

from sonarmap.spectral.fitted import FITTED


@dataclass(frozen=True, slots=True)
class Calibration:
    """The scale of the covariance, and what it never falls below.

    The information that both scans' planes share says along which directions a pose is fixed, and how well these are
    relative to each other. Its scale is not that of independent points: neighbors share their plane, and what one
    viewpoint sees of a voxel is not what another does. To this come errors that all points of a scan share, which
    nothing in the pair shows: a speed of sound or a range that is off moves all that a sensor sees to or from it, and
    a vehicle that moves during the scan, or was placed by odometry, bends it.
    """

    scale: float  # logarithm of the variance at 1 of the others
    # width, psr: its powers of how far the surfaces are apart [voxels] and of the peak-to-sidelobe ratio
    width: float
    psr: float
    bent: float  # variance that is added in all directions [voxels^2], turns taken times their lever
    stretched: float  # share by which the ranges of a scan are off
    usual_psr: float  # stands for the ratio while it is not measured yet
    # share of the variance that errors usually have, as it covers rare large ones too. In the refinement the scans
    # weigh as much as is usual, along directions that both fix: more doubt would draw good scans to instruments that
    # know less.
    usual: float
    # by which the variance is raised for kinds of scans that are not among those of the fit: what a kind was off by
    # that had been left out, beside what the others had said. Of the scans' part alone, and only where it is stated.
    other_kinds: float
    narrowest: float  # surfaces are never taken to be nearer than this [voxels]

    def variance(self, width: np.ndarray, psr: float | None = None) -> np.ndarray:
        """What the inverse of the information is multiplied by [voxels^2], of any shape, as the widths."""
        ratio = self.usual_psr if psr is None else psr
        return np.exp(self.scale) * np.maximum(width, self.narrowest) ** self.width * max(ratio, 3.0) ** self.psr

    def systematic(
        self, from_target: np.ndarray, from_source: np.ndarray, lever: np.ndarray, stretches: bool
    ) -> np.ndarray:
        """(..., 6, 6) the covariance of errors that all points share, of a turn and a shift [rad, voxels].

        Of what lies (..., 3) from each sensor to the source's grid center, in one frame's axes, and a turn moves by the
        lever (...) [voxels]. If `stretches`, the ranges' share is estimated with the pose, and no error remains of it.
        """
        per_voxel = np.maximum(lever, 1.0)[..., None] ** -2 * np.ones(3)
        diagonal = self.bent * np.concatenate([per_voxel, np.ones_like(per_voxel)], axis=-1)
        covariance = diagonal[..., None] * np.eye(6)
        for away in () if stretches else (from_target, from_source):
            covariance[..., 3:, 3:] += self.stretched**2 * away[..., :, None] * away[..., None, :]
        return covariance


CALIBRATION = Calibration(**FITTED["calibration"])
