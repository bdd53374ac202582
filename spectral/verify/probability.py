"""How probable it is that a hypothesis is right, and whether to believe it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import erf, exp, log, sqrt

import numpy as np

from spectral.grid import Grid
from spectral.verify.hypothesis import Verified

# Another answer at least this probable is kept beside the best.
_POSSIBLE = 0.01
# A registration is right within these of the truth [rad; voxels].
_RIGHT_TURN, _RIGHT_SHIFT = float(np.deg2rad(6.0)), 3.0


@dataclass(frozen=True, slots=True)
class Belief:
    """What is thought of one hypothesis.

    Attributes:
        probability: that it is right, 0..1: within 6 degrees and 3 voxels of the truth.
        accepted: whether to believe it.
        possible: whether it cannot be excluded.
        reason: in words.
    """

    probability: float
    accepted: bool
    possible: bool
    reason: str


@dataclass(frozen=True, slots=True)
class Logistic:
    """The probability that a hypothesis is right: that the scans show one place so clearly, times that it is this one.

    Each is logistic in logarithms of what speaks for it. The second is 1/2 for a hypothesis and its exact twin,
    however high their peaks stand, as between the two ends of a room. By maximum likelihood on simulated pairs, related
    and unrelated; docs/registration.md tells on which, and how it did on others.

    Attributes:
        odds: logarithm of the first's odds at 1 of everything below.
        psr: power of the translation's peak-to-sidelobe ratio in these odds.
        consistency: of how the views agree.
        clearness: of its score over that of the next best.
        distinction: power of the same in the second's odds.
        rival: of its consistency over that of the most consistent other answer.
    """

    odds: float = -11.149
    psr: float = 3.309
    consistency: float = 4.637
    clearness: float = 4.967
    distinction: float = 5.976
    rival: float = 5.430

    def probability(self, psr: float, consistency: float, distinction: float, rival: float) -> float:
        """From the plain numbers."""
        clear = (
            self.odds + self.psr * log(psr) + self.consistency * log(consistency) + self.clearness * log(distinction)
        )
        this = self.distinction * log(distinction) + self.rival * log(rival)
        return _logistic(clear) * _logistic(this)


LOGISTIC = Logistic()


def believe(
    found: Sequence[Verified],
    covariances: Sequence[np.ndarray],
    grid: Grid,
    least: float,
    logistic: Logistic = LOGISTIC,
) -> list[Belief]:
    """What to think of each hypothesis, in the light of the others.

    The right hypothesis may still leave the pose open, as along a wall: the probability is that of the hypothesis,
    times that of an error, under its covariance, that is still right.

    Args:
        found: verified on the whole grid, the best first.
        covariances: (6, 6) each, of the found [rad, m].
        grid: that both scans share. On larger ones false peaks stand higher above the rest.
        least: the probability from which on a registration is believed.
        logistic: the calibration.
    """
    probabilities = np.array([_probability(one, found, grid.edge, logistic) for one in found])
    # one answer at most is right: what the best leaves is all that the others can have
    left, others = 1 - probabilities[0], probabilities[1:].sum()
    if others > left:
        probabilities[1:] *= left / others
    beliefs = []
    for one, hypothesis, covariance in zip(found, probabilities.tolist(), covariances, strict=True):
        p = hypothesis * _kept_within(covariance, grid.voxel)
        beliefs.append(Belief(p, p >= least, hypothesis >= _POSSIBLE, _reason(one, p, least)))
    return beliefs


def _kept_within(covariance: np.ndarray, voxel: float) -> float:
    """The probability that turn and shift are right, each along its least sure direction."""
    turn, shift = (sqrt(np.linalg.eigvalsh(part)[-1]) for part in (covariance[:3, :3], covariance[3:, 3:]))
    return erf(_RIGHT_TURN / (sqrt(2) * turn)) * erf(_RIGHT_SHIFT * voxel / (sqrt(2) * shift))


def _probability(one: Verified, found: Sequence[Verified], edge: int, logistic: Logistic) -> float:
    """That this hypothesis is right, each other being its rival."""
    scores = [other.score for other in found if other is not one]
    views = [other.refined.consistency for other in found if other is not one]
    consistency = max(one.refined.consistency, 0.02)
    return logistic.probability(
        psr=max(one.psr / max(1.0, edge / 128) ** 0.75, 3.0),
        consistency=consistency,
        distinction=max(one.score, 0.3) / max([*scores, 0.3]),
        rival=consistency / max([*views, 0.02]),
    )


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + exp(-x)) if x > 0 else exp(x) / (1.0 + exp(x))


def _reason(one: Verified, probability: float, least: float) -> str:
    threshold = "" if probability >= least else f"; believed from {least:.0%} on"
    return (
        f"it is right with a probability of {probability:.1%}{threshold}: the translation's peak is {one.psr:.1f} "
        f"standard deviations high, the views agree to {one.refined.consistency:.0%}, "
        f"{one.overlap:.0%} of the points are shared"
    )
