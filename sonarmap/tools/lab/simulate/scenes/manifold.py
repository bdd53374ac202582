"""A subsea manifold: a tubular frame on a mudmat, headers with branches and valves, flowlines leaving over the bed."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import SCENE_EDGE, boulders, height_at, relief, scene_of
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, ellipsoid, merge, tube

BED_DEPTH = -40.0
SCALE = SCENE_KINDS["manifold"].scale  # of the bed, relative to the scenes of 256 m
TUBE_RADIUS = 0.16  # of the frame's chords and posts [m]


@dataclass(frozen=True, slots=True)
class ManifoldLayout:
    """Pose and size of a manifold; in its frame, x is along the headers and z = 0 is the mudmat's top."""

    middle: tuple[float, float, float]  # x, y and z of the middle of the mudmat's top [m]
    R_scene_manifold: Rotation  # its heading, and its settling into the bed by up to 1.5 degrees
    length: float  # of the frame [m]
    width: float  # [m]
    height: float  # [m]
    bays: int  # number of the frame's bays along its length

    def place(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) [m] in the manifold's frame, moved to the scene's frame."""
        return self.R_scene_manifold.apply(np.reshape(points, (-1, 3))).reshape(np.shape(points)) + self.middle


def manifold_layout(seed: int) -> ManifoldLayout:
    """The manifold of `seed`: about 12 by 8 by 5 m, within 1.5 m of the middle, on any heading."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 25]))
    heading, settled = rng.uniform(-np.pi, np.pi), rng.uniform(-0.026, 0.026, 2)
    return ManifoldLayout(
        middle=(*rng.uniform(-1.5, 1.5, 2), BED_DEPTH + 0.35),
        R_scene_manifold=Rotation.from_euler("ZYX", (heading, *settled)),
        length=rng.uniform(11.0, 13.0),
        width=rng.uniform(7.2, 8.6),
        height=rng.uniform(4.4, 5.2),
        bays=int(rng.integers(3, 5)),
    )


def manifold(seed: int) -> Mesh:
    """The scene from `seed`, 48 m on a side, its bed about 40 m under the water's surface at z = 0."""
    layout = manifold_layout(seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 26]))
    # the bed of the large scenes, scaled down in all three directions, with less relief
    height = 0.6 * relief(rng)
    # the mudmat was set down where no stones lay
    stones = [stone for stone in boulders(height, 110, rng) if np.hypot(*stone.vertices.mean(axis=0)[:2]) > 11 / SCALE]
    bed = scene_of(height, stones)
    ground = Mesh(SCALE * bed.vertices + np.array((0, 0, BED_DEPTH)), bed.triangles)
    headers = _headers(layout, rng)
    built = merge([*_frame(layout, rng), *_mudmat(layout), *_piping(layout, headers, rng)])
    lines = _flowlines(layout, headers, height, rng)
    return merge([ground, Mesh(layout.place(built.vertices), built.triangles), *lines])


def _headers(frame: ManifoldLayout, rng: np.random.Generator) -> list[np.ndarray]:
    """The two headers that run through the frame: y, z and radius of each [m], one lower than the other."""
    lower = rng.uniform((-0.16 * frame.width, 1.5, 0.28), (-0.1 * frame.width, 1.9, 0.4))
    return [lower, rng.uniform((0.1 * frame.width, 2.3, 0.28), (0.16 * frame.width, 2.8, 0.4))]


def _frame(frame: ManifoldLayout, rng: np.random.Generator) -> list[Mesh]:
    """Posts, three storeys of chords, cross beams over the top, a diagonal in some of the bays."""
    stations = np.linspace(-frame.length / 2, frame.length / 2, frame.bays + 1)
    half, top = frame.width / 2, frame.height
    parts = []
    for side in (-half, half):
        for level in (0.2, top):
            parts.append(cylinder((stations[0], side, level), (stations[-1], side, level), TUBE_RADIUS, sides=12))
        parts += [cylinder((east, side, -0.3), (east, side, top), TUBE_RADIUS, sides=12) for east in stations]
        for bay in np.flatnonzero(rng.random(frame.bays) < 0.6):
            low, high = (stations[bay], stations[bay + 1]) if rng.random() < 0.5 else (stations[bay + 1], stations[bay])
            parts.append(cylinder((low, side, 0.2), (high, side, top), 0.1, sides=12))
    for number, east in enumerate(stations):
        parts.append(cylinder((east, -half, top), (east, half, top), TUBE_RADIUS, sides=12))
        if number in (0, frame.bays):
            parts.append(cylinder((east, -half, 0.2), (east, half, 0.2), TUBE_RADIUS, sides=12))
            parts.append(cylinder((east, -half, 0.2), (east, half, top), 0.1, sides=12))
    return [*parts, *_lifting_points(frame)]


def _lifting_points(frame: ManifoldLayout) -> list[Mesh]:
    """A padeye on every corner of the frame's top, and a guide post higher than the rest at one of them."""
    corners = [(x * frame.length / 2, y * frame.width / 2) for x in (-1, 1) for y in (-1, 1)]
    eyes = [box((*corner, frame.height + 0.3), (0.6, 0.12, 0.5)) for corner in corners]
    east, north = corners[3]
    return [*eyes, cylinder((east - 0.5, north, frame.height), (east - 0.5, north, frame.height + 1.2), 0.12, sides=12)]


def _mudmat(frame: ManifoldLayout) -> list[Mesh]:
    """A slab somewhat larger than the frame, with a skirt, and a beam under every row of posts."""
    long, wide = frame.length + 1.6, frame.width + 1.4
    skirt = [box((side * long / 2, 0, -0.5), (0.1, wide, 1.0)) for side in (-1, 1)]
    skirt += [box((0, side * wide / 2, -0.5), (long, 0.1, 1.0)) for side in (-1, 1)]
    beams = [box((0, side * frame.width / 2, 0.1), (long - 0.4, 0.4, 0.2)) for side in (-1, 1)]
    return [box((0, 0, -0.1), (long, wide, 0.2)), *skirt, *beams]


def _piping(frame: ManifoldLayout, headers: list[np.ndarray], rng: np.random.Generator) -> list[Mesh]:
    """The headers with flanges and supports, and branches with valves down to hubs on the long sides."""
    parts, reach = [], frame.length / 2 + 0.3
    for side, (north, level, radius) in zip((-1, 1), headers, strict=True):
        parts.append(cylinder((-reach, north, level), (reach, north, level), radius))
        for x in (-reach, rng.uniform(-3, 3), reach):
            parts.append(cylinder((x - 0.1, north, level), (x + 0.1, north, level), 1.5 * radius))
        for x in (-0.35 * frame.length, 0.3 * frame.length):
            parts.append(cylinder((x, north, 0), (x, north, level), 0.12, sides=12))
        count = int(rng.integers(3, 6))
        spots = (np.arange(count) + rng.uniform(0.25, 0.75, count)) / count - 0.5
        for east in 0.86 * frame.length * spots:
            parts += _branch(np.array((east, north, level)), side, frame, rng)
    return parts


def _branch(root: np.ndarray, side: int, frame: ManifoldLayout, rng: np.random.Generator) -> list[Mesh]:
    """A pipe up from the header and over to the side, bent down to a hub, with a valve and its actuator."""
    radius, rise = rng.uniform(0.11, 0.17), rng.uniform(0.7, 1.3)
    out = side * (frame.width / 2 - rng.uniform(0.3, 0.6))
    over = root + np.array((0, 0, rise))
    down = np.array((root[0], out, over[2]))
    hub = np.array((root[0], out, rng.uniform(0.6, 1.0)))
    valve = over + rng.uniform(0.4, 0.6) * (down - over)
    parts = [
        tube([root, over, down, hub], radius, bend=0.35),
        cylinder(hub - np.array((0, 0, 0.25)), hub + np.array((0, 0, 0.15)), 2.2 * radius),
        cylinder(hub, (*hub[:2], 0), radius),
        box(valve, (0.55, 0.7, 0.55)),
    ]
    # a wheel on a stem, or an actuator's drum
    if rng.random() < 0.5:
        parts.append(cylinder(valve, valve + np.array((0, 0, 0.75)), 0.06, sides=12))
        parts.append(cylinder(valve + np.array((0, 0, 0.7)), valve + np.array((0, 0, 0.76)), 0.3))
    else:
        parts.append(cylinder(valve, valve + np.array((0, 0, rng.uniform(0.8, 1.1))), rng.uniform(0.16, 0.24)))
    return parts


def _flowlines(
    frame: ManifoldLayout, headers: list[np.ndarray], height: np.ndarray, rng: np.random.Generator
) -> list[Mesh]:
    """Pipes from both ends of the headers down to the bed, lying on it to the scene's edge; a block and a float."""
    parts = []
    for end in (-1, 1):
        for side, (north, level, radius) in zip((-1, 1), headers, strict=True):
            flange = np.array((end * (frame.length / 2 + 0.3), north, level))
            corners = frame.place(np.array([flange, flange + np.array((end * rng.uniform(0.9, 1.3), 0, 0))]))
            away = frame.R_scene_manifold.apply((end, side * rng.uniform(0.1, 0.6), 0))[:2]
            lying = _on_bed(corners[1, :2], away, rng.uniform(-0.02, 0.02), height)
            parts.append(tube([*corners, *lying], 0.6 * radius, bend=0.5))
    block = frame.place(np.array((0.2 * frame.length, -frame.width / 2 - rng.uniform(2.5, 3.5), 0.1)))
    buoy = block + np.array((1.6, 0.7, 1.4))
    line = cylinder(block, buoy, 0.04, sides=8)
    return [*parts, box(block, (1.4, 1.0, 0.9)), ellipsoid(buoy, (0.5, 0.5, 0.6)), line]


def _on_bed(start: np.ndarray, away: np.ndarray, turn: float, height: np.ndarray) -> list[np.ndarray]:
    """Corners of a flowline on the bed, 1.5 m apart, each turned by `turn` [rad], up to the edge of the bed."""
    heading = np.arctan2(away[1], away[0])
    place, corners = start + 1.5 * away / np.hypot(*away), []
    limit = SCALE * SCENE_EDGE / 2 - 1.0
    while True:
        place = place + 1.5 * np.array((np.cos(heading), np.sin(heading)))
        if np.abs(place).max() > limit:
            return corners
        corners.append(np.array((*place, BED_DEPTH + SCALE * height_at(height, *(place / SCALE)) + 0.12)))
        heading += turn
