"""Log odds that are quadratic in clues: which clue says how much depends on the others."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Odds:
    """Of K clues, each taken within the range of those that were fitted to, less their mean, over their deviation."""

    names: tuple[str, ...]  # of the clues
    # low, high, mean, deviation: (K,) of each
    low: np.ndarray
    high: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    constant: float = 0.0
    weights: np.ndarray | None = None  # (M,) of the clues, then of their products; None before a fit

    @property
    def terms(self) -> list[str]:
        """The names of the M terms, as in "psr" or "psr view"."""
        return [*self.names, *(" ".join(pair) for pair in combinations_with_replacement(self.names, 2))]

    def columns(self, clues: np.ndarray) -> np.ndarray:
        """(N, M) the terms of (N, K) clues."""
        x = (np.clip(clues, self.low, self.high) - self.mean) / self.deviation
        first, second = np.array(list(combinations_with_replacement(range(x.shape[1]), 2))).T
        return np.hstack([x, x[:, first] * x[:, second]])

    def of(self, clues: np.ndarray) -> np.ndarray:
        """(N,) the log odds of (N, K) clues."""
        return self.constant + self.columns(clues) @ self.weights

    def to_json(self) -> dict[str, Any]:
        ranges = np.column_stack([self.low, self.high, self.mean, self.deviation]).round(4).tolist()
        weights = [] if self.weights is None else self.weights.round(4).tolist()
        return {
            "constant": round(self.constant, 4),
            "clues": dict(zip(self.names, ranges, strict=True)),
            "weights": dict(zip(self.terms, weights, strict=True)),
        }

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> "Odds":
        low, high, mean, deviation = np.array(list(table["clues"].values())).T
        weights = np.array(list(table["weights"].values()))
        return cls(tuple(table["clues"]), low, high, mean, deviation, table["constant"], weights)
