"""Multipath: what a beam brings back by way of a mirror, the water's surface or a surface of the scene."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.simulate.scenes.scene import Scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb
from sonarmap.tools.lab.simulate.sensing.sensors import Echoes, Sensor, beams, echoes_of

MIRROR_LOSS_DB = 6.0  # of an echo that goes over a mirror there and back: 3 dB each way, as from a rough bed
SKIN = 1e-3  # a mirrored ray starts this far off the mirror, so that it does not meet it again [m]


def reflect(scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform) -> Echoes:
    """The echoes of the second surface along every beam, reached over the first as over a mirror.

    A beam goes on from the first surface in the direction of the mirrored ray, meets a second one, and its echo
    comes back by the same path. The sonar knows of no mirror: it reports the length of the whole path, in the beam's
    own direction. Such a ghost lies where the second surface would be seen in the mirror, behind the first one.

    For a sensor under water the surface z = 0 is a mirror, too, and what lies above it gives no ghost; a sensor above
    it is taken for one in a world without. The strength is Lambert's law at the second surface, less 6 dB. The ranges
    are the lengths of the whole paths [m], inf where there is no second surface within the sensor's ranges.
    """
    origin, directions = beams(sensor, T_world_sensor)
    return reflect_beams(scene, sensor, np.broadcast_to(origin, directions.shape), directions)


def reflect_beams(scene: Scene, sensor: Sensor, origins: np.ndarray, directions: np.ndarray) -> Echoes:
    """As `reflect`, every beam from a place of its own: origins [m] and unit vectors, both (rows * columns, 3), world.

    All places are taken to be under water, or all above it, as the first is.
    """
    distances, normals = scene.intersect_with_normals(origins, directions)
    under_water = bool(origins[0, 2] < 0)
    if under_water:
        distances, normals = _meet_water(origins, directions, distances, normals)
    met = np.flatnonzero(np.isfinite(distances) & (distances > 0))
    mirrors = origins[met] + distances[met, None] * directions[met]
    onward, sines = _go_on(scene, mirrors, directions[met], normals[met], under_water)
    ranges, sine_grazing = np.full(len(directions), np.inf), np.zeros(len(directions))
    ranges[met] = distances[met] + onward
    sine_grazing[met] = sines
    echoes = echoes_of(sensor, ranges, sine_grazing)
    return Echoes(echoes.ranges, echoes.strengths * 10 ** (-MIRROR_LOSS_DB / 10))


def measure(
    scene: Scene, sensor: Sensor, T_world_sensor: RigidTransform, echoes: Echoes, noise: Noise, rng: np.random.Generator
) -> Echoes:
    """What a sensor reports of the `echoes` from a pose: with noise, and with ghosts where the noise has them."""
    ghosts = reflect(scene, sensor, T_world_sensor) if noise.ghosts > 0 else None
    return disturb(echoes, sensor, noise, rng, ghosts)


def _go_on(
    scene: Scene, mirrors: np.ndarray, directions: np.ndarray, normals: np.ndarray, under_water: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (M,) [m] from the mirrors, (M, 3), to the second surface, inf without one, and its grazing sines."""
    closing = np.einsum("ij,ij->i", directions, normals)[:, None]
    mirrored = directions - 2 * closing * normals
    starts = mirrors - SKIN * np.sign(closing) * normals
    shifted, second = scene.intersect_with_normals(starts, mirrored)
    seen = np.isfinite(shifted)
    ends = starts + np.where(seen, shifted, 0.0)[:, None] * mirrored
    # the distance to the second surface's plane from the mirror itself, no longer from where the ray was made to start
    slope = np.einsum("ij,ij->i", second, mirrored)
    height = np.einsum("ij,ij->i", second, ends - mirrors)
    onward = np.divide(height, slope, out=np.full(len(slope), np.inf), where=seen & (slope != 0))
    if under_water:
        onward[ends[:, 2] > 0] = np.inf
    return onward, np.minimum(np.abs(slope), 1.0)


def _meet_water(
    origins: np.ndarray, directions: np.ndarray, distances: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances and normals with the water's surface in them, where a beam from below meets it first."""
    rising = directions[:, 2] > 0
    to_water = np.full(len(directions), np.inf)
    to_water[rising] = -origins[rising, 2] / directions[rising, 2]
    first = to_water < distances
    return np.where(first, to_water, distances), np.where(first[:, None], (0.0, 0.0, 1.0), normals)
