"""A flood gate across a river: piers, gates, a lock with two chambers, kinked banks, dolphins and debris.

The layout is like that of the gate in the river Lesum (paper Sect. 4): the barrier runs along y near x = 18, the
river flows along x, the lock lies at the north. The seed changes the bed and what lies on it, not the plan.
"""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import boulders, debris, raster, relief, scene_of
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, prism, wall

BED_DEPTH = -19.0  # mean height of the river's bed [m]
QUAY_TOP = 6.0
FOOT = -32.0  # lower end of walls and piles, below the lowest bed [m]

NORTH_BANK = ((-130, 104), (-78, 110), (-40, 98), (62, 98), (90, 112), (130, 102))
SOUTH_BANK = ((-130, -88), (-92, -101), (-30, -86), (30, -92), (74, -108), (130, -99))
PIERS = (-84.0, -58.0, -33.0, -9.0, 13.0)  # y of the piers' middles [m]
BARRIER_X = 18.0

# x of the hinges, y of the chamber's walls, height of the top [m]
MITER_GATES = ((-22, 31.5, 50, 4.5), (60, 31.5, 50, 4.5), (-20, 54, 79.5, 4.5), (62, 54, 79.5, 1.0))

# x and y of each group's middle [m], number of piles, spread of their feet [m]
DOLPHINS = (
    (-62, 40, 5, 3.0),
    (-88, 33, 3, 2.2),
    (-34, -44, 4, 2.6),
    (-74, -62, 6, 3.4),
    (78, 38, 4, 2.6),
    (100, 27, 3, 2.0),
    (66, -52, 5, 3.0),
    (-104, -14, 3, 2.4),
)


def floodgate(seed: int) -> Mesh:
    """The scene from `seed`, 256 m on a side, the water's surface at z = 0, its bed at about -19 m."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 1]))
    height = _ground(rng)
    loose = boulders(height, 90, rng) + debris(height, 36, rng)
    return scene_of(height, _barrier(), _lock(), _banks(), _dolphins(rng), loose)


def _ground(rng: np.random.Generator) -> np.ndarray:
    """Bed and banks on the raster [m]: slopes of 1:2 at the bank lines, a scour hole behind the gates."""
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    north = np.interp(raster(), *np.transpose(NORTH_BANK))[:, None]
    south = np.interp(raster(), *np.transpose(SOUTH_BANK))[:, None]
    inland = np.maximum(y - north, south - y) + 14.0
    scour = -6.0 * np.exp(-(((x - 52) / 22) ** 2 + ((y + 38) / 34) ** 2))
    bar = 4.5 * np.exp(-(((x + 82) / 30) ** 2 + ((y - 4) / 18) ** 2))
    bed = BED_DEPTH + scour + bar + relief(rng)
    return bed + np.clip(inland / 2, 0, -BED_DEPTH + 5)


def _barrier() -> list[Mesh]:
    """Piers with pointed noses, gates between them at different heights, a sill, houses, a bridge."""
    nose = np.array([[-13, 0], [-9, -2.6], [11, -2.6], [13, 0], [11, 2.6], [-9, 2.6]])
    parts = [prism(nose + np.array([BARRIER_X, y]), FOOT, 9.0 + 0.02 * y) for y in PIERS]
    parts += [box((BARRIER_X + 3, y, 12.0), (6 + 0.03 * y, 4.6, 6.0)) for y in PIERS[::2]]
    openings = list(pairwise(PIERS))
    for number, (south, north) in enumerate(openings):
        bottom, top = ((-8.0, 5.0), (FOOT, 3.0), (FOOT, -2.0), (2.0, 14.0))[number]
        size = (1.6, north - south - 5.2, top - bottom)
        parts.append(box((BARRIER_X - 1.5 + number, (south + north) / 2, (bottom + top) / 2), size))
    middle, length = (PIERS[0] + PIERS[-1]) / 2, PIERS[-1] - PIERS[0]
    parts.append(box((BARRIER_X, middle, BED_DEPTH + 0.6), (30, length, 3.2)))
    parts.append(box((BARRIER_X + 9, middle + 6, 9.4), (3.4, length + 30, 1.0)))
    return parts


def _lock() -> list[Mesh]:
    """Two chambers of unequal width that share a wall, miter gates, guide walls, a control tower."""
    parts = [
        wall([(-46, 24), (-30, 29), (72, 29), (92, 22)], 5.0, FOOT, 5.0),
        wall([(-24, 52), (64, 52)], 4.0, FOOT, 5.0),
        wall([(-38, 88), (-24, 82), (70, 82)], 5.0, FOOT, 5.5),
        box((24, 56, 10), (9, 6, 10)),
        box((15, 22, 0), (26, 12, 2 * 7.0)),
    ]
    for x, south, north, top in MITER_GATES:
        middle = (south + north) / 2
        parts.append(wall([(x, south), (x + 5, middle), (x, north)], 1.2, FOOT, top))
    return parts


def _banks() -> list[Mesh]:
    """Sheet-pile quays along parts of the banks, a landing stage, groynes in the river."""
    north, south = np.array(NORTH_BANK, float), np.array(SOUTH_BANK, float)
    return [
        wall(north[2:5] - np.array([0, 6]), 1.5, FOOT, QUAY_TOP),
        wall(south[1:4] + np.array([0, 6]), 1.5, FOOT, QUAY_TOP - 1),
        wall([(BARRIER_X, -84), (BARRIER_X, -100)], 5.0, FOOT, 9.0),
        wall([(90, -84), (96, -60)], 3.0, FOOT, -9.0),
        wall([(-100, 92), (-92, 66)], 3.0, FOOT, -10.0),
        box((-66, -79, 1.0), (26, 7, 1.4), Rotation.from_euler("z", 0.12)),
    ]


def _dolphins(rng: np.random.Generator) -> list[Mesh]:
    """Groups of leaning piles, and a row of single ones that leads into the lock."""
    piles = []
    for east, north, count, spread in DOLPHINS:
        head = np.array((east, north, rng.uniform(3, 7)))
        for turn in 2 * np.pi * (np.arange(count) + rng.random()) / count:
            lean = spread * np.array((np.cos(turn), np.sin(turn), 0.0))
            foot = (*(head + lean)[:2], FOOT)
            piles.append(cylinder(foot, head + 0.25 * lean, rng.uniform(0.4, 0.7), sides=12))
    for step in range(6):
        east, north = -56.0 - 11 * step, 60.0 + 3.5 * step
        piles.append(cylinder((east, north, FOOT), (east, north, 4.0 + step % 3), 0.6, sides=12))
    return piles
