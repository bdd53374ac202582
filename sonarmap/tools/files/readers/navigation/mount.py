# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""The sonar on its vehicle: what navigation says of the vehicle, said of the sonar."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior

_LEVEL = 0.2  # [rad]: how far from level a vehicle is taken to be whose attitude nobody measured
_MOST_TILT = 30.0  # [deg] of a mount beside an attitude that nobody measured
_TURN = np.array([1.0, -1.0, -1.0])  # forward, right, down to forward, left, up, and back


@dataclass(frozen=True, slots=True)
class Mount:
    """How a sonar sits on its vehicle.

    Attributes:
        T_vehicle_sensor: both with x forward, y left, z up [m].
    """

    T_vehicle_sensor: RigidTransform

    @classmethod
    def of(cls, angles: np.ndarray, lever: np.ndarray, up: bool) -> "Mount":
        """Of roll, pitch, heading (3,) [deg] and the lever arm (3,) [m], from the vehicle's point to the sonar.

        Args:
            angles: turned in the order heading, pitch, roll; in the vehicle's axes.
            lever: forward, starboard, down.
            up: whether the vehicle's axes are forward, left, up instead, for the angles and the lever arm alike.
        """
        signs = np.ones(3) if up else _TURN
        R_vehicle_sensor = Rotation.from_euler("ZYX", (angles * signs)[::-1], degrees=True)
        return cls(RigidTransform.from_components(lever * signs, R_vehicle_sensor))

    @property
    def tilt(self) -> float:
        """Between the vehicle's vertical axis and the sonar's [rad]."""
        up = self.T_vehicle_sensor.rotation.apply([0.0, 0.0, 1.0])
        return float(np.arctan2(np.hypot(up[0], up[1]), up[2]))

    def of_sensor(self, vehicle: PosePrior) -> PosePrior:
        """The prior of the sonar: T_world_sensor = T_world_vehicle * T_vehicle_sensor.

        What is not known of the rotation makes the place at the end of the lever arm less sure. Where no heading is
        known the lever arm's direction is open: the sonar's place is the vehicle's, less sure by the arm's length.

        Raises InputError: a heading without roll and pitch, where the sonar is mounted at a tilt.
        """
        if vehicle.knows_heading and not vehicle.knows_attitude and np.degrees(self.tilt) > _MOST_TILT:
            raise InputError(
                f"the sonar is mounted at a tilt of {np.degrees(self.tilt):.0f} degrees, where a heading alone does "
                "not say how it was turned; add columns of roll and pitch"
            )
        T_world_sensor = vehicle.T_world_sensor * self.T_vehicle_sensor
        R, arm = vehicle.T_world_sensor.rotation, self.T_vehicle_sensor.translation
        lever = R.apply(arm)
        flat, length = float(np.hypot(lever[0], lever[1])), float(np.linalg.norm(lever))
        tilt = float(vehicle.sigmas[:2].max()) if vehicle.knows_attitude else _LEVEL
        sigmas = vehicle.sigmas.copy()
        sigmas[3:5] = np.hypot(sigmas[3:5], abs(float(lever[2])) * tilt)
        sigmas[5] = np.hypot(sigmas[5], flat * tilt)
        places = T_world_sensor.translation
        if vehicle.knows_heading:
            sigmas[3:5] = np.hypot(sigmas[3:5], flat * min(float(vehicle.sigmas[2]), 1.0))
        else:
            sigmas[3:5] = np.hypot(sigmas[3:5], length)
            places = np.array([*vehicle.T_world_sensor.translation[:2], places[2]])
        sigmas[:2] = sigmas[:2].max()  # a sonar that looks sideways has its roll where the vehicle's pitch is
        return PosePrior(RigidTransform.from_components(places, T_world_sensor.rotation), sigmas)
