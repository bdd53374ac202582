# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""How far a vehicle is from a steady motion between two key scans, as the key scans themselves show it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

# Halfway to the next key scan a vehicle is assumed to be off by this share of its motion, as firmly as so many keys
# would tell it.
_SHARE, _ASSUMED = 0.1, 4.0


@dataclass(frozen=True, slots=True)
class Unsteadiness:
    """Variances of a tangent, rotation first.

    Attributes:
        shaken: (6,) from scan to scan, of every scan by itself [rad^2, m^2].
        curved: (6,) of half the change of speed, per unit of time^2. By it turns stray from a steady motion, the more
            the longer it takes.
    """

    shaken: np.ndarray
    curved: np.ndarray

    @classmethod
    def of(cls, T: RigidTransform, times: np.ndarray, run: np.ndarray) -> "Unsteadiness":
        """From n key scans, each compared with steady motions past it, between the two next to it and the two beyond.

        A turn strays from the wider motion by more, as the times tell. What differs otherwise was shaken.

        Args:
            T: their n poses.
            times: (n,) ascending within a run.
            run: (n,) equal for those that are one run of one map, ascending.
        """
        k = np.arange(2, len(times) - 2)
        k = k[run[k - 2] == run[k + 2]]
        assumed = _assumed(T, times, run)
        if not len(k):
            return cls(np.zeros(6), assumed)
        near, near_room, near_noise = _deviations(T, times, k, 1)
        far, far_room, far_noise = _deviations(T, times, k, 2)
        a, b = far_room / (far_room - near_room), near_room / (far_room - near_room)
        straight = a[:, None] * near - b[:, None] * far
        shaken = (straight**2 / (1 + a**2 * near_noise + b**2 * far_noise)[:, None]).mean(axis=0)
        strayed = (near**2).mean(axis=0) - (1 + near_noise).mean() * shaken
        curved = np.maximum(strayed, 0.0) / (near_room**2).mean()
        known = len(k) / (len(k) + _ASSUMED)
        return cls(known * shaken, known * curved + (1 - known) * assumed)

    def variance(self, before: float, behind: float) -> np.ndarray:
        """(6,) of a scan about the steady motion from a key scan so much time before it to one so much behind it."""
        share = before / (before + behind)
        return (1 + share**2 + (1 - share) ** 2) * self.shaken + (before * behind) ** 2 * self.curved


def _assumed(T: RigidTransform, times: np.ndarray, run: np.ndarray) -> np.ndarray:
    """(6,) what is curved, before anything is known."""
    inside = np.flatnonzero(np.diff(run) == 0)
    if not len(inside):
        return np.zeros(6)
    steps: np.ndarray = (T[inside].inv() * T[inside + 1]).as_exp_coords()
    lengths = np.median(np.linalg.norm(steps.reshape(-1, 2, 3), axis=2), axis=0)
    halfway = float(np.median(np.diff(times)[inside])) ** 2 / 4
    return np.repeat((_SHARE * lengths / halfway) ** 2, 3)


def _deviations(
    T: RigidTransform, times: np.ndarray, k: np.ndarray, strides: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m, 6) what key scans k are off a steady motion from those so many strides before to those behind.

    And (m,) the product of the times to both, by which a change of speed shows, and (m,) the variance of the steady
    motion there, where every key scan has a variance of 1.
    """
    i, j = k - strides, k + strides
    before, behind = times[k] - times[i], times[j] - times[k]
    share = before / (before + behind)
    way: np.ndarray = (T[i].inv() * T[j]).as_exp_coords()
    steady = T[i] * RigidTransform.from_exp_coords(share[:, None] * way)
    off: np.ndarray = (steady.inv() * T[k]).as_exp_coords()
    return off, before * behind, share**2 + (1 - share) ** 2
