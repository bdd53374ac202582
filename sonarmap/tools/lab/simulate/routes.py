"""Paths through the scenes: closed ones for surveys, lanes that cover a scene, and one past the flood gate."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from sonarmap.tools.lab.simulate.scenes.bridge import bridge_layout
from sonarmap.tools.lab.simulate.scenes.catalog import scene_kind
from sonarmap.tools.lab.simulate.scenes.manifold import manifold_layout
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.scenes.ship import ship_layout
from sonarmap.tools.lab.simulate.scenes.wreck import wreck_layout
from sonarmap.tools.lab.simulate.smooth_path import Path, lane_path, lanes, spline_path

BEDS = ("flatbed", "sandflat", "seabed", "shallow", "rubble")
# In a scene of 256 m
ABOVE = 12.0  # height of the sensor over the highest point [m]
SUBMERGED = 1.0  # least depth of the sensor [m]
RING = (62.0, 50.0)  # half axes of the ring [m]
REACH = (66.0, 56.0)  # half extent of the lanes along x and y [m]
BED_BEND = 13.0  # distance from a corner at which the turn between two lanes begins [m]
CORNERS = 10  # number of corners of the ring
NOSE_DOWN = np.deg2rad(25)  # pitch of a sensor whose fan is level [rad]


def round_the_bed(scene: str, seed: int) -> Path:
    """A ring over the bed; the sensor looks in the direction of travel."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    places = _above(np.column_stack([RING[0] * np.cos(angle), RING[1] * np.sin(angle)]), scene, seed)
    return spline_path(np.column_stack([places, np.rad2deg(angle) + 90.0]), pitch=_pitch(scene))


def over_the_bed(scene: str, seed: int) -> Path:
    """Lanes and tie lines over the middle of the bed."""
    corners = lanes((-REACH[0], -REACH[1]), REACH, 5, 4, east=True)
    return lane_path(_above(corners, scene, seed), scene_kind(scene).scale * BED_BEND, _pitch(scene))


def _above(corners: np.ndarray, scene: str, seed: int) -> np.ndarray:
    """Corners (K, 2) of a scene of 256 m, scaled to this one, above everything and under water: (K, 3) [m]."""
    scale = scene_kind(scene).scale
    return _level(scale * corners, min(_top(scene, seed) + ABOVE * scale, -SUBMERGED * scale))


def _level(corners: np.ndarray, height: float) -> np.ndarray:
    """Corners (K, 2) raised to one height, (K, 3) [m]."""
    return np.column_stack([corners, np.full(len(corners), height)])


def _top(scene: str, seed: int) -> float:
    """Height of the highest point of a scene [m]."""
    return float(build_scene(scene, seed).mesh.vertices[:, 2].max())


def _pitch(scene: str) -> float:
    return float(NOSE_DOWN) if scene_kind(scene).sensor == "sonar3d15" else 0.0


OFF_PIERS = 34.0  # distance from the bridge's axis that clears the piers and their dolphins [m]
DEPTH = -2.0  # height of the sensor [m]
BRIDGE_BEND = 8.0  # as BED_BEND [m]


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
    """Lanes upstream of the bridge, through an opening, lanes downstream, and back through another opening."""
    layout = bridge_layout(seed)
    there, back = layout.openings[:2]
    ends = [layout.axis_x(y) for y in (-46.0, 46.0)]
    before = lanes((-102, -46), (min(ends) - OFF_PIERS, 46), 4, 3, east=False)
    behind = lanes((max(ends) + OFF_PIERS, -46), (102, 46), 4, 2, east=False)
    through = [np.array([(layout.axis_x(y) + side * OFF_PIERS, y) for side in (-1, 1)]) for y in (there, back)]
    corners = np.concatenate([before, through[0], behind, through[1][::-1]])
    return lane_path(_level(corners, DEPTH), BRIDGE_BEND)


# Closed paths through clear water: x, y, z [m] and heading [degrees from x toward y] of each corner
LOOPS = {
    "floodgate": (
        (-90, -40, -2, -10),
        (-56, -60, -2, 22),
        (-22, -56, -2, 52),
        (-14, -22, -2, 28),
        (-22, 8, -2, -16),
        (-56, 14, -2, 14),
        (-84, 8, -2, 40),
        (-98, -24, -2, 14),
    ),
    "harbor": (
        (-64, -62, -2, 20),
        (-22, -42, -2, 50),
        (18, -24, -2, 80),
        (42, 6, -2, 110),
        (46, -26, -2, 70),
        (34, -62, -2, 30),
        (-10, -80, -2, -10),
        (-48, -88, -2, -10),
    ),
    "clutter": (
        (-64, -20, 20, 10),
        (-30, -62, 20, 50),
        (34, -58, 20, 100),
        (66, 4, 20, 170),
        (22, 60, 20, 250),
        (-40, 48, 20, 300),
    ),
    "pool": (
        (-8.5, -2.2, -1.4, 350),
        (-2, -3, -1.1, 5),
        (4, -2.8, -0.75, 15),
        (8.6, -1.2, -0.7, 65),
        (8.4, 1.8, -0.7, 125),
        (3, 3, -0.75, 170),
        (-3, 2.6, -1.1, 190),
        (-8.8, 2.2, -1.5, 235),
        (-9.8, 0, -1.5, 295),
    ),
}

# An open path before the barrier: the southern shore, the piers and gates from near by, the lock, the northern shore
GATE_ROUTE = (
    (-78, -46, -2, -28),
    (-50, -33, -2, -22),
    (-26, -16, -2, -10),
    (-28, 4, -2, 12),
    (-54, 8, -2, 36),
    (-74, 24, -2, 40),
    (-94, 14, -2, 34),
    (-96, -6, -2, 10),
)

FAR_SIGHTED = 30.0  # least range of a sensor that need not be close to the ship [m]


def survey_path(scene: str, seed: int, reach: float = np.inf) -> Path:
    """The closed path of a scene of SCENE_KINDS, nearer to the ship if the sensor's maximum range, `reach` [m], is
    short."""
    close = scene == "ship" and reach < FAR_SIGHTED
    return _close_round_the_ship(seed) if close else SURVEY_PATHS[scene](seed)


def lawnmower_path(scene: str, seed: int, reach: float = np.inf) -> Path:
    """The closed path of lanes and tie lines over `scene`; arguments as those of `survey_path`."""
    close = scene == "ship" and reach < FAR_SIGHTED
    return _under_the_hull(seed) if close else LAWNMOWER_PATHS[scene](seed)


def gate_path() -> Path:
    """The open path that shows the whole flood gate from the river: shore to shore, its gates and lock from near by."""
    return spline_path(np.array(GATE_ROUTE, float), closed=False)


def _ring(
    radii: tuple[float, float], heights: tuple[float, float], heading: float, middle: ArrayLike, pitch: float = 0.0
) -> Path:
    """An ellipse about `middle` (2,), turned by `heading` [rad], its height varying between two; it looks inward."""
    angle = 2 * np.pi * np.arange(10) / 10
    x, y = radii[0] * np.cos(angle), radii[1] * np.sin(angle)
    z = np.mean(heights) + 0.5 * np.ptp(heights) * np.sin(2 * angle)
    facing = np.rad2deg(np.arctan2(-y, -0.55 * x)) + np.rad2deg(heading)
    return spline_path(np.column_stack([_moved(x, y, heading, middle), z, facing]), pitch=pitch)


def _moved(x: np.ndarray, y: np.ndarray, heading: float, middle: ArrayLike) -> np.ndarray:
    """Points (K, 2) of a frame at `middle`, turned by `heading` [rad], in the scene's frame."""
    c, s = np.cos(heading), np.sin(heading)
    return np.column_stack([c * x - s * y, s * x + c * y]) + np.asarray(middle)


def _around_the_ship(seed: int) -> Path:
    """Round the hull some 25 m off it, below and at the depth of its keel."""
    ship = ship_layout(seed)
    return _ring((ship.length / 2 + 24, ship.beam / 2 + 26), (-13.0, -7.0), ship.heading, ship.middle)


def _close_round_the_ship(seed: int) -> Path:
    """Round the hull some 8 m off its sides, looking at them."""
    ship = ship_layout(seed)
    heights = -0.8 * ship.draft, -0.4 * ship.draft
    return _ring((ship.length / 2 + 10, ship.beam / 2 + 8), heights, ship.heading, ship.middle)


def _around_the_manifold(seed: int) -> Path:
    """Round the frame some 5 m off it, nose a little down, above the flowlines."""
    layout = manifold_layout(seed)
    radii, z = (layout.length / 2 + 5, layout.width / 2 + 5.5), layout.middle[2]
    heading = float(layout.R_scene_manifold.as_euler("ZYX")[0])
    return _ring(radii, (z + 3.2, z + 4.4), heading, layout.middle[:2], np.deg2rad(12))


def _around_the_wreck(seed: int) -> Path:
    """Round all parts of the wreck, above everything, nose down."""
    layout, height = wreck_layout(seed), _over_the_wreck(seed)
    middle = np.mean([part.middle for part in layout.parts], axis=0)
    radii = 0.62 * layout.hulk.length + 20, 44.0
    return _ring(radii, (height, height + 1.0), layout.heading, middle, np.deg2rad(25))


def _over_the_wreck(seed: int) -> float:
    """A height above the wreck and the rocks, at most 9 m under the water [m]."""
    return max(-9.0, _top("wreck", seed) + 4.5)


def _under_the_hull(seed: int) -> Path:
    """Lanes 5 m under the bottom, looking up at it, where there is bottom ahead even in the turns."""
    ship = ship_layout(seed)
    x, y = 0.32 * ship.length, 0.2 * ship.beam
    along, across = lanes((-x, -y), (x, y), 4, 4, east=True).T
    corners = _moved(along, across, ship.heading, ship.middle)
    return lane_path(_level(corners, -ship.draft - 5.0), 1.0, -np.deg2rad(50))


def _gate_lawnmower(seed: int) -> Path:
    """Lanes before the barrier, through the raised gate, lanes behind the barrier, and back through the gate."""
    before = lanes((-92, -34), (-14, 12), 5, 3, east=False)
    behind = lanes((46, -38), (94, 14), 4, 2, east=False)
    way_in, way_out = np.array([(-14, 2.5), (38, 2.5)]), np.array([(38, 1.5), (-14, 1.5), (-60, -10)])
    return lane_path(_level(np.concatenate([before, way_in, behind, way_out]), -2.0), 11.0)


def _harbor_lawnmower(seed: int) -> Path:
    """Lanes in the south and in the east of the basin, clear of the ship and the jetty's head."""
    south = lanes((-62, -80), (44, -50), 3, 3, east=True)
    east = lanes((26, -26), (78, 26), 4, 3, east=False)
    return lane_path(_level(np.concatenate([south, east, [(48, -36), (26, -58)]]), -2.0), 8.0)


def _over_the_manifold(seed: int) -> float:
    """A height above the frame and its guide post [m]."""
    layout = manifold_layout(seed)
    return layout.middle[2] + layout.height + 2.6


def _over(
    reach: tuple[float, float], height: Callable[[int], float], bend: float, pitch: float = 0.0
) -> Callable[[int], Path]:
    """Five lanes and four tie lines over the middle of a scene, with half extents `reach` [m]."""
    corners = lanes((-reach[0], -reach[1]), reach, 5, 4, east=True)
    return lambda seed: lane_path(_level(corners, height(seed)), bend, pitch)


SURVEY_PATHS: Mapping[str, Callable[[int], Path]] = {
    **{name: lambda seed, corners=corners: spline_path(np.array(corners, float)) for name, corners in LOOPS.items()},
    **{name: partial(round_the_bed, name) for name in BEDS},
    "ship": _around_the_ship,
    "manifold": _around_the_manifold,
    "bridge": under_the_bridge,
    "wreck": _around_the_wreck,
}
LAWNMOWER_PATHS: Mapping[str, Callable[[int], Path]] = {
    **{name: partial(over_the_bed, name) for name in BEDS},
    "floodgate": _gate_lawnmower,
    "harbor": _harbor_lawnmower,
    "clutter": _over((66, 56), lambda seed: _top("clutter", seed) + 8.0, 13.0),
    "ship": _over((62, 46), lambda seed: -15.5, 11.0),  # between the keel and the bed
    "pool": lambda seed: lane_path(_level(lanes((-10, -4.2), (9, 4.2), 5, 4, east=True), -0.7), 1.0),
    "manifold": _over((10, 9), _over_the_manifold, 2.0, np.deg2rad(40)),  # so that the bed is in range
    "bridge": bridge_lawnmower,
    "wreck": _over((72, 60), _over_the_wreck, 12.0, np.deg2rad(30)),
}
