"""Which scans may show the same place, by their signatures alone: no estimate of the poses is needed."""

import numpy as np
from scipy.linalg import eigh
from scipy.spatial import KDTree

from sonarmap.kernels.errors import InputError

# Of the directions in which signatures differ these many tell places apart best; with more, noise joins in.
_DIRECTIONS = 20
# Added to what consecutive scans differ by, as a multiple of its mean variance: few scans know it badly.
_RIDGE = 1.0
# Directions along which the scans differ less than this, as a share of the first, are rounding.
_NEGLIGIBLE = 1e-5


class PlaceIndex:
    """The scans of one or more surveys, searched by what they look like.

    Distances are taken along the few directions in which the scans differ most by the measure of how consecutive ones
    differ (Fisher's discriminant): these see nearly one place, so they differ by noise, aspect, and the short way
    between. The directions are learned from the surveys' own scans alone. Where consecutive scans are not of one place
    the directions become much like the principal components, and fewer revisits are neighbors.
    """

    def __init__(self, signatures: np.ndarray, surveys: np.ndarray | None = None) -> None:
        """Find the directions and place the scans.

        Args:
            signatures: (N, K), one a scan, in the order in which they were taken.
            surveys: (N,) int, which survey each scan is of, one survey after the other; None for one survey.
        """
        signatures = np.asarray(signatures, np.float64)
        if signatures.ndim != 2 or not signatures.size or not np.isfinite(signatures).all():
            raise InputError(f"signatures have shape {signatures.shape}; wanted (N, K), all finite, none empty")
        self.surveys = np.zeros(len(signatures), np.int64) if surveys is None else np.asarray(surveys)
        if self.surveys.shape != (len(signatures),) or (np.diff(self.surveys) < 0).any():
            raise InputError(
                f"surveys have shape {self.surveys.shape} for {len(signatures)} scans; wanted one number for "
                "each scan, ascending: the scans of one survey after those of another"
            )
        self._middle = signatures.mean(axis=0)
        self._places, self._axes = _discriminate(signatures, self._middle, np.diff(self.surveys) == 0)

    def most_like(self, signature: np.ndarray) -> np.ndarray:
        """The scans, (N,) int64, the most alike to another one's signature (K,) first."""
        place = (np.asarray(signature, np.float64) - self._middle) @ self._axes
        return np.argsort(np.linalg.norm(self._places - place, axis=1), kind="stable")

    def nearest(self, k: int, gap: int = 5, elsewhere: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """For each scan the k most alike others, best first; of equals the first in order.

        Args:
            gap: scans of the same survey so few places before or after are left out; they overlap anyway.
            elsewhere: whether to look in other surveys only.

        Returns:
            index (N, k) int64, -1 where there are no more, and distance (N, k) float64, inf there.
        """
        if k < 1 or gap < 0:
            raise InputError(f"k is {k} and gap {gap}; wanted at least 1 and at least 0")
        index = np.full((len(self._places), k), -1)
        distance = np.full(index.shape, np.inf)
        for survey in np.unique(self.surveys):
            own = np.flatnonzero(self.surveys == survey)
            pool = np.flatnonzero(self.surveys != survey) if elsewhere else np.arange(len(self.surveys))
            # so many that k are left when those within the gap are taken out
            count = min(k + 2 * gap + 1, len(pool))
            if not count:
                continue
            apart, neighbors = KDTree(self._places[pool]).query(self._places[own], count)
            apart, neighbors = np.reshape(apart, (len(own), count)), pool[np.reshape(neighbors, (len(own), count))]
            near = (np.abs(neighbors - own[:, None]) <= gap) & (self.surveys[neighbors] == survey)
            apart[near] = np.inf
            order = np.lexsort((neighbors, apart), axis=1)[:, :k]
            apart, neighbors = np.take_along_axis(apart, order, 1), np.take_along_axis(neighbors, order, 1)
            distance[own, : apart.shape[1]] = apart
            index[own, : apart.shape[1]] = np.where(np.isfinite(apart), neighbors, -1)
        return index, distance

    def candidates(self, per_scan: int, gap: int = 5, elsewhere: bool = False) -> list[tuple[int, int, float]]:
        """Every pair i < j of which one is among the `per_scan` nearest of the other, once, sorted, with its distance.

        Consecutive scans differ by about 1, or less, along each of the directions.

        Args:
            per_scan, gap, elsewhere: as k and the rest in `nearest`.
        """
        index, distance = self.nearest(per_scan, gap, elsewhere)
        scan, place = np.nonzero(index >= 0)
        neighbor = index[scan, place]
        pairs = np.column_stack([np.minimum(scan, neighbor), np.maximum(scan, neighbor)])
        pairs, first = np.unique(pairs, axis=0, return_index=True)
        apart = distance[scan, place][first]
        return [(i, j, d) for (i, j), d in zip(pairs.tolist(), apart.tolist(), strict=True)]


def _discriminate(signatures: np.ndarray, middle: np.ndarray, consecutive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, D) float64: signatures, less their middle, along the directions that separate places, in units of how
    consecutive scans differ; and (K, D) what brings any signature there.

    Args:
        consecutive: (N - 1,) bool, whether a scan and the next are of one survey.
    """
    left, spread, axes = np.linalg.svd(signatures - middle, full_matrices=False)
    kept = spread > _NEGLIGIBLE * max(spread[0], np.abs(signatures).max())
    own, axes = (left * spread)[:, kept], axes[kept].T
    if not own.shape[1]:
        return np.zeros((len(own), 1)), np.zeros((len(axes), 1))
    steps = (own[1:] - own[:-1])[consecutive]
    within = steps.T @ steps / max(len(steps), 1)
    ridge = _RIDGE * np.trace(within) / len(within) or 1.0
    last = len(within) - 1
    _, directions = eigh(
        own.T @ own, within + ridge * np.eye(len(within)), subset_by_index=(max(0, last - _DIRECTIONS + 1), last)
    )
    # pyrefly: ignore[bad-index]
    return own @ directions[:, ::-1], axes @ directions[:, ::-1]
