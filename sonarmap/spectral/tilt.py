"""Roll and pitch of a relative rotation, and whether they keep to the bound of a vehicle (Sect. 2.7)."""

import numpy as np
from scipy.spatial.transform import Rotation

# A bound that a scan just keeps must not refuse it for the error of its estimate [rad].
_TILT_SLACK = float(np.deg2rad(3.0))


def largest_tilt(R: Rotation) -> np.ndarray:
    """The larger of roll and pitch [rad], R = Rz(yaw) Ry(pitch) Rx(roll): () for one rotation, (n,) for a stack."""
    return np.abs(R.as_euler("ZYX")[..., 1:]).max(axis=-1)


def tilt_allowed(R_target_source: Rotation, max_tilt: float) -> np.ndarray:
    """Whether roll and pitch keep to the bound [rad], but for 3 degrees that the estimate may be off; () or (n,)."""
    return largest_tilt(R_target_source) <= max_tilt + _TILT_SLACK


def tilt_reach(max_tilt: float) -> float:
    """How far a rotation vector may reach along one of the target's axes under that bound [rad].

    Roll and pitch are about the source's axes after yaw: both at the bound are its root of two about one axis.
    """
    return float(np.sqrt(2.0)) * (max_tilt + _TILT_SLACK)


def tilt_refusal(R_target_source: Rotation, max_tilt: float) -> str:
    """Why a rotation beyond the bound [rad] is refused, in words; "" where it keeps to it."""
    if tilt_allowed(R_target_source, max_tilt):
        return ""
    tilt = np.rad2deg(largest_tilt(R_target_source))
    return f"roll or pitch is {tilt:.0f} degrees; believed up to {np.rad2deg(max_tilt):g} degrees"
