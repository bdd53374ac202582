"""Paths through a bridge's openings, clear of everything that the seed drew."""

import numpy as np

from sonarmap.tools.lab.simulate.paths.smooth_path import Path, lane_path, lanes, spline_path
from sonarmap.tools.lab.simulate.scenes.bridge import BridgeLayout, bridge_layout

OFF_PIERS = 34.0  # before and behind the piers with their dolphins, from the bridge's axis [m]
DEPTH = -2.0  # height of the sensor [m]
BEND = 8.0  # from where a turn between two lanes begins to its corner [m]


def under_the_bridge(seed: int) -> Path:
    """Downstream through one of the two widest openings and back through the other, with a turn on either side."""
    layout = bridge_layout(seed)
    south, north = sorted(layout.openings[:2])
    middle, there, back = (south + north) / 2, layout.axis_x(south), layout.axis_x(north)
    corners = [
        (there - OFF_PIERS, south, 0),
        (there + OFF_PIERS, south, 15),
        (there + OFF_PIERS + 24, south - 4, 55),
        (90, middle, 110),
        (back + OFF_PIERS + 24, north + 4, 160),
        (back + OFF_PIERS, north, 180),
        (back - OFF_PIERS, north, 195),
        (back - OFF_PIERS - 24, north + 4, 235),
        (-90, middle, 290),
        (there - OFF_PIERS - 24, south - 4, 340),
    ]
    return spline_path(np.array([(x, y, DEPTH, heading) for x, y, heading in corners], float))


def bridge_lawnmower(seed: int) -> Path:
    """The water above the bridge, through an opening, the water below it, and back through another."""
    layout = bridge_layout(seed)
    there, back = layout.openings[:2]
    ends = [layout.axis_x(y) for y in (-46.0, 46.0)]
    before = lanes((-102, -46), (min(ends) - OFF_PIERS, 46), 4, 3, east=False)
    behind = lanes((max(ends) + OFF_PIERS, -46), (102, 46), 4, 2, east=False)
    corners = np.concatenate([before, _through(layout, there), behind, _through(layout, back)[::-1]])
    return lane_path(np.column_stack([corners, np.full(len(corners), DEPTH)]), BEND)


def _through(layout: BridgeLayout, opening: float) -> np.ndarray:
    """Corners (2, 2) before and behind an opening [m]."""
    x = layout.axis_x(opening)
    return np.array([(x - OFF_PIERS, opening), (x + OFF_PIERS, opening)])
