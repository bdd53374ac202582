"""Two views of one scene whose frames lie anyhow to one another: beside, across from, or head-on."""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.pairs.random_pairs import PLACES, POSE_TILT
from sonarmap.tools.lab.simulate.pairs.viewpoints import FAR, TRIES, Observer, View, aside, attitude, first_view

ACROSS = 0.5  # share of the sources that look at the target's middle from anywhere; the others stand beside it
REACH = (0.6, 1.3)  # of such a source from that middle, in shares of the target's own distance


def draw_views(
    observers: tuple[Observer, Observer], overlaps: tuple[float, float], rng: np.random.Generator
) -> tuple[View, View]:
    """A target's view and a source's with an overlap within `overlaps`.

    Args:
        observers: the target's and the source's, of one scene.
        overlaps: least and greatest share of the points in common.
        rng: draws the poses: roll and pitch up to 10 degrees each, any heading that leaves such an overlap.

    Raises:
        InputError: no such pair of views was found from 8 places.
    """
    looker, partner = observers
    for _ in range(PLACES):
        target = first_view(looker, POSE_TILT, rng)
        poses: Callable[[], RigidTransform] = partial(_somewhere, partner, target, overlaps, rng)
        source = partner.find_partner(target, overlaps, poses)
        if source is not None:
            return target, source
    raise InputError(
        f"no two views of {looker.world.name} have an overlap within {overlaps[0]:g} to {overlaps[1]:g}: {PLACES} "
        f"targets, {TRIES} sources tried for each; widen the range or take another number"
    )


def _somewhere(
    observer: Observer, target: View, overlaps: tuple[float, float], rng: np.random.Generator
) -> RigidTransform:
    """T_world_frame of a source that may have such an overlap."""
    if rng.random() < ACROSS:
        return _across(observer, target, overlaps, rng)
    place, turned = aside(observer, target, overlaps, rng)
    heading = target.T_world_sensor.rotation.as_euler("ZYX")[0]
    return RigidTransform.from_components(place, attitude(heading + turned, POSE_TILT, rng))


def _across(
    observer: Observer, target: View, overlaps: tuple[float, float], rng: np.random.Generator
) -> RigidTransform:
    """T_world_frame that looks on any heading toward the middle of what the target sees, or past it; in the scene."""
    far = 1 - rng.uniform(*overlaps)
    edge = np.array(observer.world.kind.size) / 2
    height = target.T_world_sensor.translation[2]
    middle = np.median(target.T_world_sensor.apply(target.points), axis=0)
    distance = float(np.linalg.norm((middle - target.T_world_sensor.translation)[:2]))
    while True:
        yaw = rng.uniform(-np.pi, np.pi)
        shift = far * observer.sensor.max_range * rng.uniform(-1, 1, 3) * FAR
        back = Rotation.from_euler("z", yaw).apply((-rng.uniform(*REACH) * distance, 0.0, 0.0))
        place = np.array((middle[0], middle[1], height)) + shift + back
        if (np.abs(place[:2]) < edge).all():
            return RigidTransform.from_components(place, attitude(yaw, POSE_TILT, rng))
