"""How much of their surfaces two scans share under a pose: evidence that needs no viewpoint."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spectral.nearest import query_on_all_cores
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


def shared_surfaces(
    target: Surface, source: Surface, R: Rotation, shifts: np.ndarray, most: int
) -> list[SharedSurface]:
    """What the scans share under each of k poses.

    Args:
        R: (k,) rotations.
        shifts: (k, 3) p_target = R p_source + shift about the grid centers [voxels].
        most: how many points of each scan are looked at.
    """
    turns = R.as_matrix()
    onto_target = _shares(target, source, turns, shifts, most)
    onto_source = _shares(source, target, turns.transpose(0, 2, 1), -np.einsum("ki,kij->kj", shifts, turns), most)
    agree, covered = ((onto_target + onto_source) / 2)[:, :2].T
    overlap = np.minimum(onto_target[:, 2], onto_source[:, 2])
    return [SharedSurface(*shares) for shares in np.column_stack([agree, covered, overlap]).tolist()]


def _shares(surface: Surface, other: Surface, turns: np.ndarray, shifts: np.ndarray, most: int) -> np.ndarray:
    """(k, 3) of the other's points: those that agree with the surface, that lie where it is, and, unweighted, on it."""
    step = max(1, -(-len(other.points) // most))
    weights, forward = other.weights[::step], turns.transpose(0, 2, 1)
    points = other.points[::step] @ forward + shifts[:, None]
    distance, index = query_on_all_cores(surface.tree, points.reshape(-1, 3), reach=_COVERED)
    distance = distance.reshape(points.shape[:2])
    pose, near = np.nonzero(distance <= _REACH)
    facing = np.einsum(
        "ni,nij,nj->n",
        other.normals[::step][near],
        forward[pose],
        surface.normals[index.reshape(distance.shape)[pose, near]],
    )
    agree = np.abs(facing) >= _ALIKE
    count, total = len(turns), weights.sum()
    agreeing = np.bincount(pose[agree], weights[near[agree]], count)
    return np.column_stack(
        [agreeing / total, np.isfinite(distance) @ weights / total, np.bincount(pose, minlength=count) / len(weights)]
    )
