"""Several dives over one scene: what another one shares with the first, and where it differs.

The scene is the seed's whatever the dive. Every other dive begins farther along the same closed path, goes the same way
round, wanders sideways off it, and meets other waves and other noise. The first one keeps to the path.
"""

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.sensing.dive_seed import entropy_of

SHIFT = (3 - np.sqrt(5.0)) / 2  # of one dive's start against the last one's, as a share of the way that a dive covers
DIVING = ("survey", "loop", "lawnmower")  # trajectories that have other dives: those along a closed path

# Sideways drift of a dive other than the first in a scene of 256 m: amplitude of each of the summed sines [m]. With the
# heave it stays within what the paths keep clear.
DRIFT_AMPLITUDE = 0.75
DRIFT_PERIODS = (23.0, 41.0)  # in scans
_DRIFT = 38  # stream of the seed


def check_dive(dive: int, trajectory: str) -> None:
    """Refuse dives below 1, and others than the first of trajectories that have one alone.

    Raises:
        InputError: as said.
    """
    if dive < 1:
        raise InputError(f"the dive is {dive}; wanted a number >= 1")
    if dive > 1 and trajectory not in DIVING:
        raise InputError(
            f"the trajectory {trajectory} has only one dive, and dive {dive} was asked for; leave it out, or choose "
            f"one of {', '.join(DIVING)}"
        )


def start_of(covered: float, dive: int) -> float:
    """Where on its path a dive begins that covers so much of it [m]: of two dives each goes where the other went.

    By the golden ratio, so that no two begin close by; the second goes 62 % of its way where the first one did.
    """
    return float(covered * (SHIFT * (dive - 1) % 1))


def drift(count: int, seed: int, dive: int) -> np.ndarray:
    """How far to the left of its path each scan of a dive is taken, (N,) [m] in a scene of 256 m; 0 on the first."""
    if dive == 1:
        return np.zeros(count)
    rng = np.random.default_rng(np.random.SeedSequence(entropy_of(seed, _DRIFT, dive=dive)))
    phase = rng.uniform(0, 2 * np.pi, (len(DRIFT_PERIODS), 1))
    angle = 2 * np.pi * np.arange(count) / np.array(DRIFT_PERIODS)[:, None] + phase
    return DRIFT_AMPLITUDE * np.sin(angle).sum(axis=0)
