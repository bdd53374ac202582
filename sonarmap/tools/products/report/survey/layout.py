# pyright: strict
"""How a map is divided over the panels of a sheet, all to one scale."""

from dataclasses import dataclass

import numpy as np

_WIDEST, _TALLEST = 8.0, 9.0  # of all panels of a map together [in]
_LOWEST = 3.0  # of all panels together [in]
_GAP = (0.75, 0.42)  # between strips [in]: room for their numbers
_BESIDE, _BELOW = 0.25, 0.85  # between two maps, whose numbers are written once; room for a title [in]
_LONG = 2.5  # a map this many times longer than wide is cut into strips
_STRIPS = 6
_MARGIN, _NARROW = 0.03, 0.25  # around what is shown [longer side], but no more than this [shorter side],
_LEAST = 0.01  # and no less than this, for the marks of start and end [longer side]
_SMALLEST = 0.5  # side of a map [m]
_CELLS = 40  # into which the longer side is divided to look for strays
_SPARSE = 0.1  # cells with fewer points than this hold strays [those in the cell of a usual point]


@dataclass(frozen=True, slots=True)
class Layout:
    """windows: (rows, columns, 2, 2) [m]: of each panel its lower left and upper right corner, the upper row first.
    scale: [in/m].
    gap: between columns and between rows [in]."""

    windows: np.ndarray
    scale: float
    gap: tuple[float, float] = _GAP

    @property
    def panel(self) -> tuple[float, float]:
        """Width and height of a panel [in]."""
        width, height = (self.windows[0, 0, 1] - self.windows[0, 0, 0]).tolist()
        return width * self.scale, height * self.scale

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of all panels, with the gaps between them [in]."""
        rows, columns = self.windows.shape[:2]
        width, height = self.panel
        return columns * width + (columns - 1) * self.gap[0], rows * height + (rows - 1) * self.gap[1]

    @property
    def strips(self) -> list[str]:
        """That the map is cut into strips, and in which order they follow each other, in a sentence; none if not."""
        rows, columns = self.windows.shape[:2]
        order = "top to bottom, each the next piece from left to right" if rows > 1 else ""
        order = "left to right, each the next piece from bottom to top" if columns > 1 else order
        return [f"The map is cut into {rows * columns} strips, in order from {order}."] if order else []

    def place(self, row: int, column: int) -> tuple[float, float]:
        """A panel's left and lower side, from the lower left corner of all [in]."""
        width, height = self.panel
        return column * (width + self.gap[0]), (self.windows.shape[0] - 1 - row) * (height + self.gap[1])


def extent_of(points: list[np.ndarray], tracks: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(2,) lower and upper corner [m] of what is worth showing of clouds (M, 2) and of tracks (n, 2): all of these, and
    of the clouds all but single points far from the others."""
    cloud, whole = np.concatenate(points), np.concatenate(tracks)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    cell = max(float((high - low).max()) / _CELLS, 1e-6)
    columns, rows = np.floor((cloud - low) / cell).astype(np.int64).T
    cells = columns * (_CELLS + 1) + rows
    counts = np.bincount(cells)[cells]
    dense = cloud[counts >= _SPARSE * np.median(counts)]
    lower, upper = np.minimum(dense.min(axis=0), whole.min(axis=0)), np.maximum(dense.max(axis=0), whole.max(axis=0))
    size = np.maximum(upper - lower, _SMALLEST)
    margin = max(min(_MARGIN * size.max(), _NARROW * size.min()), _LEAST * size.max())
    return lower - margin, upper + margin


def layout(lower: np.ndarray, upper: np.ndarray) -> Layout:
    """A map from corner to corner (2,) [m] on one panel, or in strips where it is long and narrow."""
    size = upper - lower
    along = int(np.argmax(size))
    room = np.array([_WIDEST, _TALLEST])
    strips = 1
    if size[along] > _LONG * size[1 - along]:
        strips = max(range(1, _STRIPS + 1), key=lambda count: _scale(size, along, count, room))
    parts = np.ones(2)
    parts[1 - along] = strips  # strips lie across the longer side
    span = size.copy()
    span[along] /= strips
    scale = _scale(size, along, strips, room)
    gaps = (parts - 1) * _GAP
    span = np.maximum(span, (np.array([_WIDEST, _LOWEST]) - gaps) / parts / scale)
    columns, rows = parts.astype(int).tolist()
    middle = (lower + upper) / 2
    windows = np.empty((rows, columns, 2, 2))
    for k in range(strips):
        center = middle.copy()
        center[along] += (k - (strips - 1) / 2) * size[along] / strips
        windows[(k, 0) if along == 0 else (0, k)] = center - span / 2, center + span / 2
    return Layout(windows, scale)


def twice(lower: np.ndarray, upper: np.ndarray) -> Layout:
    """The same map on two panels: side by side, or where it is long from left to right one below the other."""
    size = upper - lower
    beside = size[0] <= _LONG * size[1]
    parts, gap = (np.array([2, 1]), (_BESIDE, 0.0)) if beside else (np.array([1, 2]), (0.0, _BELOW))
    room = (np.array([1.5 * _WIDEST, 0.8 * _TALLEST]) - (parts - 1) * gap) / parts
    scale = float((room / size).min())
    span = np.maximum(size, np.array([room[0], _LOWEST / parts[1]]) / scale)
    middle = (lower + upper) / 2
    window = np.stack([middle - span / 2, middle + span / 2])
    return Layout(np.broadcast_to(window, (parts[1], parts[0], 2, 2)), scale, gap)


def _scale(size: np.ndarray, along: int, strips: int, room: np.ndarray) -> float:
    """The largest at which so many strips find room [in/m]."""
    span, parts = size.copy(), np.ones(2)
    span[along] /= strips
    parts[1 - along] = strips
    return float(((room - (parts - 1) * _GAP) / parts / span).min())
