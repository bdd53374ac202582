"""Labels of points in a picture that overlap neither each other nor, as far as there is room, what they explain."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation, Text
    from matplotlib.transforms import BboxBase

_SIDES = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))  # right, above and so on
_ALIGNED = {1: "left", 0: "center", -1: "right"}, {1: "bottom", 0: "center", -1: "top"}
_NOWHERE = np.zeros((0, 2))
_SPACE = 2.0  # between two labels [pixels]
_STEP = 3.0  # between points of a line that are looked at [pixels]
_LED = 9.5  # a label farther from its point than this gets a line to it [points]


def place_labels(
    axes: "Axes",
    places: np.ndarray,
    texts: Sequence[str],
    *,
    covered: np.ndarray | None = None,
    taken: Sequence[tuple[float, float, float, float]] = (),
    distances: Sequence[float] = (5.0, 9.0),
    **style: Any,
) -> list["Annotation"]:
    """Write n texts beside their points (n, 2), in the axes' coordinates, and return the labels that found room:
    earlier ones choose first. They rather do not hide the points `covered` (m, 2), do not touch the boxes `taken`, x0,
    y0, x1, y1 [pixels], and stand at one of the `distances` [points], the preferred first. The figure's size, and the
    axes' place and limits, must be final."""
    pixels = axes.figure.dpi / 72  # of a point
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    # without it each text would make a renderer of its own
    renderer = FigureCanvasAgg(axes.get_figure(root=True)).get_renderer()
    frame, boxes = axes.get_window_extent(), [*map(np.array, taken)]
    hidden = _NOWHERE if covered is None else axes.transData.transform(covered)
    written: list[Annotation] = []
    for place, text in zip(places, texts, strict=True):
        label = axes.annotate(text, place, xytext=(0, 0), textcoords="offset points", annotation_clip=False, **style)
        box = label.get_window_extent(renderer)
        anchor, size = axes.transData.transform(place), np.array([box.width, box.height])
        options: list[tuple[int, float, tuple[int, int], np.ndarray]] = []
        for distance in distances:
            for side in _SIDES:
                corner = anchor + _offset(distance, side) * pixels + size * (np.array(side) - 1) / 2
                box = np.concatenate([corner, corner + size])
                line = _line(anchor, distance * pixels, side) if distance > _LED else _NOWHERE
                if _inside(box, frame) and not _touched(box, boxes) and not _crossed(line, anchor, boxes):
                    options.append((int(_within(hidden, box).sum()), distance, side, box))
        if not options:
            label.remove()
            continue
        _, distance, side, box = min(options, key=lambda option: option[:2])
        label.set(position=_offset(distance, side), ha=_ALIGNED[0][side[0]], va=_ALIGNED[1][side[1]])
        boxes.append(box)
        written.append(label)
        if distance > _LED:
            _lead(axes, label)
            boxes += [np.concatenate([dot, dot]) for dot in _line(anchor, distance * pixels, side)]
    return written


def shrink(text: "Text", width: float) -> None:
    """Make a text of a figure small enough for a width [pixels]."""
    needed = text.get_window_extent().width
    text.set_fontsize(float(text.get_fontsize()) * min(1.0, width / max(needed, 1.0)))


def _offset(distance: float, side: tuple[int, int]) -> np.ndarray:
    return np.array(side) * distance / np.hypot(*side)


def _inside(box: np.ndarray, frame: "BboxBase") -> bool:
    return bool(frame.x0 <= box[0] and box[2] <= frame.x1 and frame.y0 <= box[1] and box[3] <= frame.y1)


def _lead(axes: "Axes", label: "Annotation") -> None:
    """A thin line from the point to its label."""
    line = {"arrowstyle": "-", "linewidth": 0.5, "color": label.get_color(), "shrinkA": 0, "shrinkB": 2}
    place = label.get_position()
    axes.annotate("", label.xy, xytext=place, textcoords="offset points", arrowprops=line)


def _line(anchor: np.ndarray, length: float, side: tuple[int, int]) -> np.ndarray:
    """(k, 2) points [pixels] of the line from a point to its label."""
    return anchor + np.arange(_STEP, length, _STEP)[:, None] * np.array(side) / np.hypot(*side)


def _touched(box: np.ndarray, boxes: Sequence[np.ndarray]) -> bool:
    """Whether a box x0, y0, x1, y1 comes too near to any other."""
    return any((box[:2] - _SPACE < b[2:]).all() and (b[:2] - _SPACE < box[2:]).all() for b in boxes)


def _crossed(line: np.ndarray, anchor: np.ndarray, boxes: Sequence[np.ndarray]) -> bool:
    """Whether a line from a point runs through any box that does not hold the point itself."""
    return bool(len(line)) and any(_within(line, b).any() for b in boxes if not _within(anchor[None], b)[0])


def _within(dots: np.ndarray, box: np.ndarray) -> np.ndarray:
    """(n,) bool: which of dots (n, 2) lie in a box."""
    return np.all((dots >= box[:2] - 1) & (dots <= box[2:] + 1), axis=1)
