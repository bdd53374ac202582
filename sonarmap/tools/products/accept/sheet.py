"""The acceptance sheet of a finished map: which of its cells meet an order of IHO S-44, and why the others do not."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import binary_fill_holes, binary_opening

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import VERTICALS
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import as_written
from sonarmap.tools.products.accept.cells import DepthCells, depth_cells
from sonarmap.tools.products.accept.crossings import CrossingCheck, crossing_check
from sonarmap.tools.products.accept.orders import ORDERS, STANDARD, Order
from sonarmap.tools.products.export.grid import default_cell

LEAST_SHARE = 0.95  # of the cells that meet an order, as its uncertainties are those of 95 % confidence
_LEAST_COVERAGE = 0.05  # of any order (S-44, "Less than 100 % bathymetric coverage")
# Why a cell fails: the largest term of a TVU that is too large, in the order of `DepthCells.terms`, then the others
REASONS = {
    "poses": "the scans' heights and tilts are too uncertain",
    "slope": "the positions are too uncertain for so steep a surface",
    "noise": "the soundings scatter too much about a plane: noise, or objects smaller than a cell",
    "datum": "the vertical datum is too uncertain",
    "position": "the positions are too uncertain, or corrected by a lever arm that nobody measured",
    "coverage": "there are no soundings, or of too few passes",
}
_NAMES = list(REASONS)
_NEEDED = {  # the priors that measure a frame's unknowns (`slam.graph.gauge.MEASURED`)
    "depths (depth_m)": ("up",),
    "roll and pitch (roll_deg, pitch_deg)": ("tilt_x", "tilt_y"),
    "headings (heading_deg)": ("heading",),
    "positions (x_m, y_m or latitudes and longitudes)": ("east", "north"),
}


@dataclass(frozen=True)  # without slots, which cached_property needs
class Verdict:
    """How a map's cells meet one order.

    Attributes:
        order: the order.
        cells: the K cells with soundings.
        holes: (rows, columns) bool, cells without soundings that the survey encloses, if the order asks for full
            coverage. Single ones do not count: in a square of two by two the order's smallest feature is not seen.
        coverage: share of the enclosed area with soundings.
    """

    order: Order
    cells: DepthCells
    holes: np.ndarray
    coverage: float

    @classmethod
    def of(cls, order: Order, cells: DepthCells) -> "Verdict":
        filled = np.zeros((int(cells.row.max()) + 1, int(cells.column.max()) + 1), bool)
        filled[cells.row, cells.column] = True
        empty = binary_fill_holes(filled) & ~filled
        holes = binary_opening(empty, np.ones((2, 2), bool)) & (order.coverage >= 1)
        return cls(order, cells, holes, float(filled.sum() / (filled.sum() + empty.sum())))

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """(K,) largest TVU and largest THU that the order allows at the cells' depths [m]."""
        order, depth = self.order, np.maximum(self.cells.depth, 0.0)
        return np.hypot(order.a, order.b * depth), order.fixed + order.share * depth

    @cached_property
    def reason(self) -> np.ndarray:
        """(K,) int64 index into REASONS of why each cell fails; -1 where it meets the order."""
        cells, (vertical, horizontal) = self.cells, self.limits
        failed = np.where(cells.passes < self.order.coverage, _NAMES.index("coverage"), -1)
        failed = np.where(cells.thu > horizontal, _NAMES.index("position"), failed)
        return np.where(cells.tvu > vertical, np.argmax(list(cells.terms.values()), axis=0), failed)

    @property
    def share(self) -> float:
        """Share of the cells with soundings that meet the order."""
        return float((self.reason < 0).mean())

    @property
    def met(self) -> bool:
        return not self.holes.any() and self.coverage >= _LEAST_COVERAGE and self.share >= LEAST_SHARE

    @property
    def failing(self) -> Mapping[str, float]:
        """Share of all cells, holes included, that fail for each reason."""
        counts = np.bincount(self.reason[self.reason >= 0], minlength=len(_NAMES))
        counts[-1] += self.holes.sum()
        return dict(zip(_NAMES, (counts / (len(self.reason) + self.holes.sum())).tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class Sheet:
    """An acceptance sheet.

    Attributes:
        folder: the map.
        asked: key in ORDERS of the order that is asked for.
        verdicts: the verdict on every order, by its key.
        crossings: observed and predicted differences between passes.
        depths: what the depths are below, in words.
    """

    folder: Map
    asked: str
    verdicts: Mapping[str, Verdict]
    crossings: CrossingCheck
    depths: str

    @property
    def verdict(self) -> Verdict:
        """That on the order which is asked for."""
        return self.verdicts[self.asked]

    @property
    def cells(self) -> DepthCells:
        return self.verdict.cells

    def meets(self, key: str) -> bool:
        """Whether the map meets an order; none if its scans and its navigation contradict each other."""
        return self.verdicts[key].met and not self.folder.summary.get("contradictions")

    @property
    def best(self) -> str | None:
        """Key of the strictest order that is met; None without."""
        return next((key for key in self.verdicts if self.meets(key)), None)

    @property
    def warnings(self) -> list[str]:
        """What the map itself says about its faults."""
        return [str(warning) for warning in self.folder.summary.get("warnings") or ()]

    @property
    def sentence(self) -> str:
        """The result for a client."""
        verdict = self.verdict
        cells = f"{100 * verdict.share:.1f} % of {len(self.cells.depth):,} cells of {self.cells.cell:g} m"
        title = f"{verdict.order.title} of {STANDARD}"
        if self.meets(self.asked):
            return (
                f"The survey meets {title}: {cells} have a depth and a position that are as certain as the order "
                f"demands, half of the depths to {np.median(self.cells.tvu):.2f} m or better."
            )
        if verdict.met:
            why = f"{cells} would do, but the scans and the navigation contradict each other: see the map's warnings"
        elif verdict.share >= LEAST_SHARE:
            why = f"{cells} do, but {int(verdict.holes.sum()):,} cells between them are holes without soundings"
        else:
            reason = REASONS[max(_NAMES, key=verdict.failing.__getitem__)]
            why = f"only {cells} do, and {100 * LEAST_SHARE:g} % would have to. The most frequent reason: {reason}"
        best = f"It meets {ORDERS[self.best].title}." if self.best else "It meets no other order either."
        return f"The survey does not meet {title}: {why}. {best}"

    def to_json(self) -> Mapping[str, Any]:
        """The numbers of the sheet, uncertainties in meters at 95 % confidence."""
        cells, verdict = self.cells, self.verdict
        sizes = {"depth_m": cells.depth, "tvu_m": cells.tvu, "thu_m": cells.thu}
        return {
            "map": str(self.folder.path),
            "order": self.asked,
            "met": self.meets(self.asked),
            "best_order": self.best,
            "sentence": self.sentence,
            "depths_below": self.depths,
            "cell_m": cells.cell,
            "cells": len(cells.depth),
            "hole_cells": int(verdict.holes.sum()),
            "coverage": verdict.coverage,
            "soundings": int(cells.soundings.sum()),
            **{name: _quantiles(values) for name, values in sizes.items()},
            "terms_m": {name: _quantiles(term) for name, term in cells.terms.items()},
            "orders": {key: {"share": each.share, "met": self.meets(key)} for key, each in self.verdicts.items()},
            "failing": verdict.failing,
            "crossings": asdict(self.crossings),
            "warnings": self.warnings,
        }


def _quantiles(values: np.ndarray) -> Mapping[str, float]:
    return dict(zip(("p5", "median", "p95"), np.quantile(values, (0.05, 0.5, 0.95)).tolist(), strict=True))


def sheet_of(folder: Map, asked: str, cell: float | None, datum: tuple[float, float]) -> Sheet:
    """The acceptance sheet of a map's largest part.

    Args:
        asked: key of an order in ORDERS.
        cell: edge of the cells [m]; None for the smallest feature that the order asks to detect, or two voxels of the
            map if these are larger.
        datum: standard deviations of errors that all fixes share: of East and of North, and of Up [m].

    Raises:
        InputError: instruments did not measure the map's depth, position, heading or tilt.
    """
    part, here = folder.parts[0], folder.georeference
    missing = [words for words, names in _NEEDED.items() if not all(part.knows(name) for name in names)]
    if missing:
        raise InputError(
            f"the depths and positions of {folder.path} are not known: no prior measures {', '.join(missing)}; map "
            "again with --priors FILE that has them"
        )
    with as_written(folder.path):
        cells = depth_cells(folder, cell or max(ORDERS[asked].feature, default_cell(folder.voxel)), datum)
        crossings = crossing_check(folder)
    verdicts = {key: Verdict.of(order, cells) for key, order in ORDERS.items()}
    depths = "the zero of the navigation's depths" if here is None else VERTICALS[here.vertical]
    return Sheet(folder, asked, verdicts, crossings, depths)
