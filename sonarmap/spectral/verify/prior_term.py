"""What instruments measured of a pair, linear about a pose: a factor beside the planes of both scans."""

from dataclasses import dataclass, replace

import numpy as np

from sonarmap.spectral.chi_squared import beyond_sigmas

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

        A sonar that guesses elevations shows walls that lean, a wrong speed of sound bends the bed. Two such scans fit
        best where the vehicle was not. Where the best fit is as far from what was measured as 3 standard deviations of
        a single number would be, the scans are believed less in that direction, and from 4 on only the instruments are.
        The covariance (..., 6, 6) is by the scans alone; the step leads from the pose to where they would have it.
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
    """(..., 6) the step by the scans and the instruments together.

    From that by the scans alone, and the covariance of where it leads, as far as the scans' points err independently.
    """
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
