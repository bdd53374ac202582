"""Random pairs of scans, with a wanted overlap or with nothing in common, and sets of them, the same for a seed."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS, scene_kind
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise, measure, scan_of
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, Sensor, bare
from sonarmap.tools.lab.simulate.viewpoints import TRIES, Observer, View, aside, attitude, first_view

Turn = Literal["view", "yaw", "any"]
POSE_TILT = math.radians(10.0)  # of a vessel, largest roll and pitch


@dataclass(frozen=True, slots=True)
class FrameTurn:
    """What is drawn of a pair's relative rotation before its poses are."""

    # "view": the frame is the sensor's own. "yaw": it is turned about z by any angle, and tilted, so that roll and
    # pitch of R_target_frame are those below. "any": R_target_frame is `R`.
    turn: Turn
    about_z: float  # by how much the frame is turned about its z, -pi..pi [rad]
    pitch: float  # of R_target_frame = Rz(yaw) Ry(pitch) Rx(roll) [rad]
    roll: float  # of the same [rad]
    R: Rotation  # uniform on SO(3)

    def R_target_sensor(self, aside: float, share: float) -> Rotation:
        """The attitude of a source whose view differs by `aside` [rad] about z, and by a `share` of the tilt, 0..1.

        With all of it the source's frame is its sensor's, turned about z.
        """
        tilted = Rotation.from_euler("ZYX", (aside + self.about_z, share * self.pitch, share * self.roll))
        return tilted * Rotation.from_euler("z", -self.about_z)

    def R_target_frame(self, R_target_sensor: Rotation) -> Rotation:
        """The attitude of the source's frame, whatever that of its sensor."""
        if self.turn == "view":
            return R_target_sensor
        if self.turn == "any":
            return self.R
        yaw = (R_target_sensor * Rotation.from_euler("z", self.about_z)).as_euler("ZYX")[0]
        return Rotation.from_euler("ZYX", (yaw, self.pitch, self.roll))


@dataclass(frozen=True, slots=True)
class Turning:
    """How the source's frame may be turned against the target's."""

    # "view": it is its sensor's own, whose view is turned by up to 60 degrees. "yaw": besides the difference of view
    # the frame is turned about its own z by any angle, as that of a sonar mounted otherwise. As much of the tilt as the
    # overlap allows is the sensor's, the rest its mounting's. The smaller the overlap, the farther the source is moved
    # and turned aside. "any": R_target_source is uniform on SO(3); places and views are those of "yaw".
    kind: Turn = "view"
    # largest roll and pitch of either pose [rad]; with "yaw" of R_target_source = Rz(yaw) Ry(pitch) Rx(roll), over
    # which they are spread evenly
    max_tilt: float = POSE_TILT


LITTLE_TURNED = Turning()


def draw_turn(turning: Turning, rng: np.random.Generator) -> FrameTurn:
    """A frame's turn, its roll and pitch uniform up to the largest tilt."""
    about_z = rng.uniform(-np.pi, np.pi)
    pitch, roll = rng.uniform(-turning.max_tilt, turning.max_tilt, 2)
    # a normal vector of four numbers points anywhere evenly, and so does its unit quaternion
    return FrameTurn(turning.kind, about_z, pitch, roll, Rotation.from_quat(rng.standard_normal(4)))


NOISELESS = Noise()
PLACES = 8  # of the target, before a pair is given up
# The scenes that unrelated pairs are drawn from, in this order: it decides which pair a seed is. Open beds are not
# among them: two of them look the same whatever their seeds
STRANGERS = ("floodgate", "harbor", "clutter", "ship", "pool", "manifold", "bridge", "wreck")
# Those of them whose plan another seed draws anew, so that two of them have nothing in common
DRAWN = ("clutter", "bridge", "wreck")

# Of a nearby source, from the target, in shares of the sensor's maximum range
REACH = (1 / 3, 1 / 3, 1 / 24)


def random_pair(
    seed: int,
    overlaps: tuple[float, float] = (0.5, 0.9),
    noise: Noise = NOISELESS,
    scene: str = "clutter",
    sensor: Sensor | None = None,
    turning: Turning = LITTLE_TURNED,
) -> tuple[Scan, Scan, RigidTransform]:
    """Two scans of one scene from random poses whose noise-free overlap lies within `overlaps`: target Scan, source
    Scan and T_target_source between their frames, whose origins are the viewpoints.

    The overlap is the share of the points within 2 m of the other scan, the smaller of both ways; in a smaller scene
    the radius is smaller by the same factor. The seed decides the scene, the poses and the noise. Without a sensor, the
    bare fan of the one that suits the scene is taken. Raises InputError: no such pair from 8 places.
    """
    observer = _observer(scene, seed, sensor)
    pose_seed, target_seed, source_seed, turn_seed = np.random.SeedSequence([seed, 17]).spawn(4)
    rng = np.random.default_rng(pose_seed)
    frame = draw_turn(turning, np.random.default_rng(turn_seed))
    target, source = _views(observer, overlaps, frame, turning.max_tilt, rng)
    T_target_sensor = target.T_world_sensor.inv() * source.T_world_sensor
    scans = (
        _scan(observer, target, noise, target_seed, 0.0, "target"),
        _scan(observer, source, noise, source_seed, 1.0, "source"),
    )
    if turning.kind == "view":
        return *scans, T_target_sensor
    R_sensor_frame = T_target_sensor.rotation.inv() * frame.R_target_frame(T_target_sensor.rotation)
    return scans[0], _reframed(scans[1], R_sensor_frame), T_target_sensor * RigidTransform.from_rotation(R_sensor_frame)


def unrelated_pair(seed: int, noise: Noise, max_tilt: float, scene: str) -> tuple[Scan, Scan]:
    """Two scans that share nothing, target and source: of `scene` and another scene of its size, by the same sensor.

    The other is of another kind, or of the same kind if a seed draws its whole plan. The source's frame is turned as
    random_pair's with the turn "yaw" and tilted by up to `max_tilt` [rad]. Raises InputError: no scene of that name, or
    one without a clear place.
    """
    *view_seeds, draw_seed = np.random.SeedSequence([seed, 18]).spawn(3)
    rng = np.random.default_rng(draw_seed)
    observers = _observer(scene, seed), _observer(str(rng.choice(unrelated_scenes(scene))), seed + 1)
    frame = draw_turn(Turning("yaw", max_tilt), rng)
    target, source = (first_view(observer, POSE_TILT, rng) for observer in observers)
    R_target_sensor = target.T_world_sensor.rotation.inv() * source.T_world_sensor.rotation
    R_sensor_frame = R_target_sensor.inv() * frame.R_target_frame(R_target_sensor)
    return (
        _scan(observers[0], target, noise, view_seeds[0], 0.0, "target"),
        _reframed(_scan(observers[1], source, noise, view_seeds[1], 1.0, "source"), R_sensor_frame),
    )


def unrelated_scenes(scene: str) -> tuple[str, ...]:
    """Those of STRANGERS of about the size of `scene` that, built from another seed, have nothing in common with it."""
    sensor = scene_kind(scene).sensor
    return tuple(name for name in STRANGERS if SCENE_KINDS[name].sensor == sensor and (name != scene or name in DRAWN))


def _observer(scene: str, seed: int, sensor: Sensor | None = None) -> Observer:
    world = build_scene(scene, seed)
    return Observer(world, bare(SENSORS[world.kind.sensor]) if sensor is None else sensor)


def _views(
    observer: Observer, overlaps: tuple[float, float], frame: FrameTurn, max_tilt: float, rng: np.random.Generator
) -> tuple[View, View]:
    """Of the target, from the first place that has one, and of the source."""
    tilt = max_tilt if frame.turn == "view" else POSE_TILT
    for _ in range(PLACES):
        target = first_view(observer, tilt, rng)
        poses: Callable[[], RigidTransform]
        if frame.turn == "view":
            poses = partial(_nearby, observer, target, max_tilt, rng)
        else:
            poses = partial(_aside, observer, target, overlaps, frame, rng)
        found = observer.find_partner(target, overlaps, poses)
        if found is not None:
            return target, found[0]
    raise InputError(
        f"no pose in {observer.world.name} has an overlap within {overlaps[0]:g} to {overlaps[1]:g} with one of "
        f"{PLACES} targets, {TRIES} tried for each; widen the range or take another seed"
    )


def _nearby(observer: Observer, target: View, max_tilt: float, rng: np.random.Generator) -> RigidTransform:
    """T_world_sensor not far from the target's, turned by up to 60 degrees."""
    heading = target.T_world_sensor.rotation.as_euler("ZYX")[0]
    place = target.T_world_sensor.translation + observer.sensor.max_range * rng.uniform(-1, 1, 3) * REACH
    yaw = heading + rng.uniform(-np.pi / 3, np.pi / 3)
    return RigidTransform.from_components(place, attitude(yaw, max_tilt, rng))


def _aside(
    observer: Observer, target: View, overlaps: tuple[float, float], frame: FrameTurn, rng: np.random.Generator
) -> RigidTransform:
    """T_world_sensor moved and turned aside, the farther the less is to be shared; within the scene."""
    place, turned = aside(observer, target, overlaps, rng)
    R_target_sensor = frame.R_target_sensor(turned, rng.random())
    return RigidTransform.from_components(place, target.T_world_sensor.rotation * R_target_sensor)


def _scan(observer: Observer, view: View, noise: Noise, seed: np.random.SeedSequence, stamp: float, name: str) -> Scan:
    world, sensor = observer.world, observer.sensor
    echoes = measure(world, sensor, view.T_world_sensor, view.echoes, noise, np.random.default_rng(seed))
    return scan_of(echoes, sensor, stamp=stamp, name=name)


def _reframed(scan: Scan, R_sensor_frame: Rotation) -> Scan:
    """The scan with its points in a turned frame of the same origin."""
    R_frame_sensor = R_sensor_frame.inv()
    points = R_frame_sensor.apply(scan.points).astype(np.float32)
    if scan.viewpoints is None:
        return replace(scan, points=points)
    return replace(scan, points=points, viewpoints=R_frame_sensor.apply(scan.viewpoints).astype(np.float32))


# Sets of pairs to evaluate a registration on, without an end: 15 pairs of each scene in a row meet every range of
# overlap with every noise. The order decides what pair n is: a new scene is appended, and makes another set.
SET_SCENES = ("floodgate", "pool", "bridge", "harbor", "manifold", "wreck", "clutter", "ship")
SET_OVERLAPS = ((0.05, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0))
SET_SIGMA2 = (0.0, 1.0, 2.0)  # of the range at the sensor's maximum range in a scene of 256 m [m^2]
SET_TILT = math.radians(35.0)  # largest roll and pitch of the pairs with the turn "yaw"

OUTLIERS, DROPOUTS = 0.03, 0.2
GHOSTS, SPECKLE = 0.02, 1.0  # as in a simulated survey


@dataclass(frozen=True, slots=True)
class EvaluationPair:
    """One pair of a set, before it is simulated."""

    number: int  # which of the set
    scene: str  # a key of SCENE_KINDS
    overlaps: tuple[float, float]  # least and greatest share of the points in common, as random_pair takes them
    turn: Turn  # of the source's frame, as `Turning` has it
    noise: Noise  # its sigma2 is 0, 1 or 2 m^2 times the square of the scene's scale
    seed: int  # of the scene, the poses and the noise

    def scans(self) -> tuple[Scan, Scan, RigidTransform]:
        """Target Scan, source Scan and T_target_source between their frames."""
        return random_pair(self.seed, self.overlaps, self.noise, self.scene, turning=Turning(self.turn, SET_TILT))


@dataclass(frozen=True, slots=True)
class UnrelatedPair:
    """One pair of a set of scans that share nothing, before it is simulated."""

    number: int  # which of the set
    scene: str  # the target's; the source's is one of its `unrelated_scenes`, chosen by the seed
    noise: Noise  # as EvaluationPair's
    seed: int  # of the scenes, the poses and the noise

    def scans(self) -> tuple[Scan, Scan]:
        """Target Scan and source Scan; no transform is true between them."""
        return unrelated_pair(self.seed, self.noise, SET_TILT, self.scene)


def evaluation_pair(number: int, seed: int, turn: Turn) -> EvaluationPair:
    """Pair `number`, 0, 1, 2, ..., of the set `seed`. Raises InputError: a negative number or seed."""
    scene = _of_scenes(number, seed)
    return EvaluationPair(
        number,
        scene,
        SET_OVERLAPS[number % len(SET_OVERLAPS)],
        turn,
        _noise(number, scene),
        _seed_of(number, seed, 1),
    )


def evaluation_unrelated(number: int, seed: int) -> UnrelatedPair:
    """Unrelated pair `number`, 0, 1, 2, ..., of the set `seed`. Raises InputError: a negative number or seed."""
    scene = _of_scenes(number, seed)
    return UnrelatedPair(number, scene, _noise(number, scene), _seed_of(number, seed, 2))


def _of_scenes(number: int, seed: int) -> str:
    if number < 0 or seed < 0:
        raise InputError(f"pair {number} of the set {seed}; wanted two numbers >= 0")
    return SET_SCENES[number % len(SET_SCENES)]


def _noise(number: int, scene: str) -> Noise:
    sigma2 = SET_SIGMA2[number // len(SET_SCENES) % len(SET_SIGMA2)] * SCENE_KINDS[scene].scale ** 2
    return Noise(sigma2, OUTLIERS, DROPOUTS, GHOSTS, SPECKLE)


def _seed_of(number: int, seed: int, what: int) -> int:
    """A seed of 32 bits: the pairs' scenes are ones that no test and no page has met."""
    return int(np.random.SeedSequence([seed, number, what]).generate_state(1)[0])
