"""Where a refinement ended: the pose, how well the surfaces hold it, and what is known of such fits' errors."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.spectral.chi_squared import beyond_sigmas
from sonarmap.spectral.fitted import FITTED

# Chi-squared of 1..6 numbers that is as rare as 3 and 4 standard deviations of one. See `PriorTerm.distortion`.
_LIMITS = [(beyond_sigmas(3.0, k), beyond_sigmas(4.0, k)) for k in range(1, 7)]
_UNKNOWN = 1e6
# Information that keeps a pose in its place where neither scans nor instruments know anything.
_STAY = 1e-6


@dataclass(frozen=True, slots=True)
class PriorTerm:
    """Measurements of instruments, linear about a pose of m components, or about n poses (...: none, or n)."""

    residual: np.ndarray  # (..., m) the pose less what was measured [rad, m]
    # (..., m, 6) of the residual, by a turn of the target's axes about the source's grid center and a shift along them,
    # rotation first [rad, voxels]
    jacobian: np.ndarray
    covariance: np.ndarray  # (..., m, m) of the residual at the true pose
    # (..., 6, 6) the covariance of errors that all points of the scans share, as `Calibration` has it: it decides, with
    # that of the planes, how much the scans are worth beside the instruments
    systematic: np.ndarray

    def of(self, n: int) -> "PriorTerm":
        return PriorTerm(self.residual[n], self.jacobian[n], self.covariance[n], self.systematic[n])

    def moved(self, step: np.ndarray) -> "PriorTerm":
        """About the pose that lies a (..., 6) small step further, rotation first [rad, voxels]."""
        return replace(self, residual=self.residual + _times(self.jacobian, step))

    def information(self) -> np.ndarray:
        """(..., 6, 6) what the instruments know of the turn and shift."""
        return _transposed(self.jacobian) @ np.linalg.solve(self.covariance, self.jacobian)

    def pull(self) -> np.ndarray:
        """(..., 6) the gradient of half the squared residuals in standard deviations."""
        return _times(_transposed(self.jacobian), _solved(self.covariance, self.residual))

    def squared(self) -> np.ndarray:
        """(...) chi-squared of the pose."""
        return (self.residual * _solved(self.covariance, self.residual)).sum(axis=-1)

    def distortion(self, covariance: np.ndarray, step: np.ndarray) -> np.ndarray:
        """(..., 6, 6) the covariance of the scans' distortion, as far as the instruments show it.

        A sonar that guesses elevations shows walls that lean, a wrong speed of sound bends the bed. Where the best fit,
        by the scans' own covariance and step, is as far from what was measured as 3 standard deviations of a single
        number would be, the scans are believed less in that direction, and from 4 on only the instruments are.
        """
        off = self.residual + _times(self.jacobian, step)
        together = self.jacobian @ covariance @ _transposed(self.jacobian) + self.covariance
        believed, distorted = _LIMITS[off.shape[-1] - 1]
        squared = (off * _solved(together, off)).sum(axis=-1)
        factor = np.maximum(squared - believed, 0.0) / np.maximum(distorted - squared, distorted / _UNKNOWN)
        along = _times(np.linalg.pinv(self.jacobian), off)
        share = factor / np.maximum(squared, believed)
        return share[..., None, None] * along[..., :, None] * along[..., None, :]


def posterior_step(step: np.ndarray, covariance: np.ndarray, term: PriorTerm) -> np.ndarray:
    """(..., 6) the step by the scans and the instruments together, from that by the scans alone and the covariance of
    where it leads, as far as the scans' points err independently."""
    scans = covariance + term.systematic
    information = np.linalg.inv(scans + term.distortion(scans, step))
    total = information + term.information() + _STAY * np.eye(6)
    return _solved(total, _times(information, step) - term.pull())


def _transposed(matrix: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrix, -1, -2)


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (matrix @ vector[..., None])[..., 0]


def _solved(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.linalg.solve(matrix, vector[..., None])[..., 0]


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

        Of what lies (..., 3) from each sensor to the source's grid center; a turn moves by the lever (...) [voxels]. If
        `stretches`, the ranges' share is estimated with the pose, and no error remains of it.
        """
        per_voxel = np.maximum(lever, 1.0)[..., None] ** -2 * np.ones(3)
        diagonal = self.bent * np.concatenate([per_voxel, np.ones_like(per_voxel)], axis=-1)
        covariance = diagonal[..., None] * np.eye(6)
        for away in () if stretches else (from_target, from_source):
            covariance[..., 3:, 3:] += self.stretched**2 * away[..., :, None] * away[..., None, :]
        return covariance


CALIBRATION = Calibration(**FITTED["calibration"])


_LOOSEST = 1e-4  # least share of the planes that counts to hold a direction


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
    (..., 6, 6) in columns, and levers (...) [voxels], which turns are taken times so that directions can be compared.
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
    """(...) 0..1, the geometric mean over all directions of how firmly the planes hold the pose: two flat places fit
    anywhere, as their planes hold three directions of six."""
    share, _, _ = principal_axes(information, pairs)
    return np.exp(np.log(np.maximum(share, _LOOSEST)).mean(axis=-1))
