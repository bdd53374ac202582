"""A swimming pool: a sloping floor with a drain, ladders, steps, lane ropes, starting blocks, objects on the floor."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, ellipsoid, height_field, merge, rod

LENGTH, WIDTH = 25.0, 12.5  # of the water [m], along x and y; the deep end is at -x
DECK_TOP = 0.3
DECK_WIDTH = 1.2
FOOT = -5.0  # below the lowest floor [m]
FLOOR_CELL = 0.125
LANES = 5


@dataclass(frozen=True, slots=True)
class PoolLayout:
    """The shape of a pool."""

    knots: tuple[float, ...]  # x of the floor's four corners from the deep end to the shallow one [m]
    depths: tuple[float, ...]  # at the knots [m]
    drain: tuple[float, float]  # x and y of the drain's middle, in the deep end [m]
    ladders: tuple[float, ...]  # x of each of the four ladders [m], two on either long side
    steps: int  # corner with the steps at the shallow end, -1 or 1 along y
    side: int  # end with the starting blocks: -1 the deep one, 1 the shallow one

    def floor(self, x: float) -> float:
        """Height of the floor at `x` [m], the drain left out."""
        return -float(np.interp(x, self.knots, self.depths))


def pool_layout(seed: int) -> PoolLayout:
    """The pool of `seed`: 3.8 m deep at one end and 1.2 m at the other, the slope between them anywhere."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 23]))
    half = LENGTH / 2
    return PoolLayout(
        knots=(-half, rng.uniform(-7.5, -4.5), rng.uniform(1.0, 5.0), half),
        depths=(3.8, rng.uniform(3.4, 3.7), rng.uniform(1.45, 1.7), 1.2),
        drain=(rng.uniform(-10.5, -8.5), rng.uniform(-2.5, 2.5)),
        ladders=tuple(rng.uniform((-11, 6, -10, 5), (-8, 9, -6, 10))),
        steps=int(rng.choice((-1, 1))),
        side=int(rng.choice((-1, 1))),
    )


def pool(seed: int) -> Mesh:
    """The scene from `seed`, the water 25 m by 12.5 m, its surface at z = 0, its floor at -1.2 to -3.8 m."""
    layout = pool_layout(seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 24]))
    parts = [*_basin(layout), *_steps(layout), *_ropes(rng), *_blocks(layout), *_objects(layout, rng)]
    for number, east in enumerate(layout.ladders):
        parts += _ladder(layout, east, -1 if number < 2 else 1)
    return merge(parts)


def _basin(layout: PoolLayout) -> list[Mesh]:
    """The floor, its drain under bars, four walls as wide as the deck on them, ledges along the long ones."""
    x, y = (np.linspace(-edge / 2, edge / 2, round(edge / FLOOR_CELL) + 1) for edge in (LENGTH, WIDTH))
    height = np.repeat(np.array([[layout.floor(east)] for east in x]), len(y), axis=1)
    sunk = (np.abs(x - layout.drain[0]) < 0.5)[:, None] & (np.abs(y - layout.drain[1]) < 0.5)
    tall, middle = DECK_TOP - FOOT, (DECK_TOP + FOOT) / 2
    walls = [
        box((side * (LENGTH + DECK_WIDTH) / 2, 0, middle), (DECK_WIDTH, WIDTH + 2 * DECK_WIDTH, tall))
        for side in (-1, 1)
    ]
    walls += [box((0, side * (WIDTH + DECK_WIDTH) / 2, middle), (LENGTH, DECK_WIDTH, tall)) for side in (-1, 1)]
    # footrests along the long walls, 1.1 m under water
    ledges = [box((0, side * (WIDTH / 2 - 0.06), -1.05), (LENGTH, 0.12, 0.1)) for side in (-1, 1)]
    east, north = layout.drain
    bars = [box((east + step, north, layout.floor(east) - 0.03), (0.06, 1.2, 0.06)) for step in (-0.3, -0.1, 0.1, 0.3)]
    return [height_field(x, y, height - 0.25 * sunk), *walls, *ledges, *bars]


def _steps(layout: PoolLayout) -> list[Mesh]:
    """Stairs down from the deck in one corner of the shallow end, with a rail along their open side."""
    wide, tread, rise, count = 2.2, 0.34, 0.3, 4
    middle = layout.steps * (WIDTH - wide) / 2
    parts = []
    for number in range(count):
        top = -rise * number - 0.1
        deep = tread * (number + 1)
        parts.append(box((LENGTH / 2 - deep / 2, middle, (top + FOOT) / 2), (deep, wide, top - FOOT)))
    rail = layout.steps * (WIDTH / 2 - wide - 0.08)
    foot = np.array((LENGTH / 2 - tread * count - 0.1, rail, layout.floor(LENGTH / 2 - tread * count)))
    head = np.array((LENGTH / 2 - 0.1, rail, 0.25))
    parts.append(cylinder(foot, (*foot[:2], -0.3), 0.03, sides=8))
    parts.append(cylinder((*foot[:2], -0.3), head, 0.03, sides=8))
    return parts


def _ladder(layout: PoolLayout, east: float, side: int) -> list[Mesh]:
    """Two rails down a long wall, bent over the deck, with rungs between them."""
    north = side * (WIDTH / 2 - 0.16)
    foot = max(-1.6, layout.floor(east) + 0.15)
    parts = []
    for rail in (-0.25, 0.25):
        head = (east + rail, north, DECK_TOP + 0.5)
        parts.append(cylinder((east + rail, north, foot), head, 0.025, sides=8))
        parts.append(cylinder(head, (east + rail, side * (WIDTH / 2 + 0.5), DECK_TOP), 0.025, sides=8))
    for height in np.arange(foot + 0.1, -0.1, 0.3):
        parts.append(box((east, north, height), (0.5, 0.08, 0.04)))
    return parts


def _ropes(rng: np.random.Generator) -> list[Mesh]:
    """Lane ropes, rows of floats at the surface; some of them are missing."""
    parts = []
    kept = np.sort(rng.choice(LANES - 1, size=rng.integers(2, LANES), replace=False))
    for lane in kept:
        north = WIDTH / LANES * (lane + 1) - WIDTH / 2
        sag = rng.uniform(-0.12, 0.12)
        for east in np.arange(-LENGTH / 2 + 0.4, LENGTH / 2 - 0.4, 0.45):
            aside = north + sag * np.cos(np.pi * east / LENGTH)
            parts.append(cylinder((east, aside, -0.02), (east + 0.3, aside, -0.02), 0.075, sides=8))
    return parts


def _blocks(layout: PoolLayout) -> list[Mesh]:
    """Starting blocks on the deck of one short end, leaning over the water, each with a bar below its edge."""
    parts = []
    for lane in range(LANES):
        north = WIDTH / LANES * (lane + 0.5) - WIDTH / 2
        edge = layout.side * LENGTH / 2
        lean = Rotation.from_euler("y", layout.side * -0.15)
        parts.append(box((edge + layout.side * 0.3, north, DECK_TOP + 0.2), (0.4, 0.4, 0.4)))
        parts.append(box((edge + layout.side * 0.15, north, DECK_TOP + 0.45), (0.7, 0.55, 0.08), lean))
        grip = edge - layout.side * 0.12
        parts.append(cylinder((grip, north - 0.3, DECK_TOP + 0.1), (grip, north + 0.3, DECK_TOP + 0.1), 0.02, sides=8))
    return parts


def _objects(layout: PoolLayout, rng: np.random.Generator) -> list[Mesh]:
    """Objects on the floor, none higher than 0.45 m: crates, lengths of pipe, a weight with a ball, a slab."""
    parts = []
    for number in range(int(rng.integers(9, 15))):
        east, north = rng.uniform((-11.5, -5.2), (8.5, 5.2))
        ground = layout.floor(east)
        turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
        if number % 4 == 0:
            size = rng.uniform((0.3, 0.25, 0.2), (0.9, 0.6, 0.4))
            parts.append(box((east, north, ground + size[2] / 2), size, turn))
        elif number % 4 == 1:
            reach = turn.apply((rng.uniform(0.3, 0.9), 0, 0))
            radius = rng.uniform(0.06, 0.15)
            parts.append(rod((east, north, ground + radius), reach, radius, sides=16))
        elif number % 4 == 2:
            parts.append(cylinder((east, north, ground - 0.1), (east, north, ground + rng.uniform(0.1, 0.4)), 0.2))
        else:
            radius = rng.uniform(0.12, 0.22)
            parts.append(ellipsoid((east, north, ground + radius), (radius, radius, radius)))
    return parts
