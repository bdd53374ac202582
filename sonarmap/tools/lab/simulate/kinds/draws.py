"""What a pair's number, seed and kind decide, by generators of their own: scene, noise, two views of the scene.

The views' frames lie anyhow to one another: beside, across from, or head-on.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from zlib import crc32

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds.catalog import scan_kind
from sonarmap.tools.lab.simulate.kinds.kind import KindPair, relief_of
from sonarmap.tools.lab.simulate.pairs.pair_set import DROPOUTS, GHOSTS, OUTLIERS, SPECKLE
from sonarmap.tools.lab.simulate.pairs.random_pairs import PLACES, POSE_TILT
from sonarmap.tools.lab.simulate.pairs.viewpoints import FAR, TRIES, Observer, View, aside, attitude, first_view
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, bare

SIGMA2 = (0.25, 1.0, 4.0)  # of the range at the sensor's maximum range in a scene of 256 m [m^2], in turns
# On an open bed noise as large as its relief would leave nothing to register: a quarter of the standard deviation
OPEN_BED = 1 / 16
# By how much a level fan is mounted nose down over an open bed, of which it would see little else [rad]
MOUNTED = np.deg2rad(30.0)
OPEN = ("sandflat", "shallow", "rubble")


@dataclass(frozen=True, slots=True)
class PairDraws:
    """Of one pair."""

    scene: int  # the seed of the scene
    poses: np.random.Generator  # draws both poses
    distortion: np.random.Generator  # draws how the scans are distorted
    target: np.random.Generator  # draws the noise of the target
    source: np.random.Generator  # draws the noise of the source


def pair_draws(kind: str, number: int, seed: int) -> PairDraws:
    """The generators of pair `number` of the set `seed` of one kind; no two kinds share them."""
    sequence = np.random.SeedSequence([seed, number, crc32(kind.encode())])
    scene = int(sequence.generate_state(1)[0])
    return PairDraws(scene, *(np.random.default_rng(child) for child in sequence.spawn(4)))


def noise_of(kind: str, number: int, scene: str) -> Noise:
    """The noise of pair `number`: every scene meets every overlap with every variance within nine of its turns."""
    turn = number // len(scan_kind(kind).scenes)
    sigma2 = SIGMA2[(number + turn + turn // len(SIGMA2)) % len(SIGMA2)] * SCENE_KINDS[scene].scale ** 2
    if relief_of(scene) in ("flat", "weak"):
        sigma2 *= OPEN_BED
    return Noise(sigma2, OUTLIERS, DROPOUTS, GHOSTS, SPECKLE)


def observer_of(scene: str, seed: int) -> Observer:
    """The bare fan of the sensor that suits the scene, mounted nose down where it would see little else of it."""
    world = build_scene(scene, seed)
    sensor = bare(SENSORS[world.kind.sensor])
    return Observer(world, replace(sensor, tilt=float(MOUNTED)) if scene in OPEN else sensor)


@dataclass(frozen=True, slots=True)
class Shot:
    """A view that is to be measured."""

    observer: Observer  # the scene and the sensor
    view: View  # the true one
    noise: Noise  # besides the distortion
    distortion: np.random.Generator  # draws how the measurement is distorted
    rng: np.random.Generator  # draws the noise
    name: str  # "target" or "source"
    number: int = 0  # of the pair

    @property
    def stamp(self) -> float:
        """The source's is a second later."""
        return float(self.name == "source")


@dataclass(frozen=True, slots=True)
class ViewKind:
    """Pairs of two views from anywhere, each measured as the kind does."""

    name: str  # a key of SCAN_KINDS
    measured: Callable[[Shot], Scan]  # what the sonar writes down of a view
    # makes the observer of a scan of the one that is still
    equip: Callable[[Observer, np.random.Generator], Observer] = lambda still, rng: still

    def pair(self, number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
        """Pair `number` of the set `seed`. Raises InputError: the scene has no such pair."""
        draws, noise = pair_draws(self.name, number, seed), noise_of(self.name, number, scene)
        still = observer_of(scene, draws.scene)
        observers = self.equip(still, draws.poses), self.equip(still, draws.poses)
        target, source, shared = draw_views(observers, overlaps, draws.poses)
        scans = [
            self.measured(Shot(observer, view, noise, draws.distortion, rng, name, number))
            for observer, view, rng, name in (
                (observers[0], target, draws.target, "target"),
                (observers[1], source, draws.source, "source"),
            )
        ]
        poses = target.T_world_sensor, source.T_world_sensor
        return KindPair(self.name, number, seed, scene, scans[0], scans[1], *poses, shared)


ACROSS = 0.5  # share of the sources that look at the target's middle from anywhere; the others stand beside it
REACH = (0.6, 1.3)  # of such a source from that middle, in shares of the target's own distance


def draw_views(
    observers: tuple[Observer, Observer], overlaps: tuple[float, float], rng: np.random.Generator
) -> tuple[View, View, float]:
    """A target's view and a source's of one scene, and what they share, within `overlaps`: roll and pitch up to 10
    degrees each, on any heading that leaves such an overlap. Raises InputError: none found from 8 places."""
    looker, partner = observers
    for _ in range(PLACES):
        target = first_view(looker, POSE_TILT, rng)
        poses: Callable[[], RigidTransform] = partial(_somewhere, partner, target, overlaps, rng)
        found = partner.find_partner(target, overlaps, poses)
        if found is not None:
            return target, *found
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
