"""A harbor basin: quays around a corner, a jetty on piles, a moored ship, fenders and mooring dolphins."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import boulders, debris, raster, relief, scene_of
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, loft, wall

BED_DEPTH = -14.0
FOOT = -28.0


def harbor(seed: int) -> Mesh:
    """The scene from `seed`, 256 m on a side, the water's surface at z = 0, its bed at -11 to -17 m."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 2]))
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    fairway = -3.0 / (1 + np.exp(-(60 - np.abs(x + 0.35 * y - 10)) / 8))
    silt = 4.0 * np.exp(-(((118 - x) / 18) ** 2)) + 2.5 * np.exp(-(((y + 110) / 16) ** 2))
    height = BED_DEPTH + fairway + silt + 0.7 * relief(rng)
    loose = boulders(height, 50, rng) + debris(height, 40, rng)
    ship = hull((34.0, 62.0), 2.9, length=92.0, beam=15.0, draft=7.5)
    return scene_of(height, _quays(), _jetty(rng), _moorings(rng), ship, loose)


def hull(middle: tuple[float, float], heading: float, length: float, beam: float, draft: float) -> list[Mesh]:
    """A ship about `middle` [m], her bow to `heading`: a lofted hull with a fine bow and a raked stern, a rudder, a
    deck house."""
    along = np.linspace(-0.5, 0.5, 33)
    half = 0.5 * beam * np.clip(1 - np.abs(2 * along) ** 5, 0.04, None) * np.clip(1 - np.maximum(along - 0.2, 0), 0, 1)
    keel = draft * np.clip(1 - np.maximum(-along - 0.3, 0) * 3.5, 0.2, 1)
    girth = np.linspace(np.pi, 0, 17)
    sections = []
    for station, width, depth in zip(along, half, keel, strict=True):
        # a superellipse below the water, plumb sides above it
        across = width * np.sign(np.cos(girth)) * np.abs(np.cos(girth)) ** 0.5
        down = -depth * np.abs(np.sin(girth)) ** 0.6
        ring = np.concatenate([[[-width, 5.0]], np.column_stack([across, down]), [[width, 5.0]]])
        sections.append(np.column_stack([np.full(len(ring), station * length), ring]))
    turn = Rotation.from_euler("z", heading)
    skin = loft(sections)
    place = np.array((*middle, 0.0))
    rudder = box(turn.apply((-0.49 * length, 0, -0.55 * draft)) + place, (3.5, 0.5, 0.7 * draft), turn)
    house = box(turn.apply((-0.36 * length, 0, 9.0)) + place, (0.14 * length, 0.8 * beam, 9.0), turn)
    return [skin.moved(turn, place), rudder, house]


def _quays() -> list[Mesh]:
    """Quay walls around the basin's corner, with a stair, a step in the line and a slipway."""
    return [
        wall([(-120, 84), (-64, 84), (-64, 92), (58, 92), (96, 66), (96, -18), (110, -18), (110, -90)], 3.0, FOOT, 4.0),
        wall([(-120, -70), (-86, -70), (-86, -112), (-20, -112)], 3.0, FOOT, 4.0),
        box((-100, 80, -7), (12, 6, 3), Rotation.from_euler("y", 0.5)),
        box((8, -110, -10), (30, 26, 2), Rotation.from_euler("x", 0.28)),
        *(box((-56 + 13.0 * k, 90, -1), (1.2, 1.4, 6)) for k in range(9)),
    ]


def _jetty(rng: np.random.Generator) -> list[Mesh]:
    """A deck on rows of piles with raking outer ones, a head across its end."""
    turn = Rotation.from_euler("z", 0.3)
    root = np.array((-84.0, -34.0, 0.0))
    parts = [
        box(root + turn.apply((42, 0, 3.0)), (92, 8, 1.0), turn),
        box(root + turn.apply((92, 6, 3.0)), (14, 34, 1.2), turn),
    ]
    spots = [(6.0 + 9 * k, side) for k in range(10) for side in (-3.2, 3.2)]
    spots += [(88.0 + 8 * i, -8.0 + 9.5 * j) for i in range(2) for j in range(4)]
    for number, (along, across) in enumerate(spots):
        head = root + turn.apply((along, across, 3.0))
        rake = (rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5), FOOT) if number % 4 == 0 else (0, 0, FOOT)
        parts.append(cylinder(head + rake, head, 0.55, sides=12))
    return parts


def _moorings(rng: np.random.Generator) -> list[Mesh]:
    """Mooring dolphins with caps, a sunken pontoon and an anchor block with its chain on the bed."""
    parts = []
    for east, north in ((-24, 40), (4, 46), (58, -42), (72, -74), (-46, 12), (26, -88)):
        for turn in 2 * np.pi * (np.arange(4) + rng.random()) / 4:
            foot = (east + 3 * np.cos(turn), north + 3 * np.sin(turn), FOOT)
            parts.append(cylinder(foot, (east + np.cos(turn), north + np.sin(turn), 3.5), 0.5, sides=12))
        parts.append(box((east, north, 4.0), (3.2, 3.2, 1.2), Rotation.from_euler("z", rng.uniform(0, 1.5))))
    pontoon = box((60, -8, -12.0), (22, 9, 4), Rotation.from_euler("ZYX", (0.7, 0.12, -0.2)))
    return [*parts, pontoon, box((-20, -60, -13.5), (4, 4, 3)), cylinder((-20, -60, -12.5), (14, -49, -14.5), 0.4)]
