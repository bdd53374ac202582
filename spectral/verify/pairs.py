"""Pairs of nearest points of two surfaces, both ways, under several poses side by side."""

from dataclasses import dataclass

import numpy as np

from spectral.nearest import query_on_all_cores
from spectral.prepare.surface import Surface

# More points than this are worth a thread for every core.
_MANY = 2000


@dataclass(frozen=True, slots=True)
class Sample:
    """Some points of a surface, (n, 3) each, as `Surface` has them."""

    points: np.ndarray
    normals: np.ndarray
    rays: np.ndarray


@dataclass(frozen=True, slots=True)
class Pairs:
    """For k poses n pairs of nearest points of both scans, in the target's axes.

    Attributes:
        near: (k, n) which are within reach; the others do not count.
        inner: (k, n) which of these have a nearest point that lies at no rim, and were seen from the same side. Beyond
            a rim a surface was not seen, though it may go on there; and the two sides of a pipe are not one surface.
            None where nobody asked.
        arms: (k, n, 3) of the source's points, from the source's grid center [voxels].
        normals: (k, n, 3) of the surface whose plane they are to lie in.
        others: (k, n, 3) of the other scan's surface there, of either sign.
        gaps: (k, n) how far they stand off that plane [voxels].
        by_stretch: (k, n, 2) how the gap changes with the stretch of the source and of the target [voxels]; None where
            the scans are taken as they are.
    """

    near: np.ndarray
    inner: np.ndarray | None
    arms: np.ndarray
    normals: np.ndarray
    others: np.ndarray
    gaps: np.ndarray
    by_stretch: np.ndarray | None


def find_pairs(
    target: Surface,
    source: Surface,
    few_target: Sample,
    few_source: Sample,
    turn: np.ndarray,
    shifts: np.ndarray,
    reach: np.ndarray,
    *,
    stretches: bool,
    inner: bool,
) -> Pairs:
    """Some points of each scan with the nearest of the other's.

    Args:
        turn, shifts: (k, 3, 3) and (k, 3) p_target = R p_source + shift about the grid centers [voxels].
        reach: (k,) how far apart a pair may be [voxels].
        stretches: whether to find out how stretches would change the gaps.
        inner: whether to find out which pairs lie at no rim and were seen from the same side.
    """
    shift = shifts[:, None]
    forward = turn.transpose(0, 2, 1)
    arms = few_source.points @ forward
    near, there = _nearest(target, arms + shift, reach)
    normals = target.normals[there]
    gaps = along(arms + shift - target.points[there], normals)
    back_near, here = _nearest(source, (few_target.points - shift) @ turn, reach)
    back_arms, back_normals = source.points[here] @ forward, source.normals[here] @ forward
    back_gaps = along(back_arms + shift - few_target.points, back_normals)
    by_stretch = alike = None
    if stretches or inner:
        # how a gap changes, as a point of the source or of the target moves along the ray that it was seen by
        by_rays = np.concatenate(
            [
                _along_rays(few_source.rays @ forward, target.rays[there], normals),
                _along_rays(source.rays[here] @ forward, few_target.rays[None], back_normals),
            ],
            axis=1,
        )
        by_stretch = by_rays * (1.0, -1.0) if stretches else None
        if inner:
            alike = np.concatenate([near & target.inner[there], back_near & source.inner[here]], axis=1)
            alike &= by_rays.prod(axis=2) >= 0
    return Pairs(
        near=np.concatenate([near, back_near], axis=1),
        inner=alike,
        arms=np.concatenate([arms, back_arms], axis=1),
        normals=np.concatenate([normals, back_normals], axis=1),
        others=np.concatenate(
            [few_source.normals @ forward, np.broadcast_to(few_target.normals, back_normals.shape)], axis=1
        ),
        gaps=np.concatenate([gaps, back_gaps], axis=1),
        by_stretch=by_stretch,
    )


def _nearest(surface: Surface, points: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the points (k, n, 3) have a point of the surface within reach (k,), and which it is; (k, n) each."""
    flat, farthest = points.reshape(-1, 3), float(reach.max())
    if len(flat) > _MANY:
        distance, index = query_on_all_cores(surface.tree, flat, reach=farthest)
    else:
        distance, index = surface.tree.query(flat, distance_upper_bound=farthest)
    near = distance.reshape(points.shape[:2]) <= reach[:, None]
    return near, np.where(near, index.reshape(near.shape), 0)


def medians(gaps: np.ndarray, near: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """(k,) of the gaps (k, n) that are near, or what is given where none is."""
    count = near.sum(axis=1)
    ordered = np.sort(np.where(near, gaps, np.inf), axis=1)
    rows = np.arange(len(gaps))
    middle = (
        ordered[rows, np.maximum(count - 1, 0) // 2] + ordered[rows, np.minimum(count // 2, gaps.shape[1] - 1)]
    ) / 2
    return np.where(count > 0, middle, otherwise)


def _along_rays(source_rays: np.ndarray, target_rays: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(k, n, 2) the parts of the source's and of the target's rays along the normals; 0 where a ray is not known."""
    return np.stack([along(source_rays, normals), along(target_rays, normals)], axis=2)


def thin(surface: Surface, most: int) -> Sample:
    """At most so many points, evenly."""
    step = max(1, -(-len(surface.points) // most))
    return Sample(surface.points[::step], surface.normals[::step], surface.rays[::step])


def along(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(...) the parts of vectors (..., 3) along unit ones."""
    return (vectors * normals).sum(axis=-1)
