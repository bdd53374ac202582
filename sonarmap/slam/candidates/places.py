"""Search for scans that may show the same place, by their signatures alone, without an estimate of the poses."""

import numpy as np
from scipy.linalg import eigh
from scipy.spatial.distance import cdist

from sonarmap.kernels.errors import InputError

_DIRECTIONS = 20  # of signatures that distances are measured along; more would add noise


class PlaceIndex:
    """The scans of one or more surveys, searchable by their signatures.

    Distances are measured along the directions in which scans differ most relative to consecutive scans (Fisher's
    discriminant): these show nearly the same place, so they differ by noise, aspect and a short distance. Only these
    surveys' scans teach the directions. If consecutive scans show different places, the directions resemble the
    principal components, and fewer revisits are neighbors.
    """

    def __init__(self, signatures: np.ndarray, surveys: np.ndarray | None = None) -> None:
        """Learn the directions and index the scans.

        Args:
            signatures: (N, K), one per scan, in the order in which they were taken.
            surveys: (N,) int, ascending, the survey of each scan; None for one survey.
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
        """Indices of the scans, (N,) int64, those most similar to a signature (K,) first."""
        place = (np.asarray(signature, np.float64) - self._middle) @ self._axes
        return np.argsort(np.linalg.norm(self._places - place, axis=1), kind="stable")

    def distances(self, scans: np.ndarray, others: np.ndarray) -> np.ndarray:
        """(n, m) distances of n scans from m others, given by their indices.

        Consecutive scans differ by about 1, or less, along each of the directions.
        """
        return cdist(self._places[scans], self._places[others])


def _discriminate(signatures: np.ndarray, middle: np.ndarray, consecutive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (N, D) float64 of signatures along the directions that separate places, in units of the differences
    between consecutive scans; and (K, D) axes to project other signatures on, less the middle.

    Args:
        consecutive: (N - 1,) bool, whether a scan and the next are of one survey.
    """
    scores, size = signatures - middle, signatures.shape[1]
    steps = np.diff(scores, axis=0)[consecutive]
    within = steps.T @ steps / max(len(steps), 1)
    # regularized by its mean variance
    ridge = np.trace(within) / max(min(len(scores) - 1, size), 1) or 1.0
    chosen = max(0, size - _DIRECTIONS), size - 1
    _, axes = eigh(scores.T @ scores, within + ridge * np.eye(size), subset_by_index=chosen)
    # pyrefly: ignore[bad-index]
    return scores @ axes[:, ::-1], axes[:, ::-1]
