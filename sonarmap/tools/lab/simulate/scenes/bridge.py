"""A road bridge over a river: piers on footings with fenders, abutments, a scoured bed, lines across it, debris.

The seed determines the number, spacing and shape of the piers, the skew of the axis to the river, the course of the
channel, and the debris. The river flows along x; the piers are aligned with the flow.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import SCENE_EDGE, boulders, debris, on_bed, raster, relief, scene_of
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, prism, rod, tube, wall

SLOPE = 0.5  # of the banks
TOE = 14.0  # from a bank's line to where its slope begins [m]
BANK_TOP = 5.0  # above the water [m]


@dataclass(frozen=True, slots=True)
class River:
    """The plan of a river."""

    bed: float  # mean height of its bed [m]
    south: float  # y of the banks' lines at x = 0 [m]
    north: float  # likewise
    bend: tuple[float, float, float]  # amplitude [m], wave number [rad/m] and phase [rad] of their winding
    channel_y: float  # y of the channel at x = 0 [m]
    channel_width: float  # [m]
    channel_depth: float  # below the bed [m]
    shoals: np.ndarray  # (K, 4): x, y, radius and height [m] of each

    def winding(self, x: np.ndarray) -> np.ndarray:
        """Northward offset of the river at `x` from that at 0 [m]."""
        amplitude, number, phase = self.bend
        return amplitude * (np.sin(number * x + phase) - np.sin(phase))


def river_of(rng: np.random.Generator) -> River:
    """Draw a river 175 to 205 m wide and 12 to 15 m deep."""
    shoals = rng.uniform((-110, -70, 10, -1.5), (110, 70, 26, 3.5), (int(rng.integers(2, 6)), 4))
    return River(
        bed=rng.uniform(-15.0, -12.0),
        south=rng.uniform(-101.0, -88.0),
        north=rng.uniform(88.0, 101.0),
        bend=(rng.uniform(2.0, 8.0), 2 * np.pi / rng.uniform(180.0, 320.0), rng.uniform(0, 2 * np.pi)),
        channel_y=rng.uniform(-45.0, 45.0),
        channel_width=rng.uniform(12.0, 22.0),
        channel_depth=rng.uniform(2.5, 5.0),
        shoals=shoals,
    )


def ground(river: River, piers: list[tuple[float, float, float, float]], rng: np.random.Generator) -> np.ndarray:
    """Bed and banks on raster() x raster() [m]. The bed is scoured about the upstream end and along the sides of each
    pier (x, y, length and width [m]); the scoured sand lies behind it."""
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    wind = river.winding(x)
    bed = river.bed + 0.8 * relief(rng)
    # the channel winds half as much again as the banks do
    bed -= river.channel_depth * np.exp(-(((y - river.channel_y - 1.5 * wind) / river.channel_width) ** 2))
    for east, north, radius, rise in river.shoals:
        bed += rise * np.exp(-((((x - east) / (2 * radius)) ** 2) + ((y - north) / radius) ** 2))
    for east, north, length, width in piers:
        deep, wide = rng.uniform(1.2, 2.6) + 0.3 * width, 2.2 * width
        ahead, behind = east - length / 2, east + length / 2 + 14
        bed -= deep * np.exp(-(((x - ahead) / wide) ** 2) - ((y - north) / wide) ** 2)
        bed -= 0.5 * deep * np.exp(-(((x - east) / (0.6 * length)) ** 2) - ((y - north) / wide) ** 2)
        bed += 0.35 * deep * np.exp(-(((x - behind) / 14) ** 2) - ((y - north) / (1.3 * width)) ** 2)
    inland = np.maximum(y - wind - river.north, river.south + wind - y) + TOE
    return bed + np.clip(SLOPE * inland, 0, BANK_TOP - river.bed)


FOOT = -34.0  # lower end of piers and piles, below the lowest bed [m]


@dataclass(frozen=True, slots=True)
class Pier:
    """Position, size and shape of a pier."""

    x: float  # of its middle [m]
    y: float  # likewise
    length: float  # along the flow [m]
    width: float  # across the flow [m]
    footing: float  # how far its footing reaches beyond it on all sides [m]
    footing_top: float  # height of the footing's top [m]
    round: bool  # whether its ends are round rather than pointed
    fenced: bool  # whether it stands beside the fairway and has fenders
    turned: float  # its heading against the flow [rad]


def outline(length: float, width: float, is_round: bool) -> np.ndarray:
    """A pier's plan (K, 2), counterclockwise, its ends pointed or half circles."""
    straight, half = length / 2 - width / 2, width / 2
    angle = np.linspace(-np.pi / 2, np.pi / 2, 7 if is_round else 3)[:, None]
    end = np.column_stack([np.cos(angle), np.sin(angle)]) * half
    return np.concatenate([end + np.array((straight, 0)), -end - np.array((straight, 0))])


def _placed(pier: Pier, mesh: Mesh) -> Mesh:
    """A mesh in the pier's frame, with x along the pier, moved to the scene's frame."""
    return mesh.moved(Rotation.from_euler("z", pier.turned), (pier.x, pier.y, 0.0))


def shaft(pier: Pier, deck: tuple[float, float], heading: float) -> list[Mesh]:
    """The shaft, its footing with a step, and the cap that carries the deck."""
    underside, width = deck
    reach = 2 * pier.footing
    parts = [
        prism(outline(pier.length, pier.width, pier.round), FOOT, underside - 1.4),
        prism(outline(pier.length + reach, pier.width + reach, False), FOOT, pier.footing_top),
        prism(outline(pier.length + reach / 2, pier.width + reach / 2, False), FOOT, pier.footing_top + 1.1),
    ]
    turn = Rotation.from_euler("z", heading - pier.turned)
    cap = box((0, 0, underside - 0.8), (1.2 * pier.width, width, 1.6), turn)
    return [_placed(pier, part) for part in [*parts, cap]]


def fenders(pier: Pier, rng: np.random.Generator) -> list[Mesh]:
    """Rows of piles with a waling along both sides, a dolphin before either end, one of them out of line."""
    aside, parts = pier.width / 2 + pier.footing + 1.0, []
    for side in (-1, 1):
        for along in np.arange(-pier.length / 2, pier.length / 2 + 0.1, rng.uniform(3.0, 4.5)):
            foot = (along, side * (aside + 0.6), FOOT)
            parts.append(cylinder(foot, (along, side * aside, 2.5), 0.35, sides=10))
        parts.append(box((0, side * (aside - 0.3), rng.uniform(-0.8, 0.6)), (pier.length + 1.5, 0.5, 0.7)))
    for end in (-1, 1):
        middle = np.array((end * (pier.length / 2 + rng.uniform(6.0, 11.0)), rng.uniform(-1.5, 1.5), 0.0))
        for turn in 2 * np.pi * (np.arange(rng.integers(3, 6)) + rng.random()) / 5:
            lean = np.array((np.cos(turn), np.sin(turn), 0.0))
            foot, head = (middle + out * lean + np.array((0, 0, z)) for out, z in ((2.2, FOOT), (0.6, 3.5)))
            parts.append(cylinder(foot, head, 0.4, sides=10))
    return [_placed(pier, part) for part in parts]


def driftwood(pier: Pier, bed: float, rng: np.random.Generator) -> list[Mesh]:
    """Up to four pieces of driftwood against the pier's upstream end."""
    parts = []
    for _ in range(rng.integers(0, 5)):
        middle = np.array((-pier.length / 2 - rng.uniform(0.5, 3.0), rng.uniform(-3.0, 3.0), 0.0))
        middle[2] = max(pier.footing_top, bed) + rng.uniform(0.3, 3.0)
        reach = Rotation.from_euler("ZYX", rng.uniform((0.8, -0.4, 0), (2.3, 0.4, 0))).apply((rng.uniform(2, 6), 0, 0))
        parts.append(rod(middle, reach, rng.uniform(0.2, 0.55), sides=8))
    return [_placed(pier, part) for part in parts]


REMNANT_TOP = (-9.0, -6.5)  # height of the remains of an older bridge [m]: below the vessels


@dataclass(frozen=True, slots=True)
class BridgeLayout:
    """The plan of a bridge."""

    river: River
    x: float  # of its axis at y = 0 [m]
    skew: float  # of the axis against square to the river, counterclockwise [rad]
    deck: tuple[float, float]  # height of the deck's underside [m], its width [m]
    piers: tuple[Pier, ...]  # from south to north

    def axis_x(self, y: float) -> float:
        """x of the axis at `y` [m]."""
        return self.x - y * float(np.tan(self.skew))

    @property
    def openings(self) -> list[float]:
        """y of the middles of the openings between neighboring piers [m], the widest first."""
        spans = [((south.y + north.y) / 2, north.y - south.y) for south, north in pairwise(self.piers)]
        return [middle for middle, _ in sorted(spans, key=lambda span: -span[1])]


def bridge_layout(seed: int) -> BridgeLayout:
    """The bridge of `seed`: three to five piers at uneven distances, its axis up to 20 degrees askew."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 27]))
    river = river_of(rng)
    count = int(rng.integers(3, 6))
    shares = rng.uniform(0.75, 1.25, count + 1)
    # from bank to bank; the outer spans are over the slopes
    places = -82.0 + 164.0 * np.cumsum(shares)[:-1] / shares.sum()
    fairway = int(np.argmin(np.abs((places[1:] + places[:-1]) / 2 - river.channel_y)))
    slim, ends = rng.uniform(3.0, 5.0), bool(rng.random() < 0.5)
    x, skew = rng.uniform(-8.0, 22.0), rng.uniform(-0.35, 0.35)
    piers = tuple(
        Pier(
            x=float(x - y * np.tan(skew)),
            y=float(y),
            length=rng.uniform(13.0, 19.0),
            width=slim * rng.uniform(0.9, 1.15),
            footing=rng.uniform(1.0, 2.2),
            footing_top=river.bed + rng.uniform(-2.5, 2.0),
            round=ends,
            fenced=number in (fairway, fairway + 1),
            turned=rng.uniform(-0.07, 0.07),
        )
        for number, y in enumerate(places)
    )
    return BridgeLayout(river, x, skew, deck=(rng.uniform(7.5, 12.0), rng.uniform(9.0, 14.0)), piers=piers)


def bridge(seed: int) -> Mesh:
    """The scene from `seed`, 256 m on a side, the water's surface at z = 0, its bed at -11 to -22 m."""
    layout = bridge_layout(seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 28]))
    scoured = [(pier.x, pier.y, pier.length, pier.width) for pier in layout.piers]
    height = ground(layout.river, scoured, rng)
    loose = boulders(height, int(rng.integers(40, 120)), rng) + debris(height, int(rng.integers(15, 50)), rng)
    parts = [*_deck(layout), *_abutments(layout), *_lines(layout, height, rng), *_remnants(layout, height, rng)]
    for pier in layout.piers:
        parts += shaft(pier, layout.deck, layout.skew + np.pi / 2)
        parts += driftwood(pier, layout.river.bed, rng)
        if pier.fenced:
            parts += fenders(pier, rng)
    return scene_of(height, parts, loose)


def _deck(layout: BridgeLayout) -> list[Mesh]:
    """The slab, its girders, and a pair of pipes hung below its downstream side."""
    underside, width = layout.deck
    turn = Rotation.from_euler("z", layout.skew + np.pi / 2)
    middle, length = np.array((layout.x, 0.0, 0.0)), 236.0 / np.cos(layout.skew)
    parts = [box(middle + np.array((0, 0, underside + 1.9)), (length, width, 0.7), turn)]
    for across in (-0.32, 0.0, 0.32):
        place = middle + turn.apply((0, across * width, underside + 0.8))
        parts.append(box(place, (length, 0.6, 1.6), turn))
    for down in (0.4, 1.2):
        place = middle + turn.apply((0, -0.45 * width, underside - 0.1 + down))
        parts.append(rod(place, turn.apply((length / 2, 0, 0)), 0.22, sides=10))
    return parts


def _abutments(layout: BridgeLayout) -> list[Mesh]:
    """A block in either bank below the deck's ends, with wing walls that splay into the slope."""
    underside, width = layout.deck
    turn = Rotation.from_euler("z", layout.skew + np.pi / 2)
    parts = []
    for side, bank in ((-1, layout.river.south), (1, layout.river.north)):
        y = bank + side * 6.0
        x = layout.axis_x(y)
        parts.append(box((x, y, (underside + FOOT) / 2), (7.0, width + 2, underside - FOOT), turn))
        for along in (-1, 1):
            start = np.array((x + along * (width / 2 + 1), y - side * 2))
            splay = [np.array((along * x, side * y)) for x, y in ((0.0, 0.0), (9.0, 3.0), (16.0, 11.0))]
            parts.append(wall([start + step for step in splay], 1.4, FOOT, underside - 2.5))
    return parts


def _lines(layout: BridgeLayout, height: np.ndarray, rng: np.random.Generator) -> list[Mesh]:
    """A pipeline that crosses the river on its bed, hanging free in places, and ducts under slabs beside it."""
    y = np.linspace(-SCENE_EDGE / 2 + 6, SCENE_EDGE / 2 - 6, 14)
    parts = []
    pipe_x, slope, radius = rng.uniform(-62, -34), rng.uniform(-0.2, 0.2), rng.uniform(0.45, 0.9)
    pipe = np.array([on_bed(height, place) for place in zip(pipe_x + slope * y, y, strict=True)])
    pipe[:, 2] += rng.uniform(-0.3, 1.0, len(y))
    parts.append(tube(pipe, radius, bend=5.0))
    duct_x, count = rng.uniform(56, 82), int(rng.integers(2, 5))
    for number in range(count):
        x = duct_x + 1.3 * number + rng.uniform(-0.3, 0.3, len(y)) + 0.1 * y
        duct = np.array([on_bed(height, place) for place in zip(x, y, strict=True)])
        duct[:, 2] += rng.uniform(-0.1, 0.3, len(y))
        parts.append(tube(duct, 0.22, bend=5.0, sides=8))
    for north in rng.uniform(-60, 60, int(rng.integers(3, 8))):
        east = duct_x + 0.65 * (count - 1) + 0.1 * north
        turn = Rotation.from_euler("ZYX", (rng.uniform(-0.4, 0.4), *rng.uniform(-0.06, 0.06, 2)))
        parts.append(box(on_bed(height, (east, north), 0.45), (6.0, 3.0, 0.35), turn))
    return parts


def _remnants(layout: BridgeLayout, height: np.ndarray, rng: np.random.Generator) -> list[Mesh]:
    """Stumps of an older bridge's piers in a line of their own, a sunken lorry, a barge's bottom."""
    parts = []
    aside, lean = rng.choice((-1, 1)) * rng.uniform(28.0, 46.0), rng.uniform(-0.2, 0.2)
    for y in rng.uniform(-64.0, 64.0, int(rng.integers(1, 4))):
        plan = outline(rng.uniform(6, 10), rng.uniform(2.4, 4), True) @ [[1, lean], [-lean, 1]]
        parts.append(prism(plan + np.array((layout.axis_x(y) + aside, y)), FOOT, rng.uniform(*REMNANT_TOP)))
    for sizes in (((7.0, 2.5, 2.2), (2.2, 2.4, 2.9)), ((19.0, 5.5, 1.6), (3.5, 4.5, 2.8))):
        east, north = rng.uniform((-100, -60), (100, 60))
        turn = Rotation.from_euler("ZYX", rng.uniform((-np.pi, -0.15, -0.3), (np.pi, 0.15, 0.3)))
        floor = on_bed(height, (east, north))
        body, cab = sizes
        parts.append(box(floor + np.array((0, 0, 0.35 * body[2])), body, turn))
        ahead = turn.apply(((body[0] + cab[0]) / 2 - 0.4, 0, 0.35 * cab[2]))
        parts.append(box(floor + ahead, cab, turn))
    return parts
