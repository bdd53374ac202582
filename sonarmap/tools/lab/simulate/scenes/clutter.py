"""Scenes without a plan: random solids over a rough bed, for developing on more than one kind."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import SCENE_EDGE, boulders, height_at, relief, scene_of, tilted
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.shapes.solids import Mesh, box, cylinder, ellipsoid, wall

BED_DEPTH = -18.0
SOLIDS = 60
RUBBLE_DEPTH = -9.0  # of the bed of the scene made smaller [m]


def clutter(seed: int) -> Mesh:
    """The scene from `seed`, 256 m on a side: boxes, cylinders, ellipsoids and bent walls at random."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
    height = tilted(BED_DEPTH, 0.04, rng) + 1.8 * relief(rng)
    solids = [_solid(height, rng) for _ in range(SOLIDS)]
    return scene_of(height, solids, boulders(height, 70, rng))


def rubble(seed: int) -> Mesh:
    """The same kind of scene made smaller in all three directions, 40 m on a side, 9 m under the water."""
    large, scale = clutter(seed), SCENE_KINDS["rubble"].scale
    return Mesh(scale * (large.vertices - (0.0, 0.0, BED_DEPTH)) + (0.0, 0.0, RUBBLE_DEPTH), large.triangles)


def _solid(height: np.ndarray, rng: np.random.Generator) -> Mesh:
    """One solid that stands on the bed, leans, or hangs in the water above it."""
    place = rng.uniform(-SCENE_EDGE / 2 + 10, SCENE_EDGE / 2 - 10, 2)
    ground = height_at(height, *place)
    turn = Rotation.from_euler("ZYX", rng.uniform((0, -0.5, -0.5), (2 * np.pi, 0.5, 0.5)))
    kind = rng.integers(4)
    if kind == 0:
        return box((*place, ground + rng.uniform(0, 12)), rng.uniform((3, 2, 2), (22, 12, 16)), turn)
    if kind == 1:
        axis = turn.apply((0, 0, rng.uniform(8, 32)))
        foot = np.array((*place, ground - 2))
        return cylinder(foot, foot + axis, rng.uniform(0.5, 3.5))
    if kind == 2:
        return ellipsoid((*place, ground + rng.uniform(0, 10)), rng.uniform(2, 9, 3), turn)
    legs = np.cumsum(rng.uniform(-22, 22, (rng.integers(2, 4), 2)), axis=0)
    path = np.concatenate([[place], place + legs])
    return wall(path, rng.uniform(1, 3), ground - 6, ground + rng.uniform(6, 24))
