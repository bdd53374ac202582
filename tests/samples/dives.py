"""A vehicle with a Sonar 3D-15 that goes through a simulated scene: the packets of its recording."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.simulate.routes import survey_path
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise, disturb
from sonarmap.tools.lab.simulate.sensing.sensors import SONAR_3D15, Echoes, Sensor, cast
from tests.samples.recordings import PIXEL, SPEED, PacketOf, packets_of, range_image, stamp_at, strength_image

NOISE = Noise(sigma2=0.0025, outliers=0.01, dropouts=0.05)
SWAY = np.deg2rad((1.5, 1.0))  # amplitudes of roll and pitch [rad]
PERIODS = 34.0, 21.0  # of roll and pitch [s]


@dataclass(frozen=True, slots=True)
class Dive:
    """A recording of a vehicle along a scene's path."""

    scene: str  # a key of SCENE_KINDS
    shots: int  # number of shots
    rate: float = 20.0  # shots per second
    speed: float = 0.1  # of the vehicle [m/s]
    columns: int = 128  # of the images
    rows: int = 32  # of the images
    seed: int = 3  # of the scene and the noise

    @property
    def sensor(self) -> Sensor:
        return replace(SONAR_3D15, columns=self.columns, rows=self.rows)

    def poses(self) -> RigidTransform:
        """T_scene_sensor of every shot."""
        times = np.arange(self.shots) / self.rate
        path = survey_path(self.scene, self.seed, self.sensor.max_range)
        places, heading = path.at(self.speed * times)
        roll, pitch = (size * np.sin(2 * np.pi * times / period) for size, period in zip(SWAY, PERIODS, strict=True))
        angles = np.column_stack([heading, path.pitch + pitch, roll])
        return RigidTransform.from_components(places, Rotation.from_euler("ZYX", angles))

    def packets(self) -> Iterator[PacketOf]:
        """The range and the strength image of each shot."""
        scene, sensor, T_scene_sensor = build_scene(self.scene, self.seed), self.sensor, self.poses()
        for shot in range(self.shots):
            echoes = cast(scene, sensor, T_scene_sensor[shot])
            yield from self._images(shot, disturb(echoes, sensor, NOISE, np.random.default_rng([self.seed, shot])))

    def _images(self, shot: int, echoes: Echoes) -> list[PacketOf]:
        """Both images as the sonar sends them: columns from left to right, rows from below."""
        seen = np.isfinite(echoes.ranges)
        pixels = np.rint(np.where(seen, echoes.ranges, 0.0) / PIXEL).astype(np.uint32)[:, ::-1]
        levels = np.where(seen, np.clip(200 + 100 * np.log10(np.maximum(echoes.strengths, 1e-9)), 1, 255), 0)
        fields = np.rad2deg((SONAR_3D15.horizontal, SONAR_3D15.vertical)).tolist()
        more = {"speed_of_sound": SPEED, "range": 15.0, "frequency": round(self.rate)}
        image, strength = range_image(0, pixels, PIXEL, fields, **more), strength_image(0, levels[:, ::-1])
        return packets_of(shot, shot, stamp_at(shot, self.rate), image, strength)
