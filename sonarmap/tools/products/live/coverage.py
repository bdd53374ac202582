# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
"""The plan of what was seen how often: where to go next, and what would be left out."""

import json
from base64 import b64encode
from collections.abc import Sequence
from io import BytesIO

import numpy as np
from PIL import Image
from scipy import ndimage

from sonarmap.tools.products.live.messages import Message

_SEEN = (  # color, words: of kinds 1 to 4
    ("#0072b2", "4 times or more"),
    ("#56b4e9", "2 or 3 times"),
    ("#e69f00", "once"),
    ("#d55e00", "holes, never seen"),
)
_LEAST_HOLE = 4  # cells: smaller gaps lie between beams
_MOST_ACROSS = 1000  # cells; beyond it they are made coarser
_STRAY = 0.001  # share of the cells at each side that may lie far out


def coverage(seen: Sequence[np.ndarray], cell: float, part: int) -> Message:
    """How often the plan of a part was seen.

    Args:
        seen: of each of its key scans the points, (n, 2) [m, the part's frame].
        cell: edge of a cell [m].
        part: its number.
    """
    counts, corner, cell = _counted(seen, cell)
    kinds = np.select([counts >= 4, counts >= 2, counts == 1, _holes(counts == 0)], [1, 2, 3, 4]).astype(np.uint8)
    image = Image.fromarray(kinds[::-1])  # y up
    image.putpalette(bytes(3) + b"".join(bytes.fromhex(color[1:]) for color, _ in _SEEN))
    file = BytesIO()
    image.save(file, "png", transparency=0)
    areas = np.bincount(kinds.ravel(), minlength=5)[1:] * cell**2
    legend = [[color, words, float(area)] for (color, words), area in zip(_SEEN, areas, strict=True)]
    content = {"kind": "coverage", "part": part, "corner": corner, "size": [cell * n for n in kinds.shape[::-1]]}
    picture = "data:image/png;base64," + b64encode(file.getvalue()).decode()
    return f"coverage {part}", json.dumps({**content, "legend": legend, "picture": picture}, allow_nan=False)


def _counted(seen: Sequence[np.ndarray], cell: float) -> tuple[np.ndarray, list[float], float]:
    """Counts (height, width) row by row from the smallest y on, the smallest x and y [m], and the edge of a cell."""
    cells = np.concatenate([_cells(points, cell) for points in seen])
    if not len(cells):
        return np.zeros((1, 1), int), [0.0, 0.0], cell
    low, high = np.quantile(cells, [_STRAY, 1 - _STRAY], axis=0).astype(int)
    if (high - low).max() >= _MOST_ACROSS:
        return _counted(seen, 2 * cell)
    counts = np.zeros((high - low + 1)[::-1], int)
    x, y = (cells[((cells >= low) & (cells <= high)).all(axis=1)] - low).T
    np.add.at(counts, (y, x), 1)
    return counts, (low * cell).tolist(), cell


def _cells(points: np.ndarray, cell: float) -> np.ndarray:
    """(n, 2) those in which a scan has points; a single one may be a stray echo."""
    cells, counts = np.unique(np.floor(points / cell).astype(int), axis=0, return_counts=True)
    return cells[counts > 1]


def _holes(empty: np.ndarray) -> np.ndarray:
    """The cells that were never seen, but lie within what was."""
    inside = empty & ndimage.binary_fill_holes(~empty)
    labels = np.zeros(empty.shape, np.int32)
    ndimage.label(inside, output=labels)
    return inside & (np.bincount(labels.ravel())[labels] >= _LEAST_HOLE)
