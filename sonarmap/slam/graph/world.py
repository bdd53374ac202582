"""Where a chain of poses lies in the world, by what instruments say of its scans."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.measured import measured_rotation, twist
from sonarmap.spectral.scan import PosePrior


def place_in_world(
    trajectory: Trajectory, parts: Sequence[Sequence[int]], priors: Mapping[int, PosePrior]
) -> Trajectory:
    """Each part moved as a whole to where its priors say, as a start for an optimizer; unmoved without priors.

    Args:
        trajectory: N poses, each part's in a frame of its own.
        parts: the indices of their poses.
        priors: what instruments measured, by pose (world East-North-Up).
    """
    poses = list(trajectory.T_world_sensor)
    for members in parts:
        known = {k: priors[k] for k in members if k in priors}
        if known:
            T_world_part = _placement(known, {k: poses[k] for k in known})
            for k in members:
                poses[k] = T_world_part * poses[k]
    return Trajectory(trajectory.stamps, RigidTransform.concatenate(poses))


def _placement(known: Mapping[int, PosePrior], T_part: Mapping[int, RigidTransform]) -> RigidTransform:
    """T_world_part: tilt first, then heading, then position."""
    R = _tilt(known, T_part)
    R = Rotation.from_euler("Z", _heading(known, T_part, R)) * R
    offsets = np.array(
        [prior.T_world_sensor.translation - R.apply(T_part[k].translation) for k, prior in known.items()]
    )
    measured = np.array([np.isfinite(prior.sigmas[3:]) for prior in known.values()])
    count = np.maximum(measured.sum(axis=0), 1)
    return RigidTransform.from_components((offsets * measured).sum(axis=0) / count, R)


def _tilt(known: Mapping[int, PosePrior], T_part: Mapping[int, RigidTransform]) -> Rotation:
    """A rotation that brings the parts' verticals upright, on the whole."""
    up = [
        T_part[k].rotation.apply(measured_rotation(prior).inv().apply([0.0, 0.0, 1.0]))
        for k, prior in known.items()
        if prior.knows_attitude
    ]
    if not up:
        return Rotation.identity()
    return Rotation.align_vectors([[0.0, 0.0, 1.0]], [np.mean(up, axis=0)])[0]


def _heading(known: Mapping[int, PosePrior], T_part: Mapping[int, RigidTransform], R: Rotation) -> float:
    """The turn about the vertical that is left [rad]: by the headings, else by positions."""
    turns = [
        twist(measured_rotation(prior) * (R * T_part[k].rotation).inv())
        for k, prior in known.items()
        if prior.knows_heading
    ]
    if turns:
        return float(np.angle(np.exp(1j * np.array(turns)).mean()))
    placed = [k for k, prior in known.items() if prior.knows_position]
    if len(placed) < 2:
        return 0.0
    there = np.array([known[k].T_world_sensor.translation[:2] for k in placed]) @ [1, 1j]
    here = np.array([R.apply(T_part[k].translation)[:2] for k in placed]) @ [1, 1j]
    return float(np.angle(((there - there.mean()) * (here - here.mean()).conj()).sum()))
