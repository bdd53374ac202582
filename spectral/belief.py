"""How probable it is that a hypothesis is right, and whether to believe it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import erf, sqrt

import numpy as np

from spectral.grid import Grid
from spectral.verification import Refined, Verified

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
    """The logarithm of the odds that a hypothesis is right, linear in the logarithms of what speaks for it.

    By logistic regression on simulated pairs, related and unrelated; docs/registration.md tells on which, and how it
    did on others.

    Attributes:
        odds: at 1 of everything below.
        psr: power of the translation's peak-to-sidelobe ratio.
        distinction: of its score over that of the next best on the whole grid.
        consistency: of how the views agree.
        rival: of that over the consistency of the most consistent other answer.
    """

    odds: float = -6.773
    psr: float = 2.315
    distinction: float = 1.712
    consistency: float = 6.471
    rival: float = 9.439

    def probability(self, psr: float, distinction: float, consistency: float, rival: float) -> float:
        """From the plain numbers."""
        return float(
            1.0
            / (
                np.exp(-self.odds)
                * psr**-self.psr
                * distinction**-self.distinction
                * consistency**-self.consistency
                * rival**-self.rival
                + 1.0
            )
        )


LOGISTIC = Logistic()


def believe(
    found: Sequence[Verified],
    refined: Sequence[Refined],
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
        refined: all hypotheses, also those that were not verified; the found are among them.
        covariances: (6, 6) each, of the found [rad, m].
        grid: that both scans share. On larger ones false peaks stand higher above the rest.
        least: the probability from which on a registration is believed.
        logistic: the calibration.
    """
    probabilities = np.array([_probability(one, found, refined, grid.edge, logistic) for one in found])
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


def _probability(
    one: Verified, found: Sequence[Verified], refined: Sequence[Refined], edge: int, logistic: Logistic
) -> float:
    """That this hypothesis is right, each other being its rival."""
    scores = [other.score for other in found if other is not one]
    views = [other.consistency for other in refined if other.origin.candidate != one.refined.origin.candidate]
    consistency = max(one.refined.consistency, 0.02)
    return logistic.probability(
        psr=max(one.psr / max(1.0, edge / 128) ** 0.75, 3.0),
        distinction=max(one.score, 0.3) / max([*scores, 0.3]),
        consistency=consistency,
        rival=consistency / max([*views, 0.02]),
    )


def _reason(one: Verified, probability: float, least: float) -> str:
    threshold = "" if probability >= least else f"; believed from {least:.0%} on"
    return (
        f"it is right with a probability of {probability:.1%}{threshold}: the translation's peak is {one.psr:.1f} "
        f"standard deviations high, the views agree to {one.refined.consistency:.0%}, "
        f"{one.overlap:.0%} of the points are shared"
    )
