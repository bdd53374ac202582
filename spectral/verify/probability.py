"""How probable it is that a hypothesis is right."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import erf, exp, log, sqrt

import numpy as np

from spectral.verify.hypothesis import Hypothesis

# A registration is right within these of the truth [rad; voxels].
_RIGHT_TURN, _RIGHT_SHIFT = float(np.deg2rad(6.0)), 3.0


@dataclass(frozen=True, slots=True)
class Logistic:
    """The probability that a hypothesis is right: that the scans show one place so clearly, times that it is this one.

    Each is logistic in logarithms of the evidence. The second is 1/2 for a hypothesis and its exact twin,
    however high their peaks stand, as between the two ends of a room. By maximum likelihood on simulated pairs, related
    and unrelated; docs/registration.md names them, and how it did on others.

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


def hypothesis_probabilities(hypotheses: Sequence[Hypothesis], edge: int, logistic: Logistic = LOGISTIC) -> list[float]:
    """That each hypothesis names the right place, 0..1, in the light of the others; their sum is at most 1.

    Args:
        hypotheses: measured on the whole grid, the best first.
        edge: voxels per edge of the grid. On larger ones false peaks stand higher above the rest.
        logistic: the calibration.
    """
    probabilities = np.array([_probability(hypothesis, hypotheses, edge, logistic) for hypothesis in hypotheses])
    # one answer at most is right: what the best leaves is all that the others can have
    left, others = 1 - probabilities[0], probabilities[1:].sum()
    if others > left:
        probabilities[1:] *= left / others
    return probabilities.tolist()


def tolerance_probability(covariance: np.ndarray, voxel: float) -> float:
    """That a pose is within 6 degrees and 3 voxels of the truth, 0..1, where its hypothesis is the right one.

    The right hypothesis may still leave the pose open, as along a wall. Turn and shift are each taken along their
    least sure direction.

    Args:
        covariance: (6, 6) of the pose, rotation first [rad, m].
        voxel: [m].
    """
    turn, shift = (sqrt(np.linalg.eigvalsh(part)[-1]) for part in (covariance[:3, :3], covariance[3:, 3:]))
    return erf(_RIGHT_TURN / (sqrt(2) * turn)) * erf(_RIGHT_SHIFT * voxel / (sqrt(2) * shift))


def explain(hypothesis: Hypothesis, probability: float, least: float) -> str:
    """The evidence for a hypothesis in words, and why it is believed or not from a probability of `least` on."""
    threshold = "" if probability >= least else f"; believed from {least:.0%} on"
    return (
        f"it is right with a probability of {probability:.1%}{threshold}: the translation's peak is "
        f"{hypothesis.psr:.1f} standard deviations high, the views agree to {hypothesis.consistency:.0%}, "
        f"{hypothesis.overlap:.0%} of the points are shared"
    )


def _probability(hypothesis: Hypothesis, hypotheses: Sequence[Hypothesis], edge: int, logistic: Logistic) -> float:
    """That this hypothesis is right, each other being its rival."""
    rivals = [rival for rival in hypotheses if rival is not hypothesis]
    consistency = max(hypothesis.consistency, 0.02)
    return logistic.probability(
        psr=max(hypothesis.psr / max(1.0, edge / 128) ** 0.75, 3.0),
        consistency=consistency,
        distinction=max(hypothesis.score, 0.3) / max([*(rival.score for rival in rivals), 0.3]),
        rival=consistency / max([*(rival.consistency for rival in rivals), 0.02]),
    )


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + exp(-x)) if x > 0 else exp(x) / (1.0 + exp(x))
