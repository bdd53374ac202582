"""A stacked imaging sonar: images of range and azimuth, taken at many depths or tilts, without elevation.

Every echo is placed at the middle elevation of its beam. The beams are those of a Blueprint Oculus in real stacks of a
swimming pool: 256 azimuths, evenly spaced in their sine. The constants below are those of these stacks.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.kinds.kind import FROM_ABOVE
from sonarmap.tools.lab.simulate.kinds.partners import Instrument, SweepKind
from sonarmap.tools.lab.simulate.kinds.sweep import Fan, Returns, Sweep, Water, pick, walk
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor
from sonarmap.tools.lab.simulate.viewpoints import heading_at

BEAMS, RAYS = 256, 11
AZIMUTHS = math.radians(130)
APERTURES = (math.radians(15), math.radians(25))  # of a beam in elevation, least and greatest
TILTED_APERTURE = math.radians(12)  # of a stack of tilts: the narrow beam of a higher frequency
IMAGES = (90, 150)  # number of images of a stack, the upper end excluded
HOVERING = (0.2, 0.45)  # share of the images of a stack of depths at its lowest depth
TILTS = (math.radians(8), math.radians(58))  # of the beam's middle below the horizontal, first and last
ABOVE = (0.06, 0.16)  # height of a stack of tilts above the ground, in shares of the maximum range
WALLED = ("floodgate", "harbor", "bridge", "pool")  # scenes with walls to see from beside them
STACKED_BY_DEPTH = 2 / 3  # share of stacks of depths in these scenes
THRESHOLD = 0.005  # of an echo, relative to that of a near wall
DETECTORS = (0.25, 1.0)  # share of the strongest echo's energy at which the first one is detected

# Standard deviations at either end of a stack against its middle
DRIFT = 1.1  # East and North in a scene of 256 m [m], times the root of the scale: 0.35 m in a pool
YAW_DRIFT = math.radians(1.5)
MOUNT = math.radians(1.0)  # standard deviation of the errors of the sonar's pitch and roll
FRAME_TILT = math.radians(0.5)  # standard deviation of roll and pitch of a stack's frame

MULTIPATH = (0.01, 0.05)  # share of the echoes that are multipath, by a second surface or the vehicle
AGAIN = 0.5  # share of these that travel to the first surface and back twice
SIDE_LOBES = (0.01, 0.04)  # share of beams with the image's strongest echo, through a side lobe


@dataclass(frozen=True, slots=True)
class Imager(Instrument):
    """An imaging sonar on its vehicle."""

    pulse = 1 / 400
    by_depth: bool  # whether images are stacked over depths, else over tilts
    detector: float  # share of the strongest echo's energy at which an earlier one is detected
    multipath: float  # share of the beams whose echo is multipath
    side_lobes: float  # share of the beams with the strongest echo of the image instead of their own

    def target(self, rng: np.random.Generator) -> Sweep:
        """Draw a stack anywhere in the scene."""
        place = self.water.place(rng)
        return self._stack(place, heading_at(place, self.water.scene.kind, rng), rng)

    def source(self, target: Sweep, overlaps: tuple[float, float], rng: np.random.Generator) -> Sweep:
        """Draw a stack beside the target, farther away and turned more for a smaller overlap."""
        far = 1 - rng.uniform(*overlaps)
        here, heading = target.T_world_frame.translation, target.T_world_frame.rotation.as_euler("ZYX")[0]
        reach = min(self.fan.sensor.max_range, self.water.edge.min()) * 0.6
        if not self.by_depth:
            reach = min(reach, 4 * (here[2] - self.water.bed))
        return self._stack(
            here[:2] + far * reach * rng.uniform(-1, 1, 2), heading + far * rng.uniform(-1, 1) * AZIMUTHS, rng
        )

    def returns(
        self, ranges: np.ndarray, strengths: np.ndarray, sweep: Sweep, rng: np.random.Generator | None
    ) -> Returns:
        """One echo per beam, speckled; some are multipath, some came through a side lobe."""
        cell = self.pulse * self.fan.sensor.max_range
        if rng is None:
            return pick(self.fan, ranges, strengths, cell, self.detector)
        speckled = strengths * rng.standard_exponential(strengths.shape)
        returns = self._add_multipath(pick(self.fan, ranges, speckled, cell, self.detector), sweep, rng)
        return self._add_side_lobes(returns, rng)

    def _add_multipath(self, returns: Returns, sweep: Sweep, rng: np.random.Generator) -> Returns:
        """Replace a share of the echoes by multipath: by a second surface that the first one mirrors, or twice over the
        first one by the vehicle or the water's surface."""
        chosen = (rng.random(returns.ranges.shape) < self.multipath) & np.isfinite(returns.ranges)
        again = rng.random(returns.ranges.shape)[chosen] < AGAIN
        ping, beam = np.nonzero(chosen)
        poses, scene = sweep.T_world_ping[ping], self.water.scene
        onward = poses.rotation.apply(self.fan.rays[beam, returns.rays[chosen]])
        first, normals = scene.intersect_with_normals(poses.translation, onward)
        closing = np.einsum("ij,ij->i", onward, normals)[:, None]
        mirrors = poses.translation + returns.ranges[chosen][:, None] * onward - 1e-3 * np.sign(closing) * normals
        second, _ = scene.intersect(mirrors, onward - 2 * closing * normals)
        ranges = returns.ranges.copy()
        ranges[chosen] = np.where(again | np.isinf(second), 2 * first, first + second)
        in_range = ranges <= self.fan.sensor.max_range
        return Returns(np.where(in_range, ranges, np.inf), np.where(in_range, returns.strengths, 0.0), returns.rays)

    def _add_side_lobes(self, returns: Returns, rng: np.random.Generator) -> Returns:
        """Move a share of the echoes to the range of their image's strongest echo: arcs of constant range."""
        loudest = returns.strengths.argmax(axis=1)[:, None]
        chosen = (rng.random(returns.ranges.shape) < self.side_lobes) & (returns.strengths.max(axis=1) > 0)[:, None]
        return Returns(
            np.where(chosen, np.take_along_axis(returns.ranges, loudest, 1), returns.ranges),
            np.where(chosen, self.fan.sensor.threshold, returns.strengths),
            returns.rays,
        )

    def _stack(self, place: np.ndarray, heading: float, rng: np.random.Generator) -> Sweep:
        """Draw a stack of images over depths or tilts, from a vehicle with unknown drift."""
        count, scale = int(rng.integers(*IMAGES)), self.water.scale
        height, tilt = self._depths(place, count, rng) if self.by_depth else self._tilts(place, count, rng)
        middle = height[count // 2]
        errors = rng.normal(0.0, MOUNT, 2)
        drift = walk(count, (DRIFT * math.sqrt(scale), DRIFT * math.sqrt(scale), YAW_DRIFT), rng)
        believed = np.column_stack([np.zeros((count, 2)), height - middle])
        shift = np.column_stack([drift[:, :2], np.zeros(count)])
        level = np.zeros(count)
        T_frame_ping = RigidTransform.from_components(
            believed + shift,
            Rotation.from_euler("ZYX", np.column_stack([drift[:, 2], tilt + errors[0], level + errors[1]])),
        )
        T_frame_believed = RigidTransform.from_components(
            believed, Rotation.from_euler("ZYX", np.column_stack([level, tilt, level]))
        )
        T_world_frame = RigidTransform.from_components(
            (*place, middle), Rotation.from_euler("ZYX", (heading, *rng.normal(0.0, FRAME_TILT, 2)))
        )
        return Sweep(T_world_frame, T_frame_ping, T_frame_believed)

    def _depths(self, place: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Heights [m] from below the surface down to above the ground, where it hovers; tilts of 0 [rad]."""
        low, top = float(self.water.ground(place[None])[0]), self.water.top
        clear = 0.1 * (top - low)
        hovering = round(rng.uniform(*HOVERING) * count)
        heights = np.concatenate(
            [np.linspace(top - clear, low + clear, count - hovering), np.full(hovering, low + clear)]
        )
        return heights, np.zeros(count)

    def _tilts(self, place: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """One height [m] above the ground; tilts [rad] from nearly level to steep."""
        above = rng.uniform(*ABOVE) * self.fan.sensor.max_range
        height = min(float(self.water.ground(place[None])[0]) + above, self.water.top - 0.02 * above)
        return np.full(count, height), np.linspace(*TILTS, count)


def imager(water: Water, rng: np.random.Generator) -> Imager:
    """Draw a sonar whose middle beam looks along x. In scenes without walls, it stacks images over tilts."""
    by_depth = water.scene.name in WALLED and bool(rng.random() < STACKED_BY_DEPTH)
    aperture = rng.uniform(*APERTURES) if by_depth else TILTED_APERTURE
    suits = water.sensor
    sensor = Sensor("imaging", AZIMUTHS, aperture, BEAMS, RAYS, suits.min_range, suits.max_range, threshold=THRESHOLD)
    azimuth = np.arcsin(np.linspace(-1, 1, BEAMS) * math.sin(AZIMUTHS / 2))
    beams = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(BEAMS)])
    elevation = np.linspace(-0.5, 0.5, RAYS) * aperture
    rays = np.cos(elevation)[None, :, None] * beams[:, None, :] + np.sin(elevation)[None, :, None] * np.array(
        (0, 0, 1.0)
    )
    # a main lobe 3 dB down at either edge of the aperture, each way
    fan = Fan(sensor, beams, rays, 10 ** (-0.6 * (elevation / (aperture / 2)) ** 2))
    detector = float(np.exp(rng.uniform(*np.log(DETECTORS))))
    return Imager(water, fan, by_depth, detector, rng.uniform(*MULTIPATH), rng.uniform(*SIDE_LOBES))


IMAGING = SweepKind("imaging", FROM_ABOVE, imager, seen_from=False)
