"""Priors of pairs that distinguish every axis and sign, for tests of what they allow."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.prior import RelativePrior, Residuals
from sonarmap.spectral.scan import PosePrior

Kinds = tuple[slice, ...]
INF = np.inf
ATTITUDE, HEADING, POSITION, DEPTH = slice(0, 2), slice(2, 3), slice(3, 5), slice(5, 6)
ALL = (ATTITUDE, HEADING, POSITION, DEPTH)
SIGMAS = np.array([0.01, 0.02, 0.05, 2.0, 3.0, 0.1])  # all different
# over levers of 15 m, those of attitude and heading are as large as those of depth and position
SURE = np.array([0.004, 0.008, 0.02, 0.1, 0.2, 0.03])
T_TARGET = RigidTransform.from_components([4.0, -1.0, -2.5], Rotation.from_euler("ZYX", [0.7, -0.3, 0.2]))
T_SOURCE = RigidTransform.from_components([16.0, 8.0, -7.0], Rotation.from_euler("ZYX", [-1.4, 0.25, -0.35]))
T_TRUE = T_TARGET.inv() * T_SOURCE
T_PAIRS = ((T_TARGET, T_SOURCE), (T_SOURCE, T_TARGET))


def knowing(*kinds: slice, sigmas: np.ndarray = SIGMAS) -> np.ndarray:
    known = np.full(6, INF)
    for kind in kinds:
        known[kind] = sigmas[kind]
    return known


def prior(T: RigidTransform, *kinds: slice, sigmas: np.ndarray = SIGMAS) -> PosePrior:
    return PosePrior(T, knowing(*kinds, sigmas=sigmas))


def pair(*kinds: slice, sigmas: np.ndarray = SIGMAS) -> RelativePrior:
    return RelativePrior(prior(T_TARGET, *kinds, sigmas=sigmas), prior(T_SOURCE, *kinds, sigmas=sigmas))


def between(target: Kinds, source: Kinds, sigmas: np.ndarray = SURE) -> RelativePrior:
    """A prior between scans with different kinds of measurements."""
    return RelativePrior(prior(T_TARGET, *target, sigmas=sigmas), prior(T_SOURCE, *source, sigmas=sigmas))


def at(relative: RelativePrior, T: RigidTransform) -> Residuals:
    """The residuals of poses."""
    return relative.at(T.rotation, T.translation)


def names_of(kinds: Kinds) -> str:
    names = {0: "attitude", 2: "heading", 3: "position", 5: "depth"}
    return "+".join(names[kind.start] for kind in kinds) or "nothing"


def unexact(T: RigidTransform, rng: np.random.Generator, sigmas: np.ndarray = SIGMAS, most: float = INF) -> PosePrior:
    """A prior whose errors have these standard deviations, cut at `most` of them, as PosePrior defines them."""
    errors = sigmas * np.clip(rng.normal(size=6), -most, most)
    _, _, z, w = T.rotation.as_quat()
    w_world = Rotation.from_euler("Z", 2 * np.arctan2(z, w)).apply(errors[:3])
    rotation = Rotation.from_rotvec(w_world).inv() * T.rotation
    return PosePrior(RigidTransform.from_components(T.translation - errors[3:], rotation), sigmas)


def random_rotations(count: int, seed: int) -> Rotation:
    return Rotation.random(count, rng=np.random.default_rng(seed))


def about_vertical(angle: float, shift: tuple[float, float, float] = (0, 0, 0)) -> RigidTransform:
    return RigidTransform.from_components(list(shift), Rotation.from_euler("Z", angle))
