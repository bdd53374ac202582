"""Where a refinement ended: the pose, and how well the surfaces hold it."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.verify.prior_term import PriorTerm

# A direction held by less than this share of the planes counts as held by so much.
_LOOSEST = 1e-4


@dataclass(frozen=True, slots=True)
class Fit:
    # R, shift: p_target = R p_source + shift about the grid centers [voxels]
    R: Rotation
    shift: np.ndarray
    # (6, 6) how well the planes that both scans show fix the pose: the Hessian of the weighted squared distances
    # [voxels^2], rotation first, of a turn of the target's axes about the source's grid center and a shift along them.
    # Where nothing is fixed its eigenvalues may fall a little below 0.
    information: np.ndarray
    residual: float  # weighted root mean square distance to the planes [voxels]
    pairs: float  # number of pairs of points, weighted, as if 3000 points of each scan took part
    # median distance to the planes of all points within 3 voxels and more [voxels]: how far the surfaces are apart, by
    # noise, by distortion, or because they are not the same
    width: float = 0.0
    # (6,) standard errors of the shares that `principal_axes` gives, by chance and as the noise of both scans is alike
    doubt: np.ndarray = field(default_factory=lambda: np.zeros(6))
    # what instruments measured, about the pose before the last step; None where nothing was
    prior: PriorTerm | None = None
    # (6,) from there to where the scans alone would have it [rad, voxels]
    step: np.ndarray = field(default_factory=lambda: np.zeros(6))
    # (2,) by which shares the ranges of the source and of the target are taken to be too short; None where the scans
    # are taken as they are
    stretch: np.ndarray | None = None
    # (2, 8) the rows of the Hessian by these shares, of the pose and the shares, by the planes alone
    stretching: np.ndarray | None = None

    @property
    def by_scans(self) -> "Fit":
        """Where the scans alone would have the pose."""
        R = Rotation.from_rotvec(self.step[:3]) * self.R
        return replace(self, R=R, shift=self.shift + self.step[3:], prior=None)


def principal_axes(information: np.ndarray, pairs: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The information (..., 6, 6) of (...) pairs by directions: shares (..., 6) of a pair's, ascending, their axes
    (..., 6, 6) in columns, and levers (...) [voxels].

    Turns are taken times the lever, what they move the points by, so that directions can be compared.
    """
    counted = np.maximum(np.asarray(pairs), 1e-12)
    turning = np.trace(information[..., :3, :3], axis1=-2, axis2=-1)
    lever = np.sqrt(np.maximum(turning, 1e-12) / counted)
    share, axes = np.linalg.eigh(_of_a_pair(information, lever, counted))
    return share, axes, lever


def shares_along(other: np.ndarray, information: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(..., 6) shares of other information (..., 6, 6) along the axes of `principal_axes`, in the same unit."""
    _, axes, lever = principal_axes(information, pairs)
    return np.einsum("...ia,...ij,...ja->...a", axes, _of_a_pair(other, lever, pairs), axes)


def _of_a_pair(information: np.ndarray, lever: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    units = np.repeat(np.stack([lever, np.ones_like(lever)], axis=-1), 3, axis=-1)
    return information / (units[..., :, None] * units[..., None, :] * np.asarray(pairs)[..., None, None])


def firmness(information: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(...) 0..1, the geometric mean over all directions of how firmly the planes hold the pose.

    Two flat places fit anywhere: their planes hold three directions of six.
    """
    share, _, _ = principal_axes(information, pairs)
    return np.exp(np.log(np.maximum(share, _LOOSEST)).mean(axis=-1))
