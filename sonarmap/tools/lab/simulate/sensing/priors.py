"""What a vehicle's instruments would say of simulated poses: attitude, heading, depth and position, with errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.measured import twist
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.lab.simulate.sensing.dive_seed import entropy_of

STREAM = 31  # of the seed: the errors are drawn apart from the scans, which stay what they are


@dataclass(frozen=True, slots=True)
class Instruments:
    """Standard deviations of what a vehicle carries; inf for what it does not.

    Attributes:
        attitude: of roll and of pitch [rad]; an inertial sensor's.
        heading: [rad]; a magnetic compass near steel.
        depth: [m]; a pressure sensor's, with waves.
        position: of East and of North [m]; acoustic positioning.
    """

    attitude: float = float(np.deg2rad(0.5))
    heading: float = float(np.deg2rad(3.0))
    depth: float = 0.1
    position: float = 3.0

    @property
    def sigmas(self) -> np.ndarray:
        """(6,) float64 in PosePrior's order [rad, m]."""
        return np.array([self.attitude] * 2 + [self.heading] + [self.position] * 2 + [self.depth])


KINDS = tuple(Instruments.__dataclass_fields__)


def instruments_for(kinds: Sequence[str], fix_sigma: float | None = None) -> Instruments:
    """A vehicle that carries only these KINDS of instruments, with the default standard deviations.

    Args:
        kinds: of KINDS.
        fix_sigma: another standard deviation of positions [m].

    Raises:
        InputError: an unknown kind, or none at all; a standard deviation that is not positive.
    """
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown or not kinds:
        what = repr(unknown[0]) if unknown else "nothing"
        raise InputError(f"no instrument measures {what}; choose from {','.join(KINDS)}, separated by commas")
    if fix_sigma is not None and not 0 < fix_sigma < np.inf:
        raise InputError(f"`fix_sigma={fix_sigma:g}`: wanted meters above 0")
    carried = Instruments() if fix_sigma is None else Instruments(position=fix_sigma)
    return replace(carried, **{kind: np.inf for kind in KINDS if kind not in kinds})


def measure_poses(
    T_world_sensor: RigidTransform, instruments: Instruments, seed: int, dive: int = 1
) -> tuple[PosePrior, ...]:
    """The prior of each of N poses; seed, dive and the pose's number decide its errors, whatever else is measured."""
    entropy = entropy_of(seed, STREAM, dive=dive)
    streams = (np.random.SeedSequence(entropy, spawn_key=(number,)) for number in range(len(T_world_sensor)))
    return tuple(
        measure_pose(T_world_sensor[number], instruments, np.random.default_rng(stream))
        for number, stream in enumerate(streams)
    )


def measure_pose(T_world_sensor: RigidTransform, instruments: Instruments, rng: np.random.Generator) -> PosePrior:
    """What the instruments say of one true pose: with normal errors, and 0 for what they do not measure."""
    sigmas = instruments.sigmas
    drawn = rng.normal(size=6)
    known = np.isfinite(sigmas)
    errors = np.where(known, sigmas, 0.0) * drawn
    about_world = Rotation.from_euler("Z", twist(T_world_sensor.rotation)).apply(errors[:3])
    yaw, pitch, roll = (Rotation.from_rotvec(-about_world) * T_world_sensor.rotation).as_euler("ZYX")
    measured = np.where(known[[2, 1, 0]], [yaw, pitch, roll], 0.0)
    shift = np.where(known[3:], T_world_sensor.translation - errors[3:], 0.0)
    return PosePrior(RigidTransform.from_components(shift, Rotation.from_euler("ZYX", measured)), sigmas)
