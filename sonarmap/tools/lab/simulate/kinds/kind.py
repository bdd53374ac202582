"""A pair of scans of some kind with both true poses, the scenes of the kinds, and pairs of two views of a scene."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal
from zlib import crc32

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.random_pairs import DROPOUTS, GHOSTS, OUTLIERS, POSE_TILT, SPECKLE
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments, measure_pose
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, bare
from sonarmap.tools.lab.simulate.viewpoints import FAR, Observer, View, aside, attitude, draw_views

# Structure of a scene: "flat", hardly any; "weak", low relief or few objects; "rich", in all directions; "twins", rich,
# but looking the same from several sides or places
Relief = Literal["flat", "weak", "rich", "twins"]

# Least and greatest overlaps of pairs, in turns
OVERLAPS = ((0.2, 0.4), (0.4, 0.6), (0.6, 0.9))
# Streams of a pair's seed for the errors of the target's and the source's instruments
_STREAMS = (71, 72)

# Scenes of a kind, in turns: one flat, two weak, five rich, three with twins; an odd number, so that settings that
# alternate with the number of the pair alternate in every scene
LARGE_AND_SMALL = (
    *("flatbed", "floodgate", "seabed", "ship", "bridge", "shallow"),
    *("manifold", "wreck", "harbor", "pool", "clutter"),
)
SMALL = ("pool", "rubble", "shallow", "manifold", "sandflat")
# For sonars that look down: the pool instead of a ship's underside, and the rubble instead of the pool
FROM_ABOVE = tuple({"ship": "pool", "pool": "rubble"}.get(scene, scene) for scene in LARGE_AND_SMALL)


@dataclass(frozen=True, slots=True)
class KindPair:
    """A simulated pair of scans."""

    kind: str  # a key of SCAN_KINDS
    number: int  # of the pair in the set
    seed: int  # of the set
    scene: str  # a key of SCENE_KINDS
    target: Scan  # in its own frame (x forward, y left, z up), without a prior
    source: Scan  # likewise
    T_world_target: RigidTransform  # true pose of the frame; world East-North-Up
    T_world_source: RigidTransform  # likewise
    # overlap, 0..1: share of the points, free of noise and distortion, that have a counterpart in the other scan, the
    # smaller of both directions
    shared: float

    @property
    def relief(self) -> Relief:
        """Relief of the scene."""
        return RELIEF_OF[self.scene]

    @property
    def T_target_source(self) -> RigidTransform:
        """True transform between the frames."""
        return self.T_world_target.inv() * self.T_world_source

    def with_priors(self, instruments: Instruments) -> "KindPair":
        """The pair with measured priors of its poses; their errors depend only on the seed and the number."""
        generators = (np.random.default_rng([self.seed, self.number, stream]) for stream in _STREAMS)
        target, source = (
            replace(scan, prior=measure_pose(pose, instruments, rng))
            for scan, pose, rng in zip(
                (self.target, self.source), (self.T_world_target, self.T_world_source), generators, strict=True
            )
        )
        return replace(self, target=target, source=source)


_SCENES_OF: dict[Relief, tuple[str, ...]] = {
    "flat": ("flatbed", "sandflat"),
    "weak": ("seabed", "shallow"),
    "rich": ("floodgate", "harbor", "wreck", "bridge", "clutter", "rubble"),
    "twins": ("ship", "manifold", "pool"),
}
RELIEF_OF: Mapping[str, Relief] = {scene: relief for relief, scenes in _SCENES_OF.items() for scene in scenes}

ROUGH_SCENES = tuple(scene for scene, relief in RELIEF_OF.items() if relief != "flat")


SIGMA2 = (0.25, 1.0, 4.0)  # variances of the range at the sensor's maximum range in a scene of 256 m [m^2], in turns
OPEN_BED = 1 / 16  # factor of these variances over an open bed, whose relief they would hide
MOUNTED = np.deg2rad(30.0)  # tilt of a level fan over an open bed [rad]
OPEN = ("sandflat", "shallow", "rubble")


@dataclass(frozen=True, slots=True)
class PairDraws:
    """The seed of a pair's scene, and generators of its poses, its distortion, and the noise of either scan."""

    scene: int
    poses: np.random.Generator
    distortion: np.random.Generator
    target: np.random.Generator
    source: np.random.Generator


def pair_draws(kind: str, number: int, seed: int) -> PairDraws:
    """Draws of pair `number` of the set `seed` of one kind; no two kinds share generators."""
    sequence = np.random.SeedSequence([seed, number, crc32(kind.encode())])
    scene = int(sequence.generate_state(1)[0])
    return PairDraws(scene, *(np.random.default_rng(child) for child in sequence.spawn(4)))


def noise_of(number: int, scenes: Sequence[str]) -> Noise:
    """Noise of pair `number`, whose scenes take turns; nine turns combine every overlap with every variance."""
    turn, scene = number // len(scenes), scenes[number % len(scenes)]
    sigma2 = SIGMA2[(number + turn + turn // len(SIGMA2)) % len(SIGMA2)] * SCENE_KINDS[scene].scale ** 2
    if RELIEF_OF[scene] in ("flat", "weak"):
        sigma2 *= OPEN_BED
    return Noise(sigma2, OUTLIERS, DROPOUTS, GHOSTS, SPECKLE)


def observer_of(scene: str, seed: int) -> Observer:
    """The bare fan of the sensor that suits the scene, mounted nose down over an open bed."""
    world = build_scene(scene, seed)
    sensor = bare(SENSORS[world.kind.sensor])
    return Observer(world, replace(sensor, tilt=float(MOUNTED)) if scene in OPEN else sensor)


@dataclass(frozen=True, slots=True)
class Shot:
    """A view to measure, its noise, and the generators to draw from."""

    observer: Observer
    view: View  # noise-free
    noise: Noise  # in addition to the distortion
    distortion: np.random.Generator
    rng: np.random.Generator  # of the noise
    name: str  # "target" or "source"
    number: int = 0  # of the pair

    @property
    def stamp(self) -> float:
        """0 for the target, 1 for the source [s]."""
        return float(self.name == "source")


@dataclass(frozen=True, slots=True)
class ViewKind:
    """A kind of pair: two views of a scene, each measured with the kind's distortion."""

    name: str  # a key of SCAN_KINDS
    scenes: tuple[str, ...]  # keys of SCENE_KINDS, in turns; every relief is among them
    measured: Callable[[Shot], Scan]  # makes the scan of a view
    # makes the observer of a scan from a still one
    equip: Callable[[Observer, np.random.Generator], Observer] = lambda still, rng: still

    def pair(self, number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
        """Simulate pair `number` of the set `seed`. Raises InputError: the scene has no such pair."""
        draws, noise = pair_draws(self.name, number, seed), noise_of(number, self.scenes)
        still = observer_of(scene, draws.scene)
        observers = self.equip(still, draws.poses), self.equip(still, draws.poses)
        draw_source = partial(_draw_source, observers[1], overlaps=overlaps, rng=draws.poses)
        target, source, shared = draw_views(observers, overlaps, POSE_TILT, draw_source, draws.poses)
        scans = [
            self.measured(Shot(observers[0], target, noise, draws.distortion, draws.target, "target", number)),
            self.measured(Shot(observers[1], source, noise, draws.distortion, draws.source, "source", number)),
        ]
        poses = target.T_world_sensor, source.T_world_sensor
        return KindPair(self.name, number, seed, scene, scans[0], scans[1], *poses, shared)


ACROSS = 0.5  # share of sources that look at the middle of the target's view; the others are beside the target
REACH = (0.6, 1.3)  # distance of such a source from that middle, in shares of the target's


def _draw_source(
    observer: Observer, target: View, overlaps: tuple[float, float], rng: np.random.Generator
) -> RigidTransform:
    """Draw T_world_frame of a source that may have such an overlap."""
    if rng.random() < ACROSS:
        return _across(observer, target, overlaps, rng)
    place, turned = aside(observer, target, overlaps, rng)
    heading = target.T_world_sensor.rotation.as_euler("ZYX")[0]
    return RigidTransform.from_components(place, attitude(heading + turned, POSE_TILT, rng))


def _across(
    observer: Observer, target: View, overlaps: tuple[float, float], rng: np.random.Generator
) -> RigidTransform:
    """Draw T_world_frame within the scene that looks at the middle of the target's view, or past it, from any side."""
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
