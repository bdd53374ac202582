"""Navigation as a file has it: rows of measurements at names or times."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.tools.files.readers.instruments import COLUMNS

if TYPE_CHECKING:
    from sonarmap.tools.files.geo.georeference import Georeference


@dataclass(frozen=True, slots=True)
class NavigationLog:
    """Rows of a file of navigation, of the vehicle, or of the sonar where nothing is said of its mount.

    Attributes:
        key: "name" or "stamp", which says which scan a row is for.
        lines: (n,) int64, of the rows in the file.
        keys: the names, or the stamps as they are written.
        times: (n,) float64 [s, UTC]; NaN where the key is a name.
        values: (n, 6) float64 in the order, units and signs of `readers.instruments.COLUMNS`; NaN where nothing
            was measured. x and y are East and North of the georeference's origin, if there is one; headings from the
            North of `heading_reference`.
        sigmas: (n, 6) float64 standard deviations in the same units; NaN where the file has none.
        georeference: where the origin is on the Earth; None where that is not known.
    """

    key: str
    lines: np.ndarray
    keys: tuple[str, ...]
    times: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray
    georeference: "Georeference | None" = None

    @property
    def measured(self) -> np.ndarray:
        """(n,) bool: rows in which anything was measured."""
        return np.any(np.isfinite(self.values), axis=1)


def with_defaults(sigmas: np.ndarray, defaults: Mapping[str, float]) -> np.ndarray:
    """(n, 6) standard deviations, where there are none those of {column of COLUMNS: standard deviation}."""
    return np.where(np.isnan(sigmas), [defaults.get(column, np.nan) for column in COLUMNS], sigmas)
