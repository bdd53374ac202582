"""A line where a map has its patches: between their middles the correction changes evenly with time."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.pings.line import PingLine, in_frames


@dataclass(frozen=True, slots=True)
class MovedPatches:
    """What a map says of a line's patches, n >= 1.

    Attributes:
        middles: (n,) the ping in whose frame each is, ascending.
        T_world_patch: where the map has them.
        covariances: (n, 6, 6) of these, rotation first [rad, m], body tangent.
    """

    middles: np.ndarray
    T_world_patch: RigidTransform
    covariances: np.ndarray


def moved(line: PingLine, patches: MovedPatches) -> tuple[PingLine, np.ndarray]:
    """The line with the navigation that the map gives it, and (P, 6) standard deviations of every ping's pose: rotation
    about the map's East, North, Up axes [rad], then along these [m].

    Each ping's frame about the transducer is turned and shifted, in its own axes, by what the patches before and behind
    it were, in proportion to time; before the first middle and after the last by that patch's.
    """
    T_sensor = _about_sensors(line)
    xi = np.asarray((T_sensor[patches.middles].inv() * patches.T_world_patch).as_exp_coords())
    at = line.stamps[patches.middles]
    change = np.stack([np.interp(line.stamps, at, column) for column in xi.T], axis=1)
    T_moved = T_sensor * RigidTransform.from_exp_coords(change)
    R_level = line.T_world_level.rotation
    T_world_old = T_moved * RigidTransform.from_translation(-line.sensors)  # the level frame as it was, moved along
    angles = (T_moved.rotation * line.R_level_vehicle).as_euler("ZYX")
    attitudes = np.column_stack([angles[:, 2], -angles[:, 1], (np.pi / 2 - angles[:, 0]) % (2 * np.pi)])
    new = replace(line, places=T_world_old.translation, attitudes=attitudes)
    T_new_old = new.T_world_level.inv() * T_world_old
    new = replace(new, points=in_frames(T_new_old, line.pings, line.points), sensors=T_new_old.apply(line.sensors))
    covariances = np.stack([np.interp(line.stamps, at, patches.covariances[:, k, k]) for k in range(6)], axis=1)
    return new, _in_world(R_level, covariances)


def _about_sensors(line: PingLine) -> RigidTransform:
    """The pings' level frames about the transducer, in the world."""
    return RigidTransform.from_components(line.world_sensors(), line.T_world_level.rotation)


def _in_world(R: Rotation, variances: np.ndarray) -> np.ndarray:
    """(P, 6) standard deviations along the world's axes of (P, 6) variances along those of frames."""
    squares = R.as_matrix() ** 2
    parts = [np.einsum("pij,pj->pi", squares, variances[:, part]) for part in (slice(0, 3), slice(3, 6))]
    return np.sqrt(np.concatenate(parts, axis=1))
