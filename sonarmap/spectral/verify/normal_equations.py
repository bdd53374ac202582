"""The normal equations of point-to-plane steps of several poses, with what instruments measured beside them."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.surface.record import Record
from sonarmap.spectral.verify.calibration import CALIBRATION
from sonarmap.spectral.verify.prior_term import PriorTerm, posterior_step

# (8, 7) of a pose and both stretches, which are opposite.
_OPPOSITE = np.vstack([np.eye(7), -np.eye(7)[6]])
# From this share of one scan's information on that of both scans' normals shows that it is not of noise.
_AGREEING = 0.3


@dataclass(frozen=True, slots=True)
class State:
    """Where k refinements are: rotations (k, 3, 3), shifts (k, 3), widths (k,), stretches (k, 2); and priors there."""

    turn: np.ndarray
    shift: np.ndarray
    width: np.ndarray
    stretch: np.ndarray | None
    prior: PriorTerm | None


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """Those of one Gauss-Newton step on the distances along the normals, of k poses; the stretches come last."""

    # hessian, gradient: (k, 6 or 8, 6 or 8) and (k, 6 or 8) by the pairs that move the pose, with what is known of the
    # stretches before
    hessian: np.ndarray
    gradient: np.ndarray
    whole: np.ndarray  # (k, 6 or 8, 6 or 8) the Hessian by all pairs, those that move it or not, with the same
    # (k, 6 or 8, 6 or 8) the Hessian from one scan's normals times the other's, without it. Normals of noisy points
    # point everywhere a little, and the sum of their squares finds information along a plane that has none. The noise
    # of two scans is independent: in products of both it averages out.
    shared: np.ndarray
    variance: np.ndarray  # (k,) of the gaps, as far as they are independent [voxels^2]

    @classmethod
    def of(cls, record: Record, state: State) -> "NormalEquations":
        size = 6 if state.stretch is None else 8
        variance = CALIBRATION.variance(state.width)
        hessian, whole, shared = (sums[:, :size, :size].copy() for sums in (record.moving, record.whole, record.shared))
        gradient = record.gradient[:, :size].copy()
        if state.stretch is not None:
            known = _known_stretch(variance)
            hessian[:, 6:, 6:] += known
            whole[:, 6:, 6:] += known
            gradient[:, 6:] += (known @ state.stretch[:, :, None])[:, :, 0]
        return cls(hessian, gradient, whole, (shared + shared.transpose(0, 2, 1)) / 2, variance)

    def moved(self, state: State) -> tuple[State, np.ndarray]:
        """Where the step leads, and (k, 6) where it would by the scans alone."""
        step = alone = self._step_alone(state)
        if state.prior is not None:
            step = posterior_step(alone, self._usual_covariance(), state.prior)
        moved = State(
            turn=Rotation.from_rotvec(step[:, :3]).as_matrix() @ state.turn,
            shift=state.shift + step[:, 3:],
            width=state.width,
            stretch=None if state.stretch is None else self._stretched(state.stretch, step, state.prior is not None),
            prior=None if state.prior is None else state.prior.moved(step),
        )
        return moved, alone

    def _usual_covariance(self) -> np.ndarray:
        """(k, 6, 6) of where the planes of all pairs have the pose, those that move it or not."""
        shared = self.shared.copy()
        if shared.shape[1] == 8:
            shared[:, 6:, 6:] += _known_stretch(self.variance)
        return usual_covariance(_damped(_of_pose(self.whole)), _of_pose(shared), self.variance)

    def _step_alone(self, state: State) -> np.ndarray:
        """(k, 6) of the pose, where both scans are stretched by opposite shares.

        Scans that both shrink, and the way between them with them, fit as well: their gaps shrink, too. So what both
        stretches have in common must not be sought where gaps are smallest; it would draw the scans together.
        """
        hessian, gradient = self.hessian, self.gradient
        if state.stretch is not None:
            common = state.stretch.mean(axis=1)[:, None, None] * np.ones((2, 1))
            gradient = gradient - (hessian[:, :, 6:] @ common)[:, :, 0]
            hessian, gradient = _OPPOSITE.T @ hessian @ _OPPOSITE, gradient @ _OPPOSITE
        across, stretch = hessian[:, 6:, :6], hessian[:, 6:, 6:]
        rest = across.transpose(0, 2, 1) @ np.linalg.solve(stretch, gradient[:, 6:, None])
        return -np.linalg.solve(_damped(_of_pose(hessian)), gradient[:, :6, None] - rest)[:, :, 0]

    def _stretched(self, stretch: np.ndarray, step: np.ndarray, measured: bool) -> np.ndarray:
        """(k, 2) the stretches after a step of the pose; opposite ones unless something else `measured` the pose."""
        free = np.eye(2) if measured else _OPPOSITE[6:, 6:]
        rest = self.gradient[:, 6:] + (self.hessian[:, 6:, :6] @ step[:, :, None])[:, :, 0]
        change = np.linalg.solve(free.T @ self.hessian[:, 6:, 6:] @ free, (rest @ free)[:, :, None])
        return stretch - (free @ change)[:, :, 0]


def _known_stretch(variance: np.ndarray) -> np.ndarray:
    """(k, 2, 2) what is known of both scans' stretches before, where gaps have the (k,) variances."""
    return (variance / CALIBRATION.stretched**2)[:, None, None] * np.eye(2)


def _of_pose(hessian: np.ndarray) -> np.ndarray:
    """(k, 6, 6) of the pose, whatever the stretches are: the Schur complement."""
    pose, across, stretch = hessian[:, :6, :6], hessian[:, 6:, :6], hessian[:, 6:, 6:]
    return pose - across.transpose(0, 2, 1) @ np.linalg.solve(stretch, across)


def _damped(hessian: np.ndarray) -> np.ndarray:
    """(k, 6, 6) so that what nothing fixes stays where it is."""
    damping = 1e-9 * (np.trace(hessian, axis1=1, axis2=2) + 1e-9)
    return hessian + damping[:, None, None] * np.eye(6)


def usual_covariance(hessian: np.ndarray, shared: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """(k, 6, 6) of where the planes have the pose, as errors usually are; arguments as of `NormalEquations`.

    In directions that noise alone seems to fix the scans are worth a tenth as much as where both show the same planes.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(hessian))
    share, axes = np.linalg.eigh(inverse @ shared @ inverse.transpose(0, 2, 1))
    doubt = np.clip(CALIBRATION.usual * _AGREEING / np.maximum(share, 1e-9), CALIBRATION.usual, 1.0)
    root = inverse.transpose(0, 2, 1) @ axes
    return (root * (variance[:, None] * doubt)[:, None, :]) @ root.transpose(0, 2, 1)
