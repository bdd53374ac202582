"""Random pairs of scans with a given overlap or with nothing in common, and reproducible sets of such pairs."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS, scene_kind
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise, measure, scan_of
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, Sensor, bare
from sonarmap.tools.lab.simulate.viewpoints import Observer, View, aside, attitude, draw_views, first_view

Turn = Literal["view", "yaw", "any"]
POSE_TILT = math.radians(10.0)  # largest roll and pitch of a vessel [rad]


@dataclass(frozen=True, slots=True)
class FrameTurn:
    """Random part of a pair's relative rotation, drawn before its poses."""

    # "view": the source's frame is its sensor's. "yaw": it is turned about z by any angle and tilted, so that
    # R_target_frame has the roll and pitch below. "any": R_target_frame is `R`.
    turn: Turn
    about_z: float  # rotation of the frame about its z axis, -pi..pi [rad]
    pitch: float  # of R_target_frame = Rz(yaw) Ry(pitch) Rx(roll) [rad]
    roll: float  # likewise [rad]
    R: Rotation  # uniform on SO(3)

    def R_target_sensor(self, aside: float, share: float) -> Rotation:
        """Attitude of a source sensor whose view is turned by `aside` [rad] about z and by a `share` of the tilt, 0..1.

        With a share of 1 the source's frame is its sensor's, turned about z.
        """
        tilted = Rotation.from_euler("ZYX", (aside + self.about_z, share * self.pitch, share * self.roll))
        return tilted * Rotation.from_euler("z", -self.about_z)

    def R_target_frame(self, R_target_sensor: Rotation) -> Rotation:
        """Attitude of the source's frame, given that of its sensor, for the turns "yaw" and "any"."""
        if self.turn == "any":
            return self.R
        yaw = (R_target_sensor * Rotation.from_euler("z", self.about_z)).as_euler("ZYX")[0]
        return Rotation.from_euler("ZYX", (yaw, self.pitch, self.roll))


def draw_turn(turn: Turn, max_tilt: float, rng: np.random.Generator) -> FrameTurn:
    """Draw a frame's rotation, its roll and pitch uniform up to `max_tilt` [rad]."""
    about_z = rng.uniform(-np.pi, np.pi)
    pitch, roll = rng.uniform(-max_tilt, max_tilt, 2)
    # four normal numbers have a uniform direction, and so a uniform unit quaternion
    return FrameTurn(turn, about_z, pitch, roll, Rotation.from_quat(rng.standard_normal(4)))


NOISELESS = Noise()
# Scenes of unrelated pairs; their order determines the pair of a seed. Open beds are left out, as two of them look the
# same for any seeds
STRANGERS = ("floodgate", "harbor", "clutter", "ship", "pool", "manifold", "bridge", "wreck")
# Scenes whose whole plan depends on the seed, so that two of the same name have nothing in common
DRAWN = ("clutter", "bridge", "wreck")

# Largest distance of a nearby source from the target along x, y and z, in shares of the sensor's maximum range
REACH = (1 / 3, 1 / 3, 1 / 24)


def random_pair(
    seed: int,
    overlaps: tuple[float, float] = (0.5, 0.9),
    noise: Noise = NOISELESS,
    scene: str = "clutter",
    sensor: Sensor | None = None,
    turn: Turn = "view",
    max_tilt: float = POSE_TILT,
) -> tuple[Scan, Scan, RigidTransform]:
    """Two scans of one scene from random poses whose noise-free overlap lies within `overlaps`: target Scan, source
    Scan and T_target_source between their frames, whose origins are the viewpoints.

    The overlap is the share of the points within 2 m of the other scan, the smaller of both directions; in a smaller
    scene the radius is smaller by the same factor. The seed decides the scene, the poses and the noise. `sensor`
    defaults to the bare fan of the one that suits the scene.

    With the turn "view", the source's frame is its sensor's, whose view is turned by up to 60 degrees; either pose has
    a roll and pitch up to `max_tilt` [rad]. With "yaw", the frame is also turned about its z axis by any angle, as if
    the sonar were mounted differently, and R_target_source = Rz(yaw) Ry(pitch) Rx(roll) has a uniform pitch and roll up
    to `max_tilt`. As much of the tilt as the overlap allows is the sensor's, the rest the mounting's; the smaller the
    overlap, the farther the source is moved and turned away. With "any", R_target_source is uniform on SO(3), and
    positions and views are those of "yaw". Raises InputError: no such pair for any of 8 targets.
    """
    observer = _observer(scene, seed, sensor)
    pose_seed, target_seed, source_seed, turn_seed = np.random.SeedSequence([seed, 17]).spawn(4)
    rng = np.random.default_rng(pose_seed)
    frame = draw_turn(turn, max_tilt, np.random.default_rng(turn_seed))

    def draw_source(target: View) -> RigidTransform:
        if turn == "view":
            return _nearby(observer, target, max_tilt, rng)
        # farther from the target and turned more for a smaller overlap
        place, turned = aside(observer, target, overlaps, rng)
        R_target_sensor = frame.R_target_sensor(turned, rng.random())
        return RigidTransform.from_components(place, target.T_world_sensor.rotation * R_target_sensor)

    tilt = max_tilt if turn == "view" else POSE_TILT
    target, source, _ = draw_views((observer, observer), overlaps, tilt, draw_source, rng)
    T_target_sensor = target.T_world_sensor.inv() * source.T_world_sensor
    scans = _scan(observer, target, noise, target_seed), _scan(observer, source, noise, source_seed, "source")
    if turn == "view":
        return *scans, T_target_sensor
    R_sensor_frame = T_target_sensor.rotation.inv() * frame.R_target_frame(T_target_sensor.rotation)
    return scans[0], _reframed(scans[1], R_sensor_frame), T_target_sensor * RigidTransform.from_rotation(R_sensor_frame)


def unrelated_pair(seed: int, noise: Noise, scene: str) -> tuple[Scan, Scan]:
    """Two scans with nothing in common, target and source: of `scene` and of another one of its size, by one sensor.

    The other has another name, or the same one if its whole plan depends on the seed. The source's frame is turned as
    random_pair's with the turn "yaw" and tilted by up to SET_TILT. Raises InputError: no scene of that name, or one
    without a clear place.
    """
    *view_seeds, draw_seed = np.random.SeedSequence([seed, 18]).spawn(3)
    rng = np.random.default_rng(draw_seed)
    observers = _observer(scene, seed), _observer(str(rng.choice(unrelated_scenes(scene))), seed + 1)
    frame = draw_turn("yaw", SET_TILT, rng)
    target, source = (first_view(observer, POSE_TILT, rng) for observer in observers)
    R_target_sensor = target.T_world_sensor.rotation.inv() * source.T_world_sensor.rotation
    R_sensor_frame = R_target_sensor.inv() * frame.R_target_frame(R_target_sensor)
    turned = _reframed(_scan(observers[1], source, noise, view_seeds[1], "source"), R_sensor_frame)
    return _scan(observers[0], target, noise, view_seeds[0]), turned


def unrelated_scenes(scene: str) -> tuple[str, ...]:
    """Scenes of STRANGERS, as large as `scene`, that, built from another seed, have nothing in common with it."""
    sensor = scene_kind(scene).sensor
    return tuple(name for name in STRANGERS if SCENE_KINDS[name].sensor == sensor and (name != scene or name in DRAWN))


def _observer(scene: str, seed: int, sensor: Sensor | None = None) -> Observer:
    world = build_scene(scene, seed)
    return Observer(world, bare(SENSORS[world.kind.sensor]) if sensor is None else sensor)


def _nearby(observer: Observer, target: View, max_tilt: float, rng: np.random.Generator) -> RigidTransform:
    """Draw T_world_sensor near the target's, turned by up to 60 degrees."""
    heading = target.T_world_sensor.rotation.as_euler("ZYX")[0]
    place = target.T_world_sensor.translation + observer.sensor.max_range * rng.uniform(-1, 1, 3) * REACH
    yaw = heading + rng.uniform(-np.pi / 3, np.pi / 3)
    return RigidTransform.from_components(place, attitude(yaw, max_tilt, rng))


def _scan(observer: Observer, view: View, noise: Noise, seed: np.random.SeedSequence, name: str = "target") -> Scan:
    world, sensor = observer.world, observer.sensor
    echoes = measure(world, sensor, view.T_world_sensor, view.echoes, noise, np.random.default_rng(seed))
    return scan_of(echoes, sensor, stamp=float(name == "source"), name=name)


def _reframed(scan: Scan, R_sensor_frame: Rotation) -> Scan:
    """The scan with its points in a turned frame of the same origin."""
    return replace(scan, points=R_sensor_frame.inv().apply(scan.points).astype(np.float32))


# Endless sets of pairs for the evaluation of a registration: 15 successive pairs of a scene combine every range of
# overlap with every noise. The order determines pair n: a new scene, which goes to the end, makes another set.
SET_SCENES = ("floodgate", "pool", "bridge", "harbor", "manifold", "wreck", "clutter", "ship")
SET_OVERLAPS = ((0.05, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0))
SET_SIGMA2 = (0.0, 1.0, 2.0)  # variances of the range at the sensor's maximum range in a scene of 256 m [m^2]
SET_TILT = math.radians(35.0)  # largest roll and pitch of the pairs with the turn "yaw"

OUTLIERS, DROPOUTS = 0.03, 0.2
GHOSTS, SPECKLE = 0.02, 1.0  # as in a simulated survey


@dataclass(frozen=True, slots=True)
class EvaluationPair:
    """A pair of a set, not yet simulated."""

    scene: str  # a key of SCENE_KINDS
    overlaps: tuple[float, float]  # least and greatest overlap, as in random_pair
    turn: Turn  # of the source's frame, as in random_pair
    noise: Noise  # its sigma2 is 0, 1 or 2 m^2 times the square of the scene's scale
    seed: int  # of the scene, the poses and the noise

    def scans(self) -> tuple[Scan, Scan, RigidTransform]:
        """Target Scan, source Scan and T_target_source between their frames."""
        return random_pair(self.seed, self.overlaps, self.noise, self.scene, turn=self.turn, max_tilt=SET_TILT)


@dataclass(frozen=True, slots=True)
class UnrelatedPair:
    """A pair of a set of scans with nothing in common, not yet simulated."""

    scene: str  # the target's; the source's is one of its `unrelated_scenes`, chosen by the seed
    noise: Noise  # as EvaluationPair's
    seed: int  # of the scenes, the poses and the noise

    def scans(self) -> tuple[Scan, Scan]:
        """Target Scan and source Scan; there is no true transform between them."""
        return unrelated_pair(self.seed, self.noise, self.scene)


def evaluation_pair(number: int, seed: int, turn: Turn) -> EvaluationPair:
    """Pair `number`, 0, 1, 2, ..., of the set `seed`. Raises InputError: a negative number or seed."""
    scene, noise, pair_seed = _drawn(number, seed, 1)
    return EvaluationPair(scene, SET_OVERLAPS[number % len(SET_OVERLAPS)], turn, noise, pair_seed)


def evaluation_unrelated(number: int, seed: int) -> UnrelatedPair:
    """Unrelated pair `number`, 0, 1, 2, ..., of the set `seed`. Raises InputError: a negative number or seed."""
    return UnrelatedPair(*_drawn(number, seed, 2))


def _drawn(number: int, seed: int, stream: int) -> tuple[str, Noise, int]:
    """Scene, noise and seed of a pair; the seed has 32 bits, unlike the small seeds of other scenes."""
    if number < 0 or seed < 0:
        raise InputError(f"pair {number} of the set {seed}; wanted two numbers >= 0")
    scene = SET_SCENES[number % len(SET_SCENES)]
    sigma2 = SET_SIGMA2[number // len(SET_SCENES) % len(SET_SIGMA2)] * SCENE_KINDS[scene].scale ** 2
    pair_seed = int(np.random.SeedSequence([seed, number, stream]).generate_state(1)[0])
    return scene, Noise(sigma2, OUTLIERS, DROPOUTS, GHOSTS, SPECKLE), pair_seed
