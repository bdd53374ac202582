"""A wreck: a hull broken in two or three, open and heeled, on a sea bed with rock ledges, its cargo about it.

The seed determines where she broke, how the parts drifted, heeled and sank in (the bow may lie keel up), the strike of
the ledges, and the spilled cargo.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import boulders, debris, height_at, on_bed, raster, relief, scene_of
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, loft, merge, rod, shell, tube

PLATE = 0.45  # thickness of the skin with its frames [m]
SPACING = 2.2  # between stations [m]
GIRTH = 19  # number of corners of a section from rail to rail


@dataclass(frozen=True, slots=True)
class Hulk:
    """Size of the hull; in its frame, x is to the bow from midships, y to port, and z up from the keel."""

    length: float  # of the hull [m]
    beam: float  # [m]
    depth: float  # from keel to rail [m]

    def half_width(self, along: float) -> float:
        """Half width [m] at the rail, `along` from midships in shares of the length."""
        fine = np.clip(1 - max(along - 0.2, 0) * 2.2, 0.12, 1)
        return 0.5 * self.beam * float(np.clip(1 - abs(2 * along) ** 5, 0.12, 1) * fine)

    def section(self, along: float, inset: float = 0.0) -> np.ndarray:
        """Corners (GIRTH, 3) [m] from the port rail round the keel to starboard, `inset` [m] within the skin."""
        width = self.half_width(along)
        angle = np.linspace(0, np.pi, GIRTH)
        across = max(width - inset, 0.3 * width) * np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.5
        # the bottom rises to the stern and to the bow
        rise = self.depth * (0.5 * np.clip(-along - 0.34, 0, 1) * 5 + 0.3 * np.clip(along - 0.42, 0, 1) * 5)
        deep = (self.depth - rise - inset) * np.sin(angle) ** 0.6
        return np.column_stack([np.full(GIRTH, along * self.length), across, self.depth - deep])


def skin(hulk: Hulk, aft: float, ahead: float, rng: np.random.Generator) -> Mesh:
    """The open shell between two stations: torn where it broke, its sides fallen in or gone here and there."""
    count = max(round((ahead - aft) * hulk.length / SPACING), 4) + 1
    stations = np.linspace(aft, ahead, count)
    outer = np.array([hulk.section(along) for along in stations])
    inner = np.array([hulk.section(along, PLATE) for along in stations])
    for end, broken in ((0, aft > -0.5), (-1, ahead < 0.5)):
        torn = broken * rng.uniform(-0.9, 2.2, GIRTH) * (1 if end else -1)
        outer[end, :, 0] += torn
        inner[end, :, 0] += torn
    for _ in range(int(rng.integers(2, 6))):
        middle, reach, side = rng.uniform(aft, ahead), rng.uniform(0.02, 0.07), rng.choice((-1, 1))
        hit = np.exp(-(((stations - middle) / reach) ** 2))[:, None] * np.clip(side * outer[..., 1], 0, None)
        hit *= 2 / hulk.beam
        down, within = rng.uniform(0.15, 0.55), rng.uniform(-0.12, 0.3)
        for sheet in (outer, inner):
            sheet[..., 1] *= 1 - within * hit
            sheet[..., 2] *= 1 - down * hit
    return shell(outer, inner)


def bulkheads(hulk: Hulk, aft: float, ahead: float, rng: np.random.Generator) -> list[Mesh]:
    """Transverse bulkheads at uneven distances and of different heights."""
    parts, along = [], aft + 0.03
    while along < ahead - 0.02:
        ring = hulk.section(along, 0.5 * PLATE)[::-1]
        ring[:, 2] = np.minimum(ring[:, 2], ring[:, 2].min() + rng.uniform(0.4, 0.95) * np.ptp(ring[:, 2]))
        ring = ring[np.concatenate([[True], np.linalg.norm(np.diff(ring, axis=0), axis=1) > 1e-6])]
        parts.append(loft([ring, ring + np.array((0.4, 0.0, 0.0))]))
        along += rng.uniform(0.06, 0.15)
    return parts


def remains(hulk: Hulk, aft: float, ahead: float, rng: np.random.Generator) -> list[Mesh]:
    """Strips of deck along the rails, a hatch's coaming, deck beams from side to side."""
    parts = []
    for along in np.arange(aft + 0.02, ahead - 0.02, 0.045):
        east, width = along * hulk.length, hulk.half_width(along)
        if rng.random() < 0.55:
            side = rng.choice((-1, 1))
            tilt = Rotation.from_euler("x", side * rng.uniform(-0.1, 0.5))
            size = (0.04 * hulk.length, 0.5 * width, 0.35)
            parts.append(box((east, side * 0.72 * width, hulk.depth * rng.uniform(0.82, 0.97)), size, tilt))
        if rng.random() < 0.5:
            parts.append(box((east, 0, hulk.depth * rng.uniform(0.85, 0.95)), (0.6, 1.9 * width, 0.5)))
    if ahead - aft > 0.2:
        middle = (aft + ahead) / 2 + rng.uniform(-0.04, 0.04)
        for side in (-1, 1):
            across = side * 0.4 * hulk.half_width(middle)
            parts.append(box((middle * hulk.length, across, 1.03 * hulk.depth), (0.1 * hulk.length, 0.4, 1.6)))
    return parts


def gear(hulk: Hulk, rng: np.random.Generator) -> list[Mesh]:
    """Parts of the stern: the deck house with its funnel, an engine, shaft, propeller and rudder."""
    length, depth = hulk.length, hulk.depth
    house = rng.uniform((0.1, 0.6, 3.0), (0.14, 0.8, 4.5)) * (length, hulk.beam, 1.0)
    place = np.array((-0.4 * length, rng.uniform(-0.05, 0.05) * hulk.beam, depth + 0.5 * house[2] - 0.4))
    top = place + np.array((rng.uniform(-0.02, 0.02) * length, 0, 0.4 * house[2]))
    lean = rng.uniform(-0.8, 0.8, 2)
    hub = np.array((-0.5 * length - 0.6, 0.0, 0.34 * depth))
    rudder = Rotation.from_euler("z", rng.uniform(-0.5, 0.5))
    parts = [
        box(place, house, Rotation.from_euler("x", rng.uniform(-0.12, 0.12))),
        box(place + np.array((0.3 * house[0], 0, 0.5 * house[2] + 0.8)), (0.3 * house[0], 0.9 * house[1], 2.0)),
        cylinder(top, top + np.array((*lean, rng.uniform(2.0, 3.5))), rng.uniform(0.9, 1.5)),
        box((-0.33 * length, 0, 0.35 * depth), (0.07 * length, 0.3 * hulk.beam, 0.4 * depth)),
        cylinder(hub, hub + np.array((0.12 * length, 0, 0)), 0.35, 12),
        box(hub - np.array((1.6, 0, -0.05 * depth)), (1.6, 0.35, 0.5 * depth), rudder),
    ]
    first = rng.uniform(0, np.pi)
    for blade in range(4):
        spin = Rotation.from_euler("xz", (first + blade * np.pi / 2, 0.0))
        parts.append(box(hub + spin.apply((0, 0, 0.14 * depth)), (0.3, 0.09 * depth, 0.24 * depth), spin))
    return parts


SCENE_REACH = 118.0  # largest distance of parts from the middle along x and y [m]


@dataclass(frozen=True, slots=True)
class Ledge:
    """A rock outcrop that breaks off toward one side."""

    middle: tuple[float, float]  # x and y [m]
    strike: float  # direction of its edge, from x toward y [rad]
    length: float  # of the edge [m]
    height: float  # of the break [m]
    back: float  # length of the slope behind the edge [m]


@dataclass(frozen=True, slots=True)
class HullPart:
    """Pose of one part of the hull."""

    ends: tuple[float, float]  # of the part along the hull, in shares of its length from midships
    middle: tuple[float, float]  # x and y of its keel's middle [m]
    R_scene_part: Rotation  # its heading, trim and heel
    sunk: float  # depth of its lowest corner in the bed [m]


@dataclass(frozen=True, slots=True)
class WreckLayout:
    """The plan of a wreck."""

    bed: float  # mean height of the sea bed [m]
    slope: tuple[float, float]  # of the bed along x and y
    hulk: Hulk  # the whole hull
    heading: float  # of the sinking ship, from x toward y [rad]
    parts: tuple[HullPart, ...]  # from stern to bow
    ledges: tuple[Ledge, ...]


def wreck_layout(seed: int) -> WreckLayout:
    """The wreck of `seed`: 72 to 112 m long, in two or three parts within some 60 m of the middle."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 29]))
    length = rng.uniform(72.0, 112.0)
    hulk = Hulk(length, beam=length * rng.uniform(0.14, 0.18), depth=length * rng.uniform(0.08, 0.1))
    heading, strike = rng.uniform(-np.pi, np.pi, 2)
    return WreckLayout(
        bed=rng.uniform(-36.0, -31.0),
        slope=tuple(rng.uniform(-0.025, 0.025, 2)),
        hulk=hulk,
        heading=heading,
        parts=_parts(hulk, heading, rng),
        ledges=tuple(_ledge(strike, rng) for _ in range(int(rng.integers(4, 10)))),
    )


def wreck(seed: int) -> Mesh:
    """The scene from `seed`, 256 m on a side, the water's surface at z = 0, its bed at about -31 to -36 m."""
    layout = wreck_layout(seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 30]))
    height = _ground(layout, rng)
    loose = boulders(height, int(rng.integers(40, 130)), rng) + debris(height, int(rng.integers(10, 40)), rng)
    parts = [mesh for part in layout.parts for mesh in _laid(layout, part, height, rng)]
    strewn = [lay(layout, height, rng) for lay in (_slabs, _spilled, _rigging)]
    return scene_of(height, parts, *strewn, loose)


def _parts(hulk: Hulk, heading: float, rng: np.random.Generator) -> tuple[HullPart, ...]:
    breaks = (rng.uniform(-0.12, 0.16),) if rng.random() < 0.5 else rng.uniform((-0.24, 0.1), (-0.08, 0.26))
    corners = [-0.5, *breaks, 0.5]
    origin = rng.uniform(-14.0, 14.0, 2)
    parts = []
    for number in range(len(corners) - 1):
        ends = corners[number], corners[number + 1]
        # farther apart than they were built, and swung round
        along, aside = 1.25 * hulk.length * (ends[0] + ends[1]) / 2, rng.uniform(-14.0, 14.0)
        (c, s), swung = (np.cos(heading), np.sin(heading)), rng.uniform(-0.7, 0.7)
        heel = rng.choice((-1, 1)) * rng.uniform(0.05, 0.7)
        if number == len(corners) - 2 and rng.random() < 0.3:
            heel += np.pi  # the bow lies keel up
        turn = Rotation.from_euler("ZYX", (heading + swung, rng.uniform(-0.1, 0.1), heel))
        middle = (origin[0] + c * along - s * aside, origin[1] + s * along + c * aside)
        parts.append(HullPart(ends, middle, turn, rng.uniform(1.0, 3.5)))
    return tuple(parts)


def _ledge(strike: float, rng: np.random.Generator) -> Ledge:
    return Ledge(
        middle=tuple(rng.uniform(-108.0, 108.0, 2)),
        strike=strike + rng.uniform(-0.3, 0.3),
        length=rng.uniform(14.0, 60.0),
        height=rng.uniform(1.8, 5.5),
        back=rng.uniform(10.0, 34.0),
    )


def _ground(layout: WreckLayout, rng: np.random.Generator) -> np.ndarray:
    """Sloping sea bed with its ledges, scoured where the hull's parts lie, on raster() x raster() [m]."""
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    height = layout.bed + layout.slope[0] * x + layout.slope[1] * y + 0.6 * relief(rng)
    for ledge in layout.ledges:
        (c, s), (east, north) = (np.cos(ledge.strike), np.sin(ledge.strike)), ledge.middle
        along, back = c * (x - east) + s * (y - north), -s * (x - east) + c * (y - north)
        # an edge that bends to and fro
        back = back + 2.5 * np.sin(along / rng.uniform(4.0, 9.0))
        face = 1 / (1 + np.exp(-back / 0.8)) * np.exp(-np.clip(back, 0, None) / ledge.back)
        height += ledge.height * face * np.exp(-((2 * along / ledge.length) ** 4))
    for part in layout.parts:
        ahead = part.R_scene_part.apply((1.0, 0.0, 0.0))[:2]
        offset = np.stack([x - part.middle[0], y - part.middle[1]], axis=-1)
        along, across = offset @ ahead, offset @ (-ahead[1], ahead[0])
        half = layout.hulk.length * (part.ends[1] - part.ends[0]) / 2 + 3
        inside = np.exp(-((along / half) ** 4))
        height -= rng.uniform(0.6, 1.6) * inside * np.exp(-((across / layout.hulk.beam) ** 2))
        lee = across - rng.choice((-1, 1)) * 1.6 * layout.hulk.beam
        height += rng.uniform(0.4, 1.2) * inside * np.exp(-((lee / 5.0) ** 2))
    return height


def _laid(layout: WreckLayout, part: HullPart, height: np.ndarray, rng: np.random.Generator) -> list[Mesh]:
    """One part of the hull with its fittings, its lowest corner sunk into the bed below its middle."""
    hulk, (aft, ahead) = layout.hulk, part.ends
    parts = [skin(hulk, aft, ahead, rng), *bulkheads(hulk, aft, ahead, rng), *remains(hulk, aft, ahead, rng)]
    if aft == -0.5:
        parts += gear(hulk, rng)
    built = merge(parts)
    centered = built.vertices - np.array((hulk.length * (aft + ahead) / 2, 0.0, 0.0))
    turned = part.R_scene_part.apply(centered)
    lowest = turned[: (parts[0].vertices).shape[0], 2].min()
    floor = height_at(height, *part.middle)
    return [Mesh(turned + np.array((*part.middle, floor - part.sunk - lowest)), built.triangles)]


def _slabs(layout: WreckLayout, height: np.ndarray, rng: np.random.Generator) -> list[Mesh]:
    """Slabs that broke off the ledges and lie before them, roughly parallel to the bedding."""
    parts = []
    for ledge in layout.ledges:
        c, s = np.cos(ledge.strike), np.sin(ledge.strike)
        for _ in range(int(rng.integers(2, 8))):
            along, before = rng.uniform(-ledge.length / 2, ledge.length / 2), rng.uniform(-9.0, 3.0)
            place = ledge.middle[0] + c * along - s * before, ledge.middle[1] + s * along + c * before
            lying = rng.uniform((-0.5, -0.35, -0.35), (0.5, 0.35, 0.35)) + np.array((ledge.strike, 0, 0))
            size = rng.uniform((2.0, 1.5, 0.7), (8.0, 5.5, 2.2))
            middle = on_bed(height, np.clip(place, -SCENE_REACH, SCENE_REACH), 0.2 * size[2])
            parts.append(box(middle, size, Rotation.from_euler("ZYX", lying)))
    return parts


def _spilled(layout: WreckLayout, height: np.ndarray, rng: np.random.Generator) -> list[Mesh]:
    """Spilled containers, plates and pipes around the parts."""
    parts = []
    for number in range(int(rng.integers(10, 34))):
        part = layout.parts[int(rng.integers(len(layout.parts)))]
        east, north = np.clip(rng.normal(part.middle, 17.0), -SCENE_REACH, SCENE_REACH)
        floor = on_bed(height, (east, north))
        turn = Rotation.from_euler("ZYX", rng.uniform((-np.pi, -0.4, -0.5), (np.pi, 0.4, 0.5)))
        if number % 3 == 0:
            parts.append(box(floor + np.array((0, 0, 0.8)), (6.1 if rng.random() < 0.6 else 12.2, 2.44, 2.6), turn))
        elif number % 3 == 1:
            parts.append(box(floor + np.array((0, 0, 0.4)), rng.uniform((2.0, 1.5, 0.25), (9.0, 5.0, 0.45)), turn))
        else:
            reach = turn.apply((rng.uniform(2.5, 6.0), 0, 0))
            parts.append(rod(floor + np.array((0, 0, 0.5)), reach, rng.uniform(0.3, 0.8), 12))
    return parts


def _rigging(layout: WreckLayout, height: np.ndarray, rng: np.random.Generator) -> list[Mesh]:
    """Fallen masts with their yards, and the anchor's chain, which leads away from the bow."""
    parts = []
    for part in layout.parts[:2]:
        start = np.array(part.middle) + rng.uniform(-16.0, 16.0, 2)
        turn = Rotation.from_euler("ZYX", (rng.uniform(-np.pi, np.pi), rng.uniform(-0.25, -0.05), 0))
        foot = on_bed(height, start, 0.3)
        reach = rng.uniform(12.0, 22.0)
        parts.append(cylinder(foot, foot + turn.apply((reach, 0, 0)), rng.uniform(0.3, 0.5), 12))
        yard = foot + turn.apply((0.7 * reach, 0, 0))
        parts.append(rod(yard, turn.apply((0, 4.0, 0)), 0.25, 10))
    steps = np.cumsum(rng.normal(0, 0.35, 9)) + layout.heading
    line = np.array(layout.parts[-1].middle) + np.cumsum(6.0 * np.column_stack([np.cos(steps), np.sin(steps)]), axis=0)
    line = np.clip(line, -SCENE_REACH, SCENE_REACH)
    kept = np.concatenate([[True], np.linalg.norm(np.diff(line, axis=0), axis=1) > 0.5])
    chain = np.array([on_bed(height, place, 0.25) for place in line[kept]])
    return [*parts, tube(chain, 0.3, bend=2.0, sides=8), box(chain[-1] + np.array((0, 0, 0.4)), (2.6, 1.8, 0.9))]
