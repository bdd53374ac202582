"""The ground under the water: a rough bed, boulders and sunken debris, all drawn at random."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.solids import Mesh, box, ellipsoid, height_field, merge, rod

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
