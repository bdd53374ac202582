"""How probable it is that a hypothesis is right."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import erf, exp, log, sqrt

import numpy as np

from sonarmap.spectral.verify.hypothesis import Hypothesis

# A registration is right within these of the truth [rad; voxels].
_RIGHT_TURN, _RIGHT_SHIFT = float(np.deg2rad(6.0)), 3.0

# Instruments bound a direction if they know it better than this [rad; voxels]; so does the motion of a vehicle that
# turns at the ends of short lanes, which may be as unsure as 28 degrees while few steps are known.
_KNOWN_TURN, _KNOWN_SHIFT = float(np.deg2rad(30.0)), 16.0
# The lead of a hypothesis without rivals, and the most that any has.
_ALONE = 4.0


@dataclass(frozen=True, slots=True)
class Clues:
    """What the probability of one hypothesis is made of: logarithms, near 0 for a usual right one."""

    psr: float  # of the translation's peak, as on a grid of 128 voxels: false peaks stand higher on larger grids
    view: float  # of the consistency of the views; of the surfaces where there is no view
    surface: float  # of the consistency of the surfaces
    sharpness: float  # of the inverse of how far the surfaces are apart
    firmness: float  # of how firmly the planes hold the pose
    lead: float  # of its score over the best of the others; negative for others than the best
    search: float  # how few poses the instruments leave, so that a chance agreement is rarer; 0 without them

    def numbers(self) -> tuple[tuple[str, float], ...]:
        """By name, each after "p_"."""
        return tuple((f"p_{name}", float(value)) for name, value in asdict(self).items())


# The logarithm of the odds where all clues are 0, and the clues' weights in it; the weight of the lead in that against
# a twin. By maximum likelihood on simulated pairs of every kind, related and unrelated; docs/registration.md names
# them, and how it did on kinds that were left out.
_ODDS, _TWIN = 1.4, 5.0
_WEIGHTS = Clues(psr=0.8, view=1.0, surface=0.92, sharpness=0.66, firmness=0.82, lead=0.49, search=1.0)


def right_probability(given: Clues) -> float:
    """That a hypothesis is right: that the scans show one place so clearly, times that it is this one.

    Each is logistic in the clues. The second is 1/2 for a hypothesis and its exact twin, however high their peaks
    stand, as between the two ends of a room.
    """
    clear = _ODDS + sum(getattr(_WEIGHTS, name) * value for name, value in asdict(given).items())
    return _logistic(clear) * _logistic(_TWIN * given.lead)


def clues(hypothesis: Hypothesis, hypotheses: Sequence[Hypothesis], edge: int, search: float = 0.0) -> Clues:
    """What speaks for a hypothesis, measured on the whole grid, in the light of all of the pair.

    Args:
        edge: voxels per edge of the grid.
        search: logarithm, base 10, of the share of all poses that instruments leave, as `Bounds` has it.
    """
    evidence = hypothesis.evidence
    rivals = [rival.score for rival in hypotheses if rival is not hypothesis]
    lead = hypothesis.score - max(rivals) if rivals else _ALONE
    return Clues(
        psr=log(max(evidence.psr / max(1.0, edge / 128) ** 0.75, 3.0)) - 3,
        view=log(max(evidence.consistency, 0.02)),
        surface=log(max(evidence.surface, 0.02)),
        sharpness=-log(max(evidence.width, 0.03)) - 1.5,
        firmness=log(max(evidence.firmness, 1e-4)) + 3,
        lead=min(max(lead, -_ALONE), _ALONE),
        search=-search / 3,
    )


def hypothesis_probabilities(hypotheses: Sequence[Hypothesis], edge: int, search: float = 0.0) -> list[float]:
    """That each hypothesis, the best first, names the right place, 0..1; arguments as of `clues`.

    Their sum is at most 1.
    """
    probabilities = np.array([right_probability(clues(each, hypotheses, edge, search)) for each in hypotheses])
    # one answer at most is right: what the best leaves is all that the others can have
    left, others = 1 - probabilities[0], probabilities[1:].sum()
    if others > left:
        probabilities[1:] *= left / others
    return probabilities.tolist()


def tolerance_probability(covariance: np.ndarray, voxel: float, instruments: np.ndarray | None = None) -> float:
    """That a pose is within 6 degrees and 3 voxels of the truth, 0..1, where its hypothesis is the right one.

    The right hypothesis may still leave the pose open, as along a wall. Turn and shift are each taken along their
    least sure direction. Where instruments bound that direction, as navigation does over a flat bed, an error of three
    of their standard deviations is none either. Covariances are (6, 6), rotation first [rad, m], that of `instruments`
    by these alone; the voxel is in meters.
    """
    probability = 1.0
    turn = (slice(0, 3), _RIGHT_TURN, _KNOWN_TURN)
    shift = (slice(3, 6), _RIGHT_SHIFT * voxel, _KNOWN_SHIFT * voxel)
    for block, allowed, known in (turn, shift):
        variances, axes = np.linalg.eigh(covariance[block, block])
        if instruments is not None:
            measured = sqrt(axes[:, -1] @ instruments[block, block] @ axes[:, -1])
            allowed = max(allowed, 3 * measured) if measured < known else allowed
        probability *= erf(allowed / sqrt(2 * variances[-1]))
    return probability


def explain(hypothesis: Hypothesis, probability: float, least: float) -> str:
    """The evidence for a hypothesis in words, and why it is believed or not from a probability of `least` on."""
    verdict = "the scans match" if probability >= least else "the scans do not clearly match"
    threshold = "" if probability >= least else f", believed from {least:.0%} on"
    return (
        f"{verdict}; right with a probability of {probability:.1%}{threshold}: the translation's peak is "
        f"{hypothesis.evidence.psr:.1f} standard deviations high, the views agree to "
        f"{hypothesis.evidence.consistency:.0%}, {hypothesis.evidence.overlap:.0%} of the points are shared"
    )


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + exp(-x)) if x > 0 else exp(x) / (1.0 + exp(x))
