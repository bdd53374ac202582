"""The plane through noisy points and the covariance of its parameters.

Pathak, Vaskevicius, Birk: Uncertainty analysis for optimum plane extraction from noisy 3D range-sensor point-clouds.
Intelligent Service Robotics 3(1), 2010, DOI 10.1007/s11370-009-0057-4.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True, slots=True)
class Patches:
    """K plane patches of a scan, largest first: n . p = d for the points p of each."""

    normal: np.ndarray  # (K, 3) unit normals, pointing from the sensor to the plane: d >= 0
    distance: np.ndarray  # (K,) of the planes from the sensor [m]
    covariance: np.ndarray  # (K, 4, 4) of (n, d) [-, m], of rank 3: n keeps its length
    middle: np.ndarray  # (K, 3) [m, sensor frame] middle of each patch
    spread: np.ndarray  # (K, 3, 3) [m^2] second moments of its area about the middle
    area: np.ndarray  # (K,) [m^2]

    def __len__(self) -> int:
        return len(self.distance)

    def take(self, index: np.ndarray) -> Patches:
        """The patches (M,) of `index`, in its order."""
        return Patches(*(getattr(self, field.name)[index] for field in fields(self)))


def tangents(normal: np.ndarray) -> np.ndarray:
    """(..., 4, 3) the ways in which planes of normals (..., 3) can change: two turns of (n, d), and d."""
    other = np.where(np.abs(normal[..., :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(normal, other)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(normal, first)
    basis = np.zeros((*normal.shape[:-1], 4, 3))
    basis[..., :3, 0], basis[..., :3, 1], basis[..., 3, 2] = first, second, 1.0
    return basis


# Beams that graze the surface fix it best if their ranges alone err, but roughness and the beam's width err, too:
# the sine of the angle between beam and surface counts as at least this.
_LEAST_SINE = 0.25
_ROUNDS = 3
# Points farther off are echoes of something else [standard deviations].
_STRAY = 3.0


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """A plane n . p = d."""

    normal: np.ndarray  # (3,) unit, pointing from the sensor to the plane
    distance: float  # from the sensor, >= 0 [m]
    covariance: np.ndarray  # (4, 4) of (n, d), of rank 3
    kept: np.ndarray  # (N,) bool, the points that were not strays


def fit_plane(points: np.ndarray, block: np.ndarray) -> PlaneFit:
    """The most likely plane through points whose ranges err, with its covariance.

    The variance of a range grows in proportion to it, by a factor that the points' own deviations tell; a range
    error moves a point off the plane by the sine of the beam's angle with it. A surface that is not quite plane
    deviates from it for whole blocks of points at once: how much is known from the blocks' means, and the weight of
    a block is then that of one point with this deviation, however many points it holds.

    Args:
        points: (N, 3) [m, sensor frame], N >= 4, not on one line.
        block: (N,) int, which block of the surface each lies in.
    """
    middle = points.mean(axis=0)
    normal = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]
    ranges = np.maximum(np.linalg.norm(points, axis=1), 1e-9)
    _, block = np.unique(block, return_inverse=True)
    kept = np.ones(len(points), bool)
    weight, distance = kept / ranges, float(normal @ middle)
    for _ in range(_ROUNDS):
        sine = np.maximum(np.abs(points @ normal) / ranges, _LEAST_SINE)
        shape = ranges * sine**2
        off = points @ normal - distance
        variance, bump = _variances(off[kept], shape[kept], block[kept])
        own = kept / (variance * shape)
        weight = own / (1 + bump * np.bincount(block, own))[block]  # less what it shares with its block
        normal, distance, _ = _weighted_plane(points, weight)
        off = points @ normal - distance
        kept = np.abs(off) <= _STRAY * np.sqrt(variance * shape + bump) + 1e-12
        weight = weight * kept
    normal, distance, hessian = _weighted_plane(points, weight)
    if distance < 0:  # (n, d) and (-n, -d) are one plane, and the Hessian is the same for both
        normal, distance = -normal, -distance
    basis = tangents(normal)  # the changes that keep |n| = 1
    return PlaneFit(normal, distance, basis @ np.linalg.inv(basis.T @ hessian @ basis) @ basis.T, kept)


def _variances(off: np.ndarray, shape: np.ndarray, block: np.ndarray) -> tuple[float, float]:
    """The factor of the points' variances and the variance of the blocks [m^2], from deviations (N,) [m].

    DerSimonian and Laird's estimate of a random effect (DOI 10.1016/0197-2456(86)90046-2): what the blocks' means
    deviate beyond what their points explain.
    """
    _, block = np.unique(block, return_inverse=True)
    count = np.bincount(block)
    information = np.bincount(block, 1 / shape)
    mean = np.bincount(block, off / shape) / information
    within = float((((off - mean[block]) ** 2) / shape).sum())
    variance = max(within / max(len(off) - len(count), 1), 1e-12)
    information = information / variance
    freedom = max(len(count) - 3, 0)
    excess = float((information * mean**2).sum()) - freedom
    scale = float(information.sum() - (information**2).sum() / information.sum())
    return variance, max(excess / scale, 0.0) if freedom and scale > 0 else 0.0


def _weighted_plane(points: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Normal (3,), distance and the Hessian (4, 4) of half the weighted squares in (n, d), |n| = 1.

    The normal is the eigenvector of the weighted scatter's smallest eigenvalue. That eigenvalue is the Lagrange
    multiplier of |n| = 1 and leaves the Hessian's block of n.
    """
    total = weight.sum()
    middle = weight @ points / total
    moved = points - middle
    scatter = (weight[:, None] * moved).T @ moved
    values, vectors = np.linalg.eigh(scatter)
    normal = vectors[:, 0]
    hessian = np.empty((4, 4))
    hessian[:3, :3] = scatter + total * np.outer(middle, middle) - values[0] * np.eye(3)
    hessian[:3, 3] = hessian[3, :3] = -total * middle
    hessian[3, 3] = total
    return normal, float(normal @ middle), hessian
