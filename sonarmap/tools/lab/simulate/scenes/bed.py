"""The ground under the water: a rough bed, boulders and sunken debris, drawn at random; and the scenes of open beds.

There is a nearly flat one, one of low relief, and one strewn with solids, each in a large and a small version. The
small one is the large one scaled down in all three directions, except for the flat bed's roughness, which is that of
sand in both.
"""

from collections.abc import Sequence
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, cylinder, ellipsoid, height_field, merge, rod, wall

SCENE_EDGE = 256.0  # side of every built scene [m]
BED_CELL = 1.6  # raster of the bed [m]

# wavelength-like scale [m] and standard deviation [m] of each octave of the bed's relief
RELIEF = ((24.0, 1.1), (10.0, 0.5), (4.0, 0.22), (1.6, 0.1))


def raster() -> np.ndarray:
    """The coordinates of the bed's raster along x or y [m], centered."""
    return np.linspace(-SCENE_EDGE / 2, SCENE_EDGE / 2, round(SCENE_EDGE / BED_CELL) + 1)


def relief(rng: np.random.Generator) -> np.ndarray:
    """Smooth random relief over several scales, on raster() x raster() [m], zero mean."""
    count = len(raster())
    total = np.zeros((count, count))
    for scale, deviation in RELIEF:
        octave = gaussian_filter(rng.standard_normal((count, count)), scale / BED_CELL / 2, mode="wrap")
        total += deviation * (octave - octave.mean()) / octave.std()
    return total


def scene_of(height: np.ndarray, *parts: Sequence[Mesh]) -> Mesh:
    """Merge the bed `height` (on the raster) and the parts on it into one mesh."""
    return merge([height_field(raster(), raster(), height), *chain(*parts)])


def tilted(level: float, most: float, rng: np.random.Generator) -> np.ndarray:
    """A plane at `level` in the middle of the raster [m], its slopes along x and y at most `most`."""
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    slope = rng.uniform(-most, most, 2)
    return level + slope[0] * x + slope[1] * y


def boulders(height: np.ndarray, count: int, rng: np.random.Generator) -> list[Mesh]:
    """Stones of 0.6 to 3 m half axes, half sunk into the bed `height` (on the raster)."""
    return [stone(height, place, (0.6, 3.0), rng) for place in _places(count, rng)]


def stone(height: np.ndarray, place: np.ndarray, sizes: tuple[float, float], rng: np.random.Generator) -> Mesh:
    """One stone, half sunk into the bed at a place, its largest half axis within `sizes` [m]."""
    radii = rng.uniform(*sizes) * rng.uniform(0.6, 1.0, 3)
    return ellipsoid(on_bed(height, place), radii, Rotation.from_quat(rng.standard_normal(4)), rings=6)


def debris(height: np.ndarray, count: int, rng: np.random.Generator) -> list[Mesh]:
    """Sunken crates, which lie askew, and trunks, in turn, on the bed `height`."""
    objects = []
    for number, (east, north) in enumerate(_places(count, rng)):
        if number % 2:
            size = rng.uniform((1.5, 1.0, 0.8), (7.0, 3.5, 2.5))
            objects.append(box(on_bed(height, (east, north), size[2] / 3), size, _leaning_turn(rng)))
        else:
            reach = _leaning_turn(rng).apply((rng.uniform(2, 6), 0, 0))
            objects.append(rod(on_bed(height, (east, north), 0.5), reach, rng.uniform(0.3, 0.8), sides=10))
    return objects


def on_bed(height: np.ndarray, place: ArrayLike, above: float = 0.0) -> np.ndarray:
    """The point (3,) [m] at a position (2,), `above` the bed `height`."""
    east, north = np.asarray(place)
    return np.array((east, north, height_at(height, east, north) + above))


def height_at(height: np.ndarray, east: float, north: float) -> float:
    """The bed's height at the raster point nearest to (east, north) [m]."""
    index = np.rint((np.array([east, north]) + SCENE_EDGE / 2) / BED_CELL).astype(int)
    i, j = np.clip(index, 0, np.array(height.shape) - 1)
    return float(height[i, j])


def _places(count: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-SCENE_EDGE / 2 + 4, SCENE_EDGE / 2 - 4, (count, 2))


def _leaning_turn(rng: np.random.Generator) -> Rotation:
    return Rotation.from_euler("ZYX", rng.uniform((0, -0.25, -0.25), (2 * np.pi, 0.25, 0.25)))


BED_DEPTH = -22.0  # mean height of the large beds [m]; small ones multiply it by their scale
ROUGHNESS = 0.025  # standard deviation of a flat bed's relief [m]
FLAT_SLOPE, WEAK_SLOPE = 0.003, 0.015  # largest slopes along x and y

# Of the large bed of low relief, least and most [m]
DUNE_LENGTH, DUNE_HEIGHT = (14.0, 32.0), (0.35, 0.8)  # crest to crest; crest above trough, divided by two
RIPPLE_LENGTH, RIPPLE_HEIGHT = (5.0, 8.0), (0.06, 0.12)
SCOURS, SCOUR_DEPTH, SCOUR_RADIUS = (3, 7), (0.5, 1.3), (5.0, 12.0)
ROCKS, ROCK_RADIUS = (8, 17), (0.5, 1.3)
BEND = 45.0  # length over which crests bend and the height of dunes varies [m]


def _flat(name: str, seed: int) -> Mesh:
    """Sand with a relief of a few centimeters, nothing on it."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 41]))
    rough = relief(rng)
    scale = SCENE_KINDS[name].scale
    height = tilted(0.0, FLAT_SLOPE, rng) + ROUGHNESS / scale * rough / rough.std()
    return _placed(scene_of(height), scale)


def _weak(name: str, seed: int) -> Mesh:
    """Dunes, ripples and scours, 0.5 to 2 m in all at 256 m on a side, and a few rocks; its plan drawn from `seed`."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 42]))
    dunes = _waves(DUNE_LENGTH, DUNE_HEIGHT, rng) * (0.3 + 0.7 * _patches(rng))
    ripples = _waves(RIPPLE_LENGTH, RIPPLE_HEIGHT, rng) * _patches(rng)
    height = tilted(0.0, WEAK_SLOPE, rng) + dunes + ripples + _scours(rng) + 0.02 * relief(rng)
    places = rng.uniform(-0.45 * SCENE_EDGE, 0.45 * SCENE_EDGE, (rng.integers(*ROCKS), 2))
    rocks = [stone(height, place, ROCK_RADIUS, rng) for place in places]
    return _placed(scene_of(height, rocks), SCENE_KINDS[name].scale)


# The builders of SCENE_KINDS
flatbed, sandflat = partial(_flat, "flatbed"), partial(_flat, "sandflat")
seabed, shallow = partial(_weak, "seabed"), partial(_weak, "shallow")


def _placed(bed: Mesh, scale: float) -> Mesh:
    """The bed, lowered to its depth and scaled to its size."""
    return Mesh(scale * (bed.vertices + np.array((0.0, 0.0, BED_DEPTH))), bed.triangles)


def _smooth(rng: np.random.Generator) -> np.ndarray:
    """A random field on the raster that varies over BEND, zero mean, standard deviation 1."""
    field = gaussian_filter(rng.standard_normal((len(raster()),) * 2), BEND / BED_CELL / 2, mode="wrap")
    return (field - field.mean()) / field.std()


def _patches(rng: np.random.Generator) -> np.ndarray:
    """Random weights, 0..1, on the raster that fade in and out over BEND."""
    return 1 / (1 + np.exp(-2.5 * _smooth(rng)))


def _waves(length: tuple[float, float], half_height: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """Rows of crests of one direction and length, bent, steeper on one side than on the other, on the raster [m]."""
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    heading, first = rng.uniform(0, 2 * np.pi, 2)
    along = 2 * np.pi * (x * np.cos(heading) + y * np.sin(heading)) / rng.uniform(*length)
    phase = along + first + 1.6 * _smooth(rng)
    return rng.uniform(*half_height) * np.sin(phase + 0.5 * np.sin(phase))


def _scours(rng: np.random.Generator) -> np.ndarray:
    """Round and long pits on the raster, heights below 0 [m]."""
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    total = np.zeros_like(x)
    for east, north in rng.uniform(-0.4 * SCENE_EDGE, 0.4 * SCENE_EDGE, (rng.integers(*SCOURS), 2)):
        heading, stretch = rng.uniform(0, np.pi), rng.uniform(1.0, 3.0)
        long = ((x - east) * np.cos(heading) + (y - north) * np.sin(heading)) / stretch
        wide = (y - north) * np.cos(heading) - (x - east) * np.sin(heading)
        total -= rng.uniform(*SCOUR_DEPTH) * np.exp(-0.5 * (long**2 + wide**2) / rng.uniform(*SCOUR_RADIUS) ** 2)
    return total


CLUTTER_DEPTH = -18.0  # mean height of the bed under the solids [m]
SOLIDS = 60  # number of solids
RUBBLE_DEPTH = -9.0  # mean height of the bed of the small version [m]


def clutter(seed: int) -> Mesh:
    """The scene from `seed`, 256 m on a side: boxes, cylinders, ellipsoids and bent walls at random."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
    height = tilted(CLUTTER_DEPTH, 0.04, rng) + 1.8 * relief(rng)
    solids = [_solid(height, rng) for _ in range(SOLIDS)]
    return scene_of(height, solids, boulders(height, 70, rng))


def rubble(seed: int) -> Mesh:
    """The clutter scaled down in all three directions, 40 m on a side, its bed 9 m under the water."""
    large, scale = clutter(seed), SCENE_KINDS["rubble"].scale
    return Mesh(scale * (large.vertices - (0.0, 0.0, CLUTTER_DEPTH)) + (0.0, 0.0, RUBBLE_DEPTH), large.triangles)


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
