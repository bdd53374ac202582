"""From all that was measured of a pair to its registration: the place, the pose there, and whether to believe it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.judge.covariance import PoseCovariance, covers, fit_covariance
from sonarmap.spectral.judge.probability import Clues, clues, explain, fixed_probability, place_probabilities
from sonarmap.spectral.result import Registration
from sonarmap.spectral.verify.hypothesis import Hypothesis
from sonarmap.spectral.verify.observability import Observability
from sonarmap.spectral.verify.pair_frames import PairFrames

# Another hypothesis at least this probable is kept beside the best.
_POSSIBLE = 0.01


def conclude(
    pair: PairFrames, hypotheses: Sequence[Hypothesis], seen: Observability, least: float, voxel: float
) -> Registration:
    """The registration: the best hypothesis, the first, and beside it every other that cannot be excluded.

    It is accepted where its place has a probability of `least` or more, and its pose is fixed there, as the survey's
    voxel [m] has it, on whichever grid the pair is. The best was `seen` so.
    """
    T = [pair.transform(hypothesis.fit) for hypothesis in hypotheses]
    search = pair.bounds.search(pair.grid.extent)
    covariance = _covariance(pair, hypotheses[0], seen)
    kept, probabilities, given = judge(hypotheses, T, covariance.posterior, seen, pair.grid, search)
    best = _registration(pair, hypotheses[0], covariance, probabilities[0], least, voxel)
    others = [
        _registration(pair, hypotheses[n], _covariance(pair, hypotheses[n]), probability, least, voxel)
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
    """Which of the hypotheses, the best first, are answers of their own, how probable each, and by which clues.

    What lies within the uncertainty of the best is no other answer: along a bed that leaves a direction open, or that
    instruments alone bound, the scans fit at many places.

    Args:
        T: of each hypothesis.
        covariance, seen, grid, search: as of `clues`.
    """
    kept = [n for n, other in enumerate(T) if n == 0 or not covers(covariance, T[0], other)]
    distinct = [hypotheses[n] for n in kept]
    given = clues(distinct, seen, covariance, grid, search)
    return kept, place_probabilities(distinct, given), given


def _registration(
    pair: PairFrames,
    hypothesis: Hypothesis,
    covariance: PoseCovariance,
    probability: float,
    least: float,
    voxel: float,
) -> Registration:
    """One hypothesis, right with this probability, as a registration between the sensor frames."""
    fit, evidence = hypothesis.fit, hypothesis.evidence
    T, measured = pair.transform(fit), fit.prior is not None
    refusal = pair.bounds.refusal(T)
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
        reason=refusal or pair.bounds.contradiction(pair.transform(fit.by_scans)) + words,
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
    """The answer where the bound on tilt and priors leave no candidate; nothing is known within an extent [m]."""
    return Registration(
        T_target_source=RigidTransform.identity(),
        covariance=np.diag(np.repeat([np.pi, extent], 3) ** 2),
        psr=0.0,
        overlap=0.0,
        accepted=False,
        seconds=0.0,
        reason="no pose that the bound on tilt and the scans' priors allow brings the scans together",
        probability=0.0,
    )


def _covariance(pair: PairFrames, hypothesis: Hypothesis, seen: Observability | None = None) -> PoseCovariance:
    return fit_covariance(hypothesis, (pair.target.volume.center, pair.source.volume.center), pair.grid, seen)
