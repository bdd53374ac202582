# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""What is wrong with navigation that a finished map contradicts: all its pairs together show more than each alone."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.wrong_measurements import KINDS, TAILS, judge_fixes
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import poses_of, values_of
from sonarmap.tools.files.readers.navigation.check.mistakes import (
    SIZES,
    TIMES,
    Contradiction,
    Values,
    best_of,
    corrected,
    measured_values,
)

# Depths alone, that err four times more than stated, came to 4.6 in feet.
_LEAST_SIGMAS = 5.5
_MOST_SCANS = 1000  # beyond, the graph takes long to be solved for every hypothesis


def contradiction_of_map(
    graph: PoseGraph,
    priors: Sequence[PosePrior | None],
    kinds: Sequence[str],
    origin: tuple[float, float] | None = None,
) -> Contradiction | None:
    """What would have measurements of these kinds, which err more than stated, agree with a map's edges.

    Args:
        graph: of the map, with its optimum.
        priors: what instruments measured of all scans, as it was given.
        kinds: of `slam.decide.wrong_measurements`.
        origin: as of `mistakes.corrected`.
    """
    if len(priors) > _MOST_SCANS:
        return None
    values, sigmas = measured_values(priors)
    columns = [k for kind in kinds if kind in KINDS for k in range(*KINDS[kind].indices(6))]
    own = np.isin(np.arange(6), columns) & np.isfinite(values).any(axis=0)
    given, edges = _apart(graph, values, sigmas)
    counted = np.isfinite(values)[:, own].sum()
    ordinary = [
        _cost(np.where(own, given / times, given), 1) + edges + 2 * counted * np.log(times) for times in (1.0, *TIMES)
    ]
    ordinary.append(_total(graph, np.where(own, 0.0 * values, values), sigmas))
    falls: dict[str, float] = {}
    for name, changed in corrected(values, origin):
        differ = ~np.isclose(changed, values, equal_nan=True).all(axis=0)
        # rows at other scans, and lengths of all scans, were asked of pairs
        if np.isnan(changed).sum() == np.isnan(values).sum() and name not in SIZES and (differ & own).any():
            falls[name] = min(ordinary) - _total(graph, changed, sigmas)
    return best_of(falls, _LEAST_SIGMAS)


def _cost(apart: np.ndarray, numbers: int) -> float:
    """Twice the negative logarithm of the likelihood of tails, of so many numbers each, in sigmas; without NaN."""
    return float(np.nansum((TAILS + numbers) * np.log1p(apart**2 / TAILS)))


def _total(graph: PoseGraph, values: Values, sigmas: np.ndarray) -> float:
    """What measurements and edges cost together; infinite where these leave no solution."""
    try:
        apart, edges = _apart(graph, values, sigmas)
    except InputError:
        return np.inf
    return _cost(apart, 1) + edges


def _apart(graph: PoseGraph, values: Values, sigmas: np.ndarray) -> tuple[np.ndarray, float]:
    """(n, 6) how far the optimum is from what was measured [sigmas], and what that costs of the edges."""
    known = np.isfinite(values)
    poses = poses_of(np.nan_to_num(values))
    given = {
        k: PosePrior(poses[k], np.where(known[k], sigmas[k], np.inf))
        for k in np.flatnonzero(known.any(axis=1)).tolist()
    }
    judged = judge_fixes(replace(graph, priors=()), given)
    solution = replace(graph, priors=tuple(sorted(judged.priors.items()))).optimize(covariances=False)
    apart = values - values_of(solution.trajectory.T_world_sensor)
    apart[:, :3] = np.radians((apart[:, :3] + 180) % 360 - 180)
    return apart / sigmas, _cost(solution.residuals, 6)
