# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""All that a pose graph knows as GTSAM's factors, and what holds components that are measured in part."""

from collections.abc import Iterable, Mapping, Sequence, Set

import gtsam
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.gtsam_poses import to_pose3
from sonarmap.slam.graph.known_pose import KnownPose, undetermined
from sonarmap.slam.graph.measured_poses import level
from sonarmap.spectral.scan import PosePrior


def anchor_factors(anchors: Iterable[int], T_world_sensor: RigidTransform, sigma: float) -> list[gtsam.NonlinearFactor]:
    """What holds poses where they are.

    Args:
        anchors: their indices.
        T_world_sensor: of all poses.
        sigma: standard deviation with which they are held [rad, m].
    """
    held = gtsam.noiseModel.Isotropic.Sigma(6, sigma)
    return [gtsam.PriorFactorPose3(pose, to_pose3(T_world_sensor[pose]), held) for pose in anchors]


def pose_factors(control: Iterable[ControlPoint], known: Iterable[KnownPose]) -> list[gtsam.NonlinearFactor]:
    """What points and single poses say of where they are."""
    return [*(point.factor() for point in control), *(factor for each in known for factor in each.factors())]


def levels(
    components: Sequence[Sequence[int]], anchors: Set[int], priors: Mapping[int, PosePrior], T_world: RigidTransform
) -> list[KnownPose]:
    """That vehicles float about level, where no instrument measured attitudes and positions alone tell the tilt."""
    told = (level(members, priors, T_world) for members in components if anchors.isdisjoint(members))
    return [known for known in told if known is not None] if priors else []


def holds(
    components: Sequence[Sequence[int]], elsewhere: Set[int], known: Sequence[KnownPose], T_world: RigidTransform
) -> list[KnownPose]:
    """What holds components of which `known` tells something, but not all; not those that are held by `elsewhere`."""
    held: list[KnownPose] = []
    for members in components if known else ():
        inside = set(members)
        own = [each for each in known if each.pose in inside]
        if own and inside.isdisjoint(elsewhere):
            holding = undetermined(members, own, T_world)
            held += [] if holding is None else [holding]
    return held
