"""A line where a map has its patches: between their middles the correction changes evenly with time."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.pings.line import PingLine


def moved(
    line: PingLine, middles: np.ndarray, T_world_patch: RigidTransform, covariances: np.ndarray
) -> tuple[PingLine, np.ndarray]:
    """The line with the navigation that a map gives it, and (P, 6) standard deviations of every ping's pose: rotation
    about the map's East, North, Up axes [rad], then along these [m].

    Each ping's frame about the transducer is turned and shifted, in its own axes, by what the patches before and behind
    it were, in proportion to time; before the first middle and after the last by that patch's.

    Args:
        middles: (n,) the ping in whose frame each patch is, ascending, n >= 1.
        T_world_patch: where the map has the patches.
        covariances: (n, 6, 6) of these, rotation first [rad, m], body tangent.
    """
    R_level, at = line.T_world_level.rotation, line.stamps[middles]
    T_sensor = RigidTransform.from_components(line.world_sensors(), R_level)
    xi = np.asarray((T_sensor[middles].inv() * T_world_patch).as_exp_coords())
    T_moved = T_sensor * RigidTransform.from_exp_coords(_at_pings(line, at, xi))
    T_world_old = T_moved * RigidTransform.from_translation(-line.sensors)  # the level frame as it was, moved along
    angles = (T_moved.rotation * line.R_level_vehicle).as_euler("ZYX")
    attitudes = np.column_stack([angles[:, 2], -angles[:, 1], (np.pi / 2 - angles[:, 0]) % (2 * np.pi)])
    new = replace(line, places=T_world_old.translation, attitudes=attitudes)
    T_new_old = new.T_world_level.inv() * T_world_old
    new = replace(new, points=T_new_old[line.pings].apply(line.points), sensors=T_new_old.apply(line.sensors))
    variances = _at_pings(line, at, np.diagonal(covariances, axis1=1, axis2=2))
    # along the world's axes, of those along the pings' own
    turned = np.einsum("pij,pkj->pki", R_level.as_matrix() ** 2, variances.reshape(-1, 2, 3))
    return new, np.sqrt(turned.reshape(-1, 6))


def _at_pings(line: PingLine, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(P, k) at the pings of what is (n, k) at times [s]."""
    return np.column_stack([np.interp(line.stamps, at, column) for column in values.T])
