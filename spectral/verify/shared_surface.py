"""How much of their surfaces two scans share under a pose: evidence that needs no viewpoint."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.prepare.surface import Surface

# A point has a counterpart this near, if the normals there are within 37 degrees of each other [voxels; cosine].
_REACH, _ALIKE = 2.0, 0.8
# Where the other scan has a point this near, it shows that place, and should show the point [voxels].
_COVERED = 6.0
# A share that is small beside this hardly counts.
_LEAST = 0.05


@dataclass(frozen=True, slots=True)
class SharedSurface:
    """Shares of two scans' surfaces, the mean of both ways, 0..1; all directions of normals count alike.

    Attributes:
        agree: has a counterpart in the other scan, facing the same direction.
        covered: lies where the other scan shows something.
        overlap: has a point of the other scan within 2 voxels, whatever it faces, each point counting once; the smaller
            of both ways.
    """

    agree: float
    covered: float
    overlap: float

    @property
    def consistency(self) -> float:
        """Of what both should show, what both do, 0..1; a small number where they should show little."""
        return self.agree / (self.covered + _LEAST)


def shared_surface(target: Surface, source: Surface, R: Rotation, shift: np.ndarray, most: int) -> SharedSurface:
    """What the scans share under a pose.

    Args:
        R, shift: p_target = R p_source + shift about the grid centers [voxels].
        most: how many points of each scan are looked at.
    """
    turn = R.as_matrix()
    onto_target = _shares(target, source, turn, shift, most)
    onto_source = _shares(source, target, turn.T, -shift @ turn, most)
    agree, covered, _ = (onto_target + onto_source) / 2
    return SharedSurface(float(agree), float(covered), float(min(onto_target[2], onto_source[2])))


def _shares(surface: Surface, other: Surface, turn: np.ndarray, shift: np.ndarray, most: int) -> np.ndarray:
    """(3,) of the other's points: those that agree with the surface, that lie where it is, and, unweighted, on it."""
    step = max(1, -(-len(other.points) // most))
    weights = other.weights[::step]
    distance, index = surface.tree.query(other.points[::step] @ turn.T + shift, distance_upper_bound=_COVERED)
    covered = np.isfinite(distance)
    near = np.flatnonzero(distance <= _REACH)
    facing = np.einsum("ni,ni->n", other.normals[::step][near] @ turn.T, surface.normals[index[near]])
    agree = near[np.abs(facing) >= _ALIKE]
    total = weights.sum()
    return np.array([weights[agree].sum() / total, weights[covered].sum() / total, len(near) / len(weights)])
