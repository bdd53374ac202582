"""The registration of a pair from its measured hypotheses: probabilities, covariance, and verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations_with_replacement
from math import erf, log, log1p, sqrt
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import expit

from sonarmap.spectral.covariance import PoseCovariance, covers, fit_covariance, slides_of
from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.result import Registration
from sonarmap.spectral.verify.bounds import PairFrames
from sonarmap.spectral.verify.hypothesis import MOST_MEASURED, Hypothesis
from sonarmap.spectral.verify.verifier import Observability


@dataclass(frozen=True, slots=True)
class Odds:
    """Quadratic logistic model of K clues, which are clipped to the range of the fitted data and standardized."""

    names: tuple[str, ...]  # of the clues
    # low, high, mean, deviation: (K,) of the fitted data
    low: np.ndarray
    high: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    constant: float = 0.0
    weights: np.ndarray | None = None  # (M,) of the clues, then of their products; None before the fit

    @property
    def terms(self) -> list[str]:
        """Names of the M terms, such as "psr" or "psr view"."""
        return [*self.names, *(" ".join(pair) for pair in combinations_with_replacement(self.names, 2))]

    def columns(self, clues: np.ndarray) -> np.ndarray:
        """(N, M) terms of (N, K) clues."""
        x = (np.clip(clues, self.low, self.high) - self.mean) / self.deviation
        first, second = np.array(list(combinations_with_replacement(range(x.shape[1]), 2))).T
        return np.hstack([x, x[:, first] * x[:, second]])

    def of(self, clues: np.ndarray) -> np.ndarray:
        """(N,) log odds of (N, K) clues."""
        return self.constant + self.columns(clues) @ self.weights

    def to_json(self) -> dict[str, Any]:
        ranges = np.column_stack([self.low, self.high, self.mean, self.deviation]).round(4).tolist()
        weights = [] if self.weights is None else self.weights.round(4).tolist()
        return {
            "constant": round(self.constant, 4),
            "clues": dict(zip(self.names, ranges, strict=True)),
            "weights": dict(zip(self.terms, weights, strict=True)),
        }

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> "Odds":
        low, high, mean, deviation = np.array(list(table["clues"].values())).T
        weights = np.array(list(table["weights"].values()))
        return cls(tuple(table["clues"]), low, high, mean, deviation, table["constant"], weights)


# Largest errors of a fixed pose.
_FIXED_TURN = float(np.deg2rad(6.0))  # [rad]
_FIXED_SHIFT = 3.0  # [voxels]
# Instruments bound a direction if their standard deviation is smaller than this. So may the predicted motion of a
# vehicle that turns at the ends of short lanes: its sigma is up to 28 degrees while few steps are known.
_KNOWN_TURN = float(np.deg2rad(30.0))  # [rad]
_KNOWN_SHIFT = 16.0  # [voxels]
_ALONE = 4.0  # lead of a hypothesis without rivals, and largest lead


@dataclass(frozen=True, slots=True)
class Clues:
    """Inputs to the probability of the best hypothesis; all but `measured` are logarithms."""

    psr: float  # of the translation's peak, scaled to a grid of 128 voxels, as false peaks are higher on larger grids
    view: float  # of the consistency of the views, or of the surfaces without a view
    surface: float  # of the consistency of the surfaces
    sharpness: float  # of the inverse of the distance between the surfaces
    firmness: float  # of the firmness with which the planes constrain the pose
    overlap: float  # of the share of points in common
    lead: float  # its score, which is a logarithm, minus the next best one
    rivals: float  # of the number of hypotheses
    search: float  # of the inverse of the share of poses that instruments leave, as chance agreement is rarer then
    moved: float  # of the distance between the pose and the identity
    measured: float  # chi-squared of the pose by the instruments
    openness: float  # of the standard deviation along the least certain direction
    # slide_0, slide_1, slide_2: of the correlation beside the peak along each direction, the least constrained first
    slide_0: float
    slide_1: float
    slide_2: float
    # turn_0, turn_1: of the peak's height under turns about the two least constrained axes
    turn_0: float
    turn_1: float

    def numbers(self) -> tuple[tuple[str, float], ...]:
        return tuple((f"p_{name}", float(value)) for name, value in asdict(self).items())


_ODDS = Odds.from_json(FITTED["probability"])
_TWIN = FITTED["probability"]["twin"]


def clues(
    hypotheses: Sequence[Hypothesis], seen: Observability, covariance: np.ndarray, grid: Grid, search: float = 0.0
) -> Clues:
    """Clues of the best hypothesis, which is the first; all are measured on the whole grid.

    `seen` and the covariance (6, 6), rotation first [rad, m], are those of the best; `search` is the logarithm, base
    10, of the share of all poses that instruments leave.
    """
    evidence = hypotheses[0].evidence
    lead = min((hypotheses[0].score - rival.score for rival in hypotheses[1:]), default=_ALONE)
    slides, turns = slides_of(seen)[:, 0].tolist(), np.log(seen.turns).tolist()
    return Clues(
        psr=log(max(evidence.psr / max(1.0, grid.edge / 128) ** 0.75, 3.0)) - 3,
        view=log(max(evidence.consistency, 0.02)),
        surface=log(max(evidence.surface, 0.02)),
        sharpness=-log(max(evidence.width, 0.03)) - 1.5,
        firmness=log(max(evidence.firmness, 1e-4)) + 3,
        overlap=log(max(evidence.overlap, 0.02)),
        lead=min(max(lead, -_ALONE), _ALONE),
        rivals=log(len(hypotheses)),
        search=-search / 3,
        moved=log1p(evidence.moved),
        measured=min(evidence.measured, MOST_MEASURED),
        openness=log(np.linalg.eigvalsh(covariance[3:, 3:])[-1]) / 2 - log(grid.voxel),
        slide_0=slides[0],
        slide_1=slides[1],
        slide_2=slides[2],
        turn_0=turns[0],
        turn_1=turns[1],
    )


def place_probabilities(hypotheses: Sequence[Hypothesis], given: Clues) -> list[float]:
    """Probability that each hypothesis, best first, has the right place, 0..1; their sum is below 1.

    The sum is the logistic function of the clues, divided among hypotheses by score: 1/2 each for exact twins.
    """
    clear = expit(_ODDS.of(np.array([list(asdict(given).values())])))
    return (clear * shares(hypotheses)).tolist()


def _with_odds(probabilities: Sequence[float], odds: Sequence[float]) -> list[float]:
    """Probabilities of distinct hypotheses after further evidence that multiplies their odds against all being wrong,
    by Bayes' rule."""
    weights = np.multiply(probabilities, odds)
    return (weights / (weights.sum() + 1 - np.sum(probabilities))).tolist()


def shares(hypotheses: Sequence[Hypothesis]) -> np.ndarray:
    """(n,) share of each hypothesis in the total probability, by the scores alone."""
    scores = np.array([hypothesis.score for hypothesis in hypotheses])
    weights = np.exp(_TWIN * (scores - scores.max()))
    return weights / weights.sum()


def fixed_probability(covariance: np.ndarray, voxel: float, instruments: np.ndarray | None = None) -> float:
    """Probability that a pose is within 6 degrees and 3 voxels of the truth, 0..1, given the right place.

    Turn and shift are each taken along their least certain direction. If instruments bound that direction, as
    navigation does over a flat bed, errors up to three of their standard deviations are allowed. Covariances are (6,
    6), rotation first [rad, m], `instruments` that by instruments alone; the voxel is in meters.
    """
    probability = 1.0
    turn = (slice(0, 3), _FIXED_TURN, _KNOWN_TURN)
    shift = (slice(3, 6), _FIXED_SHIFT * voxel, _KNOWN_SHIFT * voxel)
    for block, allowed, known in (turn, shift):
        variances, axes = np.linalg.eigh(covariance[block, block])
        if instruments is not None:
            measured = sqrt(axes[:, -1] @ instruments[block, block] @ axes[:, -1])
            allowed = max(allowed, 3 * measured) if measured < known else allowed
        probability *= erf(allowed / sqrt(2 * variances[-1]))
    return probability


def explain(hypothesis: Hypothesis, probability: float, least: float, fixed: bool) -> str:
    """The evidence for a hypothesis, and its verdict with `least` as the threshold of the probability, in words."""
    verdict = "the scans match" if probability >= least else "the scans do not clearly match"
    threshold = "" if probability >= least else f", wanted at least {least:.0%}"
    opened = "" if fixed else "; but one direction of the pose is unconstrained, as along a wall: see the covariance"
    return (
        f"{verdict}; right with a probability of {probability:.1%}{threshold}: the translation's peak is "
        f"{hypothesis.evidence.psr:.1f} standard deviations high, the views agree to "
        f"{hypothesis.evidence.consistency:.0%}, {hypothesis.evidence.overlap:.0%} of the points are shared{opened}"
    )


# Minimum probability of an alternative.
_POSSIBLE = 0.01


def conclude(
    pair: PairFrames, hypotheses: Sequence[Hypothesis], seen: Observability, least: float, voxel: float
) -> Registration:
    """The registration by the best hypothesis, which is the first; others that cannot be excluded are alternatives.

    It is accepted if its place has at least the probability `least` and its pose is fixed, in units of the survey's
    voxel [m], whichever grid the pair is on. `seen` is the observability at the best.
    """
    T = [pair.transform(hypothesis.fit) for hypothesis in hypotheses]
    search = pair.bounds.search(pair.grid.extent)
    covariance = _covariance(pair, hypotheses[0], seen)
    kept, probabilities, given = judge(hypotheses, T, covariance.posterior, seen, pair.grid, search)
    probabilities = _with_odds(probabilities, [pair.bounds.odds_of_place(T[n], voxel) for n in kept])
    best = _registration(pair, hypotheses[0], T[0], covariance, probabilities[0], least, voxel)
    others = [
        _registration(pair, hypotheses[n], T[n], _covariance(pair, hypotheses[n]), probability, least, voxel)
        for n, probability in zip(kept[1:], probabilities[1:], strict=True)
        if probability >= _POSSIBLE
    ]
    return replace(best, evidence=(*given.numbers(), *best.evidence), alternatives=tuple(others))


def judge(
    hypotheses: Sequence[Hypothesis],
    T: Sequence[RigidTransform],
    covariance: np.ndarray,
    seen: Observability,
    grid: Grid,
    search: float,
) -> tuple[list[int], list[float], Clues]:
    """Indices of the distinct hypotheses, best first, their probabilities, and the clues.

    Hypotheses within the uncertainty of the best are dropped: over a bed that leaves a direction unconstrained, or
    bounded by instruments alone, the scans fit at many places. T has the pose of each; for the rest see `clues`.
    """
    kept = [n for n, other in enumerate(T) if n == 0 or not covers(covariance, T[0], other)]
    distinct = [hypotheses[n] for n in kept]
    given = clues(distinct, seen, covariance, grid, search)
    return kept, place_probabilities(distinct, given), given


def _registration(
    pair: PairFrames,
    hypothesis: Hypothesis,
    T: RigidTransform,
    covariance: PoseCovariance,
    probability: float,
    least: float,
    voxel: float,
) -> Registration:
    """One hypothesis, with its pose T and its probability, as a registration between the sensor frames."""
    fit, evidence, measured = hypothesis.fit, hypothesis.evidence, hypothesis.fit.prior is not None
    refusal = pair.bounds.refusal(fit.R, T.translation)
    contradiction = pair.bounds.contradiction(pair.transform(fit.by_scans)) if measured else ""
    fixed = fixed_probability(covariance.posterior, voxel, covariance.by_instruments)
    is_fixed = fixed >= FITTED["acceptance"]["fixed"]
    stretch = () if fit.stretch is None else (("stretch", float(fit.stretch[0] - fit.stretch[1])),)
    words = explain(hypothesis, probability, least, is_fixed)
    return Registration(
        T_target_source=T,
        covariance=covariance.posterior,
        psr=evidence.psr,
        overlap=evidence.overlap,
        accepted=probability >= least and is_fixed and not refusal,
        seconds=0.0,
        reason=refusal or contradiction + words,
        probability=0.0 if refusal else probability,
        step_psr=(
            ("rotation", hypothesis.rotation_score),
            ("candidate", hypothesis.candidate_psr),
            ("translation", evidence.psr),
        ),
        T_by_scans=pair.transform(replace(fit, step=covariance.step).by_scans) if measured else None,
        covariance_by_scans=covariance.by_scans if measured else None,
        evidence=(("fixed", fixed), *stretch),
    )


def no_candidates(extent: float) -> Registration:
    """A refused registration if tilt bound and priors leave no candidate; `extent` [m] is the sigma of the shift."""
    return Registration(
        T_target_source=RigidTransform.identity(),
        covariance=np.diag(np.repeat([np.pi, extent], 3) ** 2),
        psr=0.0,
        overlap=0.0,
        accepted=False,
        seconds=0.0,
        reason="no pose within the bound on tilt and the scans' priors aligns the scans",
        probability=0.0,
    )


def _covariance(pair: PairFrames, hypothesis: Hypothesis, seen: Observability | None = None) -> PoseCovariance:
    centers = pair.target.volume.center, pair.source.volume.center
    return fit_covariance(hypothesis, centers, pair.grid, seen, is_measured=pair.bounds.by_instruments)
