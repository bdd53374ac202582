"""The result of a refinement: pose, information, the prior term of instruments, and the calibration of errors."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.surface.refinement import TERM
from sonarmap.spectral.chi_squared import beyond_sigmas
from sonarmap.spectral.fitted import FITTED

# Chi-squared values for 1..6 degrees of freedom as rare as 3 and 4 standard deviations; see `PriorTerm.distortion`.
_LIMITS = [(beyond_sigmas(3.0, k), beyond_sigmas(4.0, k)) for k in range(1, 7)]
_UNKNOWN = 1e6


@dataclass(frozen=True, slots=True)
class PriorTerm:
    """Instruments' measurements, m components, linearized about one pose or about n poses (...: none, or n)."""

    residual: np.ndarray  # (..., m) the pose minus the measurement [rad, m]
    # (..., m, 6) of the residual, by a turn about the target's axes at the source's grid center and a shift along them,
    # rotation first [rad, voxels]
    jacobian: np.ndarray
    covariance: np.ndarray  # (..., m, m) of the residual at the true pose
    # (..., 6, 6) covariance of errors that all points of a scan share, from `Calibration.systematic`: added to that of
    # the planes, it weights the scans against the instruments
    systematic: np.ndarray

    def of(self, n: int) -> "PriorTerm":
        return PriorTerm(self.residual[n], self.jacobian[n], self.covariance[n], self.systematic[n])

    def moved(self, step: np.ndarray) -> "PriorTerm":
        """The term about the pose after a small step (..., 6), rotation first [rad, voxels]."""
        return replace(self, residual=self.residual + _times(self.jacobian, step))

    def for_device(self) -> np.ndarray:
        """(n,) TERM, about n poses: uncorrelated components of variance 1, and zeros up to 6."""
        count, terms = self.residual.shape[1], np.zeros(len(self.residual), TERM)
        root = np.linalg.inv(np.linalg.cholesky(self.covariance))
        jacobian = root @ self.jacobian
        terms["off"][:, :count], terms["jacobian"][:, :count] = _times(root, self.residual), jacobian
        terms["shortest"][:, :, :count] = jacobian.mT @ np.linalg.inv(jacobian @ jacobian.mT)
        terms["systematic"], terms["limits"] = self.systematic, _LIMITS[count - 1]
        return terms

    def after(self, off: np.ndarray) -> "PriorTerm":
        """The term about later poses, from their (n, 6) residuals as in `for_device`."""
        root = np.linalg.cholesky(self.covariance)
        return replace(self, residual=_times(root, off[:, : self.residual.shape[1]]))

    def normal_equations(self) -> tuple[np.ndarray, np.ndarray]:
        """(..., 6, 6) information by the instruments, and (..., 6) gradient of half of chi-squared."""
        weighted = np.linalg.solve(self.covariance, self.jacobian).mT
        return weighted @ self.jacobian, _times(weighted, self.residual)

    def squared(self) -> np.ndarray:
        """(...) chi-squared of the residual."""
        return (self.residual * _solved(self.covariance, self.residual)).sum(axis=-1)

    def distortion(self, covariance: np.ndarray, step: np.ndarray) -> np.ndarray:
        """(..., 6, 6) covariance of the scans' distortion, as far as the instruments reveal it.

        A sonar that guesses elevations shows leaning walls; a wrong speed of sound bends the bed. If the pose by the
        scans alone, given by their covariance and step, deviates from the measurement by more than 3 standard
        deviations, the scans get less weight in that direction, and none beyond 4.
        """
        off = self.residual + _times(self.jacobian, step)
        together = self.jacobian @ covariance @ self.jacobian.mT + self.covariance
        full_weight, no_weight = _LIMITS[off.shape[-1] - 1]
        squared = (off * _solved(together, off)).sum(axis=-1)
        factor = np.maximum(squared - full_weight, 0.0) / np.maximum(no_weight - squared, no_weight / _UNKNOWN)
        # the shortest step that explains `off`: the rows of the Jacobian are independent
        along = _times(self.jacobian.mT, _solved(self.jacobian @ self.jacobian.mT, off))
        share = factor / np.maximum(squared, full_weight)
        return share[..., None, None] * along[..., :, None] * along[..., None, :]


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (matrix @ vector[..., None])[..., 0]


def _solved(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.linalg.solve(matrix, vector[..., None])[..., 0]


@dataclass(frozen=True, slots=True)
class Calibration:
    """The scale of the planes' covariance, and the systematic errors added to it.

    The information of the planes that both scans share gives the constrained directions and their relative accuracy,
    but not the scale: neighboring points share their plane, and two viewpoints see different parts of a voxel. Errors
    that all points of a scan share do not show in the pair and are added: a wrong speed of sound or range offset moves
    all points to or from the sensor, and a vehicle's motion during the scan bends it.
    """

    scale: float  # logarithm of the variance at width 1 and psr 1
    # width, psr: exponents of the distance between surfaces [voxels] and of the peak-to-sidelobe ratio in the variance
    width: float
    psr: float
    bent: float  # variance added in all directions [voxels^2], turns multiplied by their lever
    stretched: float  # standard deviation of the relative error of a scan's ranges
    usual_psr: float  # used until the ratio is measured
    # share of the variance without rare large errors, which it includes. The refinement weights the scans by it along
    # directions that both scans constrain: the full variance would draw good scans to less accurate instruments.
    usual: float
    # factor of the variance for kinds of scans outside of the fit, from cross-validation over kinds; applied to the
    # scans' reported covariance alone
    other_kinds: float
    narrowest: float  # minimum distance between surfaces [voxels]

    def variance(self, width: np.ndarray, psr: float | None = None) -> np.ndarray:
        """Factor of the inverse information [voxels^2], of the shape of the widths."""
        ratio = self.usual_psr if psr is None else psr
        return np.exp(self.scale) * np.maximum(width, self.narrowest) ** self.width * max(ratio, 3.0) ** self.psr

    def systematic(
        self, from_target: np.ndarray, from_source: np.ndarray, lever: np.ndarray, stretches: bool
    ) -> np.ndarray:
        """(..., 6, 6) covariance of a turn and a shift [rad, voxels] by errors that all points share.

        `from_target` and `from_source` are the vectors (..., 3) from each sensor to the source's grid center, `lever`
        (...) is that of a turn [voxels]. If `stretches`, the ranges' error is estimated with the pose and left out.
        """
        per_voxel = np.maximum(lever, 1.0)[..., None] ** -2 * np.ones(3)
        diagonal = self.bent * np.concatenate([per_voxel, np.ones_like(per_voxel)], axis=-1)
        covariance = diagonal[..., None] * np.eye(6)
        for away in () if stretches else (from_target, from_source):
            covariance[..., 3:, 3:] += self.stretched**2 * away[..., :, None] * away[..., None, :]
        return covariance


CALIBRATION = Calibration(**FITTED["calibration"])


_LOOSEST = 1e-4  # minimum share of the planes that constrain a direction


@dataclass(frozen=True, slots=True)
class Fit:
    # R, shift: p_target = R p_source + shift about the grid centers [voxels]
    R: Rotation
    shift: np.ndarray
    # (6, 6) information of the planes that both scans show: the Hessian of the weighted squared distances [voxels^2] by
    # a turn about the target's axes at the source's grid center and a shift along them, rotation first. In
    # unconstrained directions its eigenvalues may be slightly negative.
    information: np.ndarray
    residual: float  # weighted root mean square distance to the planes [voxels]
    pairs: float  # number of pairs of points, weighted, as if 3000 points of each scan took part
    # median distance to the planes of all points within at least 3 voxels [voxels]: the distance between the surfaces
    # by noise, distortion, or because they differ
    width: float = 0.0
    # (6,) standard errors of `shares`, by chance and by noise that both scans share
    doubt: np.ndarray = field(default_factory=lambda: np.zeros(6))
    # instruments' measurements, about the pose before the last step; None without any
    prior: PriorTerm | None = None
    # (6,) from that pose to the one by the scans alone [rad, voxels]
    step: np.ndarray = field(default_factory=lambda: np.zeros(6))
    # (2,) estimated shares by which the ranges of the source and of the target are too short; None if they are not
    # estimated
    stretch: np.ndarray | None = None
    # (2, 8) rows of these shares in the Hessian by pose and shares, by the planes alone
    stretching: np.ndarray | None = None
    # (6,) information per pair of points along the axes of `principal_axes`, ascending
    shares: np.ndarray = field(default_factory=lambda: np.zeros(6))

    @property
    def by_scans(self) -> "Fit":
        """The fit at the pose by the scans alone."""
        R = Rotation.from_rotvec(self.step[:3]) * self.R
        return replace(self, R=R, shift=self.shift + self.step[3:], prior=None)


def principal_axes(information: np.ndarray, pairs: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues (..., 6) of the information (..., 6, 6) per pair of points, ascending, their axes (..., 6, 6) in
    columns, and the levers (...) [voxels] that turns are multiplied by to make all directions comparable.
    """
    counted = np.maximum(np.asarray(pairs), 1e-12)
    turning = np.trace(information[..., :3, :3], axis1=-2, axis2=-1)
    lever = np.sqrt(np.maximum(turning, 1e-12) / counted)
    units = np.repeat(np.stack([lever, np.ones_like(lever)], axis=-1), 3, axis=-1)
    of_a_pair = information / (units[..., :, None] * units[..., None, :] * counted[..., None, None])
    share, axes = np.linalg.eigh(of_a_pair)
    return share, axes, lever


def firmness(shares: np.ndarray) -> np.ndarray:
    """(...) 0..1, geometric mean over all directions of the planes' information per pair, `Fit.shares` (..., 6): low
    for two flat places, which fit anywhere, as planes constrain three directions of six."""
    return np.exp(np.log(np.maximum(shares, _LOOSEST)).mean(axis=-1))
