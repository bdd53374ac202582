"""A road bridge over a river: piers on footings with fenders, abutments, a scoured bed, lines across it, debris.

The plan is the seed's: how many piers, how far apart and of what shape, how the axis is skewed to the river, where the
channel runs, what lies on the bed. The river flows along x; its piers stand along the flow, as they are built.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import SCENE_EDGE, boulders, debris, height_at, on_bed, scene_of
from sonarmap.tools.lab.simulate.scenes.river import (
    FOOT,
    Pier,
    River,
    driftwood,
    fenders,
    ground,
    outline,
    river_of,
    shaft,
)
from sonarmap.tools.lab.simulate.shapes.solids import Mesh, box, prism, rod, tube, wall

REMNANT_TOP = (-9.0, -6.5)  # of what is left of an older bridge [m]: below the vessels


@dataclass(frozen=True, slots=True)
class BridgeLayout:
    """What the seed decides of the bridge's plan."""

    river: River  # that it crosses
    x: float  # where its axis crosses y = 0 [m]
    skew: float  # of the axis against square to the river, counterclockwise [rad]
    deck: tuple[float, float]  # height of the deck's underside [m], its width [m]
    piers: tuple[Pier, ...]  # from south to north

    def axis_x(self, y: float) -> float:
        """x of the axis at `y` [m]."""
        return self.x - y * float(np.tan(self.skew))

    @property
    def openings(self) -> list[float]:
        """y of the middles between each two neighboring piers [m], the wider ones first."""
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
    """A pipeline that crosses the river on its bed, here and there hanging free, and ducts under slabs beside it."""
    y = np.linspace(-SCENE_EDGE / 2 + 6, SCENE_EDGE / 2 - 6, 14)
    parts = []
    pipe_x, slope, radius = rng.uniform(-62, -34), rng.uniform(-0.2, 0.2), rng.uniform(0.45, 0.9)
    x = pipe_x + slope * y
    beds = np.array([height_at(height, east, north) for east, north in zip(x, y, strict=True)])
    parts.append(tube(np.column_stack([x, y, beds + rng.uniform(-0.3, 1.0, len(y))]), radius, bend=5.0))
    duct_x, count = rng.uniform(56, 82), int(rng.integers(2, 5))
    for number in range(count):
        x = duct_x + 1.3 * number + rng.uniform(-0.3, 0.3, len(y)) + 0.1 * y
        beds = np.array([height_at(height, east, north) for east, north in zip(x, y, strict=True)])
        parts.append(tube(np.column_stack([x, y, beds + rng.uniform(-0.1, 0.3, len(y))]), 0.22, bend=5.0, sides=8))
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
