"""The paths laid through each scene: closed ones to survey it, lanes to cover it, one before and behind the gate."""

from collections.abc import Callable
from functools import partial
from types import MappingProxyType

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.paths.smooth_path import Path, lane_path, lanes, spline_path
from sonarmap.tools.lab.simulate.scenes.bridge import BridgeLayout, bridge_layout
from sonarmap.tools.lab.simulate.scenes.catalog import scene_kind
from sonarmap.tools.lab.simulate.scenes.manifold import manifold_layout
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.scenes.ship import ship_layout
from sonarmap.tools.lab.simulate.scenes.wreck import wreck_layout

BEDS = ("flatbed", "sandflat", "seabed", "shallow", "rubble")
# In a scene of 256 m
ABOVE = 12.0  # of the sensor over the highest thing [m]
SUBMERGED = 1.0  # at least [m]
RING = (62.0, 50.0)  # half axes of the ring [m]
REACH = (66.0, 56.0)  # of the lanes to either side of the middle [m]
BED_BEND = 13.0  # from where a turn between two lanes begins to its corner [m]
CORNERS = 10  # of the ring
NOSE_DOWN = np.deg2rad(25)  # of a sensor whose fan is level


def round_the_bed(scene: str, seed: int) -> Path:
    """A ring whose heading is that of travel."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    places = _placed(np.column_stack([RING[0] * np.cos(angle), RING[1] * np.sin(angle)]), scene, seed)
    return spline_path(np.column_stack([places, np.rad2deg(angle) + 90.0]), pitch=_pitch(scene))


def over_the_bed(scene: str, seed: int) -> Path:
    """Lanes and tie lines over the middle of the bed."""
    corners = lanes((-REACH[0], -REACH[1]), REACH, 5, 4, east=True)
    return lane_path(_placed(corners, scene, seed), scene_kind(scene).scale * BED_BEND, _pitch(scene))


def _placed(corners: np.ndarray, scene: str, seed: int) -> np.ndarray:
    """Corners (K, 2) of a scene of 256 m in this one's size, above everything and under the water, (K, 3) [m]."""
    scale = scene_kind(scene).scale
    top = float(build_scene(scene, seed).mesh.vertices[:, 2].max())
    return np.column_stack([scale * corners, np.full(len(corners), min(top + ABOVE * scale, -SUBMERGED * scale))])


def _pitch(scene: str) -> float:
    return float(NOSE_DOWN) if scene_kind(scene).sensor == "sonar3d15" else 0.0


OFF_PIERS = 34.0  # before and behind the piers with their dolphins, from the bridge's axis [m]
DEPTH = -2.0  # height of the sensor [m]
BRIDGE_BEND = 8.0  # from where a turn between two lanes begins to its corner [m]


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
    return lane_path(np.column_stack([corners, np.full(len(corners), DEPTH)]), BRIDGE_BEND)


def _through(layout: BridgeLayout, opening: float) -> np.ndarray:
    """Corners (2, 2) before and behind an opening [m]."""
    x = layout.axis_x(opening)
    return np.array([(x - OFF_PIERS, opening), (x + OFF_PIERS, opening)])


# Closed paths through clear water: x, y, z [m] and heading [degrees from x toward y] of each corner
SURVEY_LOOPS = MappingProxyType(
    {
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
)

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


# A sensor that sees less far than this is short of sight [m].
FAR_SIGHTED = 30.0


def survey_path(scene: str, seed: int, reach: float = np.inf) -> Path:
    """The closed path of `scene`; round the ship and the manifold it follows their layout.

    Raises InputError: a scene without a path.

    Args:
        scene, seed: as `build_scene` takes them.
        reach: the sensor's greatest range [m]; a short one is carried nearer to the ship.
    """
    if scene == "ship" and reach < FAR_SIGHTED:
        return _close_round_the_ship(seed)
    if scene in SURVEY_LOOPS:
        return spline_path(np.array(SURVEY_LOOPS[scene], float))
    return _path_of(SURVEY_PATHS, scene, "survey path")(seed)


def lawnmower_path(scene: str, seed: int, reach: float = np.inf) -> Path:
    """The closed path of lanes and tie lines over `scene`; arguments as those of `survey_path`. Raises InputError: a
    scene without lanes."""
    if scene == "ship" and reach < FAR_SIGHTED:
        return _under_the_hull(seed)
    return _path_of(LAWNMOWER_PATHS, scene, "lawnmower's path")(seed)


def gate_path() -> Path:
    """The open path that shows the whole flood gate from the river: shore to shore, its gates and lock from near by."""
    return spline_path(np.array(GATE_ROUTE, float), closed=False)


def _path_of(table: MappingProxyType[str, Callable[[int], Path]], scene: str, what: str) -> Callable[[int], Path]:
    if scene not in table:
        known = [*SURVEY_LOOPS, *SURVEY_PATHS] if table is SURVEY_PATHS else table
        raise InputError(f"no {what} is laid through {scene!r}; there are {', '.join(known)}")
    return table[scene]


def _round(radii: tuple[float, float], depths: tuple[float, float], count: int = 10) -> np.ndarray:
    """Corners (K, 4) of an ellipse that looks inward, up and down between two heights, about the origin."""
    angle = 2 * np.pi * np.arange(count) / count
    x, y = radii[0] * np.cos(angle), radii[1] * np.sin(angle)
    z = np.mean(depths) + 0.5 * np.ptp(depths) * np.sin(2 * angle)
    return np.column_stack([x, y, z, np.rad2deg(np.arctan2(-y, -0.55 * x))])


def _around_the_ship(seed: int) -> Path:
    """Round the hull some 25 m off it, below and at the depth of its keel."""
    ship = ship_layout(seed)
    corners = _round((ship.length / 2 + 24, ship.beam / 2 + 26), (-13.0, -7.0))
    return spline_path(_moved(corners, ship.heading, ship.middle))


def _close_round_the_ship(seed: int) -> Path:
    """Round the hull some 8 m off its sides, looking at them."""
    ship = ship_layout(seed)
    corners = _round((ship.length / 2 + 10, ship.beam / 2 + 8), (-0.8 * ship.draft, -0.4 * ship.draft))
    return spline_path(_moved(corners, ship.heading, ship.middle))


def _under_the_hull(seed: int) -> Path:
    """Lanes 5 m under the bottom, looking up at it, where there is bottom ahead even in the turns."""
    ship = ship_layout(seed)
    x, y = 0.32 * ship.length, 0.2 * ship.beam
    corners = lanes((-x, -y), (x, y), 4, 4, east=True)
    placed = _moved(np.column_stack([corners, np.zeros((len(corners), 2))]), ship.heading, ship.middle)
    return _lane_path(placed[:, :2], -ship.draft - 5.0, 1.0, -np.deg2rad(50))


def _around_the_manifold(seed: int) -> Path:
    """Round the frame some 5 m off it, nose a little down, above the flowlines."""
    layout = manifold_layout(seed)
    middle_z = layout.middle[2]
    corners = _round((layout.length / 2 + 5, layout.width / 2 + 5.5), (middle_z + 3.2, middle_z + 4.4))
    heading = float(layout.R_scene_manifold.as_euler("ZYX")[0])
    return spline_path(_moved(corners, heading, layout.middle[:2]), pitch=np.deg2rad(12))


def _around_the_wreck(seed: int) -> Path:
    """Round all of its parts, above everything, nose down."""
    layout = wreck_layout(seed)
    middle = np.mean([part.middle for part in layout.parts], axis=0)
    height = _over_the_wreck(seed)
    corners = _round((0.62 * layout.hulk.length + 20, 44.0), (height, height + 1.0))
    placed = _moved(corners, layout.heading, (float(middle[0]), float(middle[1])))
    return spline_path(placed, pitch=np.deg2rad(25))


def _over_the_wreck(seed: int) -> float:
    """A height clear of the wreck and the rocks, 9 m under the water or less [m]."""
    return max(-9.0, float(build_scene("wreck", seed).mesh.vertices[:, 2].max()) + 4.5)


def _moved(corners: np.ndarray, heading: float, middle: tuple[float, float]) -> np.ndarray:
    """Corners (K, 4) of a thing's frame in the scene's."""
    (c, s), (x, y) = (np.cos(heading), np.sin(heading)), corners[:, :2].T
    placed = np.column_stack([c * x - s * y, s * x + c * y]) + middle
    return np.column_stack([placed, corners[:, 2], corners[:, 3] + np.rad2deg(heading)])


def _lane_path(corners: np.ndarray, height: float, bend: float, pitch: float = 0.0) -> Path:
    return lane_path(np.column_stack([corners, np.full(len(corners), height)]), bend, pitch)


def _gate_lawnmower(seed: int) -> Path:
    """The water before the barrier, through the raised gate, the water behind it, and back through the gate."""
    before = lanes((-92, -34), (-14, 12), 5, 3, east=False)
    behind = lanes((46, -38), (94, 14), 4, 2, east=False)
    way_in, way_out = np.array([(-14, 2.5), (38, 2.5)]), np.array([(38, 1.5), (-14, 1.5), (-60, -10)])
    return _lane_path(np.concatenate([before, way_in, behind, way_out]), -2.0, 11.0)


def _harbor_lawnmower(seed: int) -> Path:
    """The southern water and the eastern one before the ship and the jetty's head."""
    south = lanes((-62, -80), (44, -50), 3, 3, east=True)
    east = lanes((26, -26), (78, 26), 4, 3, east=False)
    way_back = np.array([(48, -36), (26, -58)])
    return _lane_path(np.concatenate([south, east, way_back]), -2.0, 8.0)


def _clutter_lawnmower(seed: int) -> Path:
    """Over everything that stands there."""
    top = float(build_scene("clutter", seed).mesh.vertices[:, 2].max())
    return _lane_path(lanes((-66, -56), (66, 56), 5, 4, east=True), top + 8.0, 13.0)


def _ship_lawnmower(seed: int) -> Path:
    """Between the keel and the bed."""
    return _lane_path(lanes((-62, -46), (62, 46), 5, 4, east=True), -15.5, 11.0)


def _pool_lawnmower(seed: int) -> Path:
    return _lane_path(lanes((-10, -4.2), (9, 4.2), 5, 4, east=True), -0.7, 1.0)


def _manifold_lawnmower(seed: int) -> Path:
    """Over the frame and its guide post, nose down, so that the bed is in reach."""
    layout = manifold_layout(seed)
    corners = lanes((-10, -9), (10, 9), 5, 4, east=True)
    return _lane_path(corners, layout.middle[2] + layout.height + 2.6, 2.0, np.deg2rad(40))


def _wreck_lawnmower(seed: int) -> Path:
    """Over the wreck and the rocks about it, nose down."""
    return _lane_path(lanes((-72, -60), (72, 60), 5, 4, east=True), _over_the_wreck(seed), 12.0, np.deg2rad(30))


SURVEY_PATHS: MappingProxyType[str, Callable[[int], Path]] = MappingProxyType(
    {
        **{name: partial(round_the_bed, name) for name in BEDS},
        "ship": _around_the_ship,
        "manifold": _around_the_manifold,
        "bridge": under_the_bridge,
        "wreck": _around_the_wreck,
    }
)
LAWNMOWER_PATHS: MappingProxyType[str, Callable[[int], Path]] = MappingProxyType(
    {
        **{name: partial(over_the_bed, name) for name in BEDS},
        "floodgate": _gate_lawnmower,
        "harbor": _harbor_lawnmower,
        "clutter": _clutter_lawnmower,
        "ship": _ship_lawnmower,
        "pool": _pool_lawnmower,
        "manifold": _manifold_lawnmower,
        "bridge": bridge_lawnmower,
        "wreck": _wreck_lawnmower,
    }
)
