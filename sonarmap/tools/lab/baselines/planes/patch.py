"""The plane patches of one scan, with what is known of their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True, slots=True)
class Patches:
    """K plane patches of a scan, largest first: n . p = d for the points p of each.

    Attributes:
        normal: (K, 3) unit normals, pointing from the sensor to the plane: d >= 0.
        distance: (K,) of the planes from the sensor [m].
        covariance: (K, 4, 4) of (n, d) [-, m], of rank 3: n keeps its length.
        middle: (K, 3) [m, sensor frame] middle of each patch.
        spread: (K, 3, 3) [m^2] second moments of its area about the middle.
        area: (K,) [m^2].
        count: (K,) points of each.
    """

    normal: np.ndarray
    distance: np.ndarray
    covariance: np.ndarray
    middle: np.ndarray
    spread: np.ndarray
    area: np.ndarray
    count: np.ndarray

    def __len__(self) -> int:
        return len(self.distance)

    def take(self, index: np.ndarray) -> Patches:
        """The patches (M,) of `index`, in its order."""
        return Patches(*(getattr(self, field.name)[index] for field in fields(self)))


def no_patches() -> Patches:
    """What a scan without planes has."""
    empty = np.zeros
    return Patches(
        empty((0, 3)), empty(0), empty((0, 4, 4)), empty((0, 3)), empty((0, 3, 3)), empty(0), empty(0, dtype=np.int64)
    )


def tangents(normal: np.ndarray) -> np.ndarray:
    """(..., 4, 3) the ways in which planes of normals (..., 3) can change: two turns of (n, d), and d."""
    other = np.where(np.abs(normal[..., :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(normal, other)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(normal, first)
    basis = np.zeros((*normal.shape[:-1], 4, 3))
    basis[..., :3, 0], basis[..., :3, 1], basis[..., 3, 2] = first, second, 1.0
    return basis
