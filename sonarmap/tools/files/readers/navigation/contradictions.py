"""Mistakes in navigation that the scans contradict: a wrong sign, exchanged axes, a wrong unit, shifted rows.

Each mistake is a hypothesis that corrects the measurements. Pairs of scans, registered without the navigation, are
compared with the given and with the corrected navigation; a mistake whose correction agrees is reported. The edges of a
finished map show more than single pairs. Some mistakes concern all scans: mirrored scans agree with navigation whose
roll, heading and East have the opposite sign.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.wrong_measurements import KINDS, TAILS, judge_fixes
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.spectral.geometry import cross_matrices, twist
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.finding import Remedy
from sonarmap.tools.files.readers.instruments import COLUMNS, poses_of, values_of
from sonarmap.tools.files.readers.navigation.correction import Correction

LEAST_PAIRS = 6
_MIN_SIGMAS = 4.5  # evidence from pairs, above which a mistake is reported
_CAP = 100.0  # largest chi-squared of a pair, which bounds the weight of a wrong registration
_CONFIDENCE = 0.999  # quantile of chi-squared up to which a pair agrees
_AGREE = 0.8  # share of the pairs that have to agree
_MAX_WRONG = 0.25  # largest share of the scans whose fixes may be wrong under any hypothesis
_WRONG_COST = 10.0  # chi-squared that each such scan costs
_MAX_TURN = 45  # [deg]
_MIN_TURN = 3  # [deg]
_COARSE = 3  # [deg], first step of the search for a turn, which ends with 1 degree
_KINDS = ((0, 1), (2,), (3, 4), (5,))  # columns that one instrument measures
_MIN_SIGMAS_OF_MAP = 5.5  # evidence from a map, above which a mistake is reported
_MAX_SCANS = 1000  # of a map: every hypothesis optimizes the graph
_ROWS = 10  # largest shift of the rows that is tried
_TIE = 20.0  # hypotheses whose chi-squared differs by less are reported together
_MAX_REPORTED = 3
TIMES = (2.0, 4.0, 8.0)  # factors by which standard deviations may be too small
LENGTHS = np.isin(np.arange(6), (3, 4, 5))  # columns in meters


@dataclass(frozen=True, slots=True)
class Contradiction:
    sigmas: float  # square root of the decrease of chi-squared
    instead: tuple[str, ...]  # mistakes that would explain it, best first

    def __str__(self) -> str:
        instead = ", or ".join(self.instead)
        return f"the scans contradict the navigation ({self.sigmas:.0f} sigmas); they agree with {instead}"

    def remedies(self, interval: float, axes: str = "flu") -> dict[Remedy | str, None]:
        """The options that correct these mistakes; a text where the option's value is unknown.

        interval: time between consecutive scans [s].
        axes: axes of the points, from --frame.
        """
        return dict.fromkeys(each for name in self.instead for each in _remedies(name, interval, axes))


Values = np.ndarray  # (n, 6) in the order of COLUMNS
_Change = Callable[[Values], Values]


def _shifted(by: int) -> _Change:
    def change(values: Values) -> Values:
        moved = np.roll(values, by, axis=0)
        moved[slice(0, by) if by > 0 else slice(by, None)] = np.nan
        return moved

    return change


_TURNED = "heading_deg turned by {} degrees"
# {mistake: what corrects it, as for --correct-priors}
_OF_VALUES = {
    "heading_deg with the opposite sign": "heading_deg=-heading_deg",
    "roll_deg with the opposite sign": "roll_deg=-roll_deg",
    "pitch_deg with the opposite sign": "pitch_deg=-pitch_deg",
    "roll_deg and pitch_deg with their signs turned": "roll_deg=-roll_deg,pitch_deg=-pitch_deg",
    "East with the opposite sign": "x_m=-x_m",
    "North with the opposite sign": "y_m=-y_m",
    "East and North with their signs turned": "x_m=-x_m,y_m=-y_m",
    "depth_m with the opposite sign": "depth_m=-depth_m",
    "heading_deg as a yaw, counterclockwise from East": "heading_deg=90-heading_deg",
    **{_TURNED.format(by): f"heading_deg={by}+heading_deg" for by in (90, 180, 270)},
    "roll_deg and pitch_deg exchanged": "roll_deg=pitch_deg,pitch_deg=roll_deg",
    "East and North exchanged": "x_m=y_m,y_m=x_m",
    "angles in radians": ",".join(f"{angle}=57.2957795*{angle}" for angle in COLUMNS[:3]),
    "places in feet": "x_m=0.3048*x_m,y_m=0.3048*y_m",
    "depths in feet": "depth_m=0.3048*depth_m",
    "places and depths in feet": "x_m=0.3048*x_m,y_m=0.3048*y_m,depth_m=0.3048*depth_m",
}
# {mistake: number of scans that the rows are moved to later ones}
_OF_TIMES = {
    "the rows of the scans before": -1,
    "the rows of the scans after": 1,
    **{f"the rows {by} scans before": -by for by in range(2, _ROWS + 1)},
    **{f"the rows {by} scans after": by for by in range(2, _ROWS + 1)},
}
UPSIDE_DOWN = Remedy("correct_priors", ("roll_deg=180+roll_deg",))
_MIRRORED, _UPSIDE_DOWN = "scans mirrored, left for right", "scans upside down"
# {mistake of the scans: change of the navigation that has the same effect}
_OF_SCANS = {
    # T -> W T M, with M and W the reflections of y and East, gives the relative poses of mirrored scans
    _MIRRORED: "roll_deg=-roll_deg,heading_deg=-heading_deg,x_m=-x_m",
    "scans a thousand times smaller": "x_m=1000*x_m,y_m=1000*y_m,depth_m=1000*depth_m",
    "scans a thousand times larger": "x_m=0.001*x_m,y_m=0.001*y_m,depth_m=0.001*depth_m",
    _UPSIDE_DOWN: UPSIDE_DOWN.values[0],
}
_TO_OTHER_AXES = {_MIRRORED: str.maketrans("lrew", "rlwe"), _UPSIDE_DOWN: str.maketrans("lrewud", "rlwedu")}
SIZES = {"scans a thousand times smaller": 1e3, "scans a thousand times larger": 1e-3}  # factors of sigmas of lengths
_GEOGRAPHIC = "latitude and longitude exchanged"


def _remedies(name: str, interval: float, axes: str) -> tuple[Remedy | str, ...]:
    """The options that correct one mistake; see `Contradiction.remedies`."""
    if name in _OF_TIMES:
        return (Remedy("nav_offset", (f"{_OF_TIMES[name] * interval:.4g}",)),)
    if name in _TO_OTHER_AXES:
        by_axes = Remedy("frame", (axes.translate(_TO_OTHER_AXES[name]),))
        return (by_axes, UPSIDE_DOWN) if name == _UPSIDE_DOWN else (by_axes,)
    if name in SIZES:
        return ("--units",)
    if name == _GEOGRAPHIC:
        return ("--nav-columns with the names of both columns exchanged",)
    text = _OF_VALUES[name] if name in _OF_VALUES else f"heading_deg={name.split()[3]}+heading_deg"
    return (Remedy("correct_priors", (text,)),)


def _geographic(origin: tuple[float, float]) -> _Change:
    """Exchange latitude and longitude, which were also exchanged in the `origin` [deg]."""
    shrink_east, shrink_north = np.cos(np.radians(origin))
    order = [0, 1, 2, 4, 3, 5]
    return lambda values: values[:, order] * np.array([1, 1, 1, shrink_north, 1 / shrink_east, 1])


def corrected(values: Values, origin: tuple[float, float] | None = None) -> Iterator[tuple[str, Values]]:
    """The mistakes and the values corrected for each, without headings turned by other angles. Corrections that change
    nothing, or the same as an earlier one of the same kind, are left out. `origin`: latitude and longitude of the
    origin of positions [deg], if they were read as such."""
    of_values: dict[str, _Change] = {name: Correction.of(text) for name, text in _OF_VALUES.items()}
    of_values |= {} if origin is None else {_GEOGRAPHIC: _geographic(origin)}
    of_times = {name: _shifted(by) for name, by in _OF_TIMES.items()}
    of_scans = {name: Correction.of(text) for name, text in _OF_SCANS.items()}
    for named in (of_values, of_times, of_scans):
        before = [values]
        for name, change in named.items():
            changed = change(values)
            if not any(np.array_equal(changed, other, equal_nan=True) for other in before):
                before.append(changed)
                yield name, changed


def best_of(falls: Mapping[str, float], least: float) -> Contradiction | None:
    """The best hypotheses, if chi-squared decreases by `least` sigmas or more and not too many are about equally good.
    `falls`: decrease of chi-squared by hypothesis."""
    best = max(falls.values(), default=0.0)
    named = tuple(name for name in sorted(falls, key=lambda name: -falls[name]) if falls[name] > best - _TIE)
    if best < least**2 or len(named) > _MAX_REPORTED:
        return None
    return Contradiction(float(np.sqrt(best)), named)


def measured_values(priors: Sequence[PosePrior | None]) -> tuple[Values, np.ndarray]:
    """(n, 6) values, NaN where not measured, and standard deviations [rad, m], there the column's median."""
    values, sigmas = np.full((len(priors), 6), np.nan), np.full((len(priors), 6), np.inf)
    for row, prior in enumerate(priors):
        if prior is not None:
            sigmas[row] = prior.sigmas
            values[row] = np.where(np.isfinite(prior.sigmas), values_of(prior.T_world_sensor), np.nan)
    for column in sigmas.T:
        known = np.isfinite(column)
        column[~known] = np.median(column[known]) if known.any() else 1.0
    return values, sigmas


@dataclass(frozen=True, slots=True)
class Registered:
    """Registrations of n pairs of scans, without the navigation."""

    i: np.ndarray  # (n,) int64, targets
    j: np.ndarray  # (n,) int64, sources
    T_i_j: RigidTransform  # n registrations
    covariances: np.ndarray  # (n, 6, 6), rotation first [rad, m], body tangent of j


def contradiction(
    priors: Sequence[PosePrior | None], registered: Registered, origin: tuple[float, float] | None = None
) -> Contradiction | None:
    """The mistake in the navigation that the scans contradict, or None. A mistake is reported only if most pairs agree
    with its correction and the evidence is strong, also compared with instruments that have larger errors or do not
    see the motion. Equally good hypotheses are reported together; if they are too many, none is. `priors`: of the scans
    in the order of their times; `registered`: confident registrations without a prior; `origin`: as of `corrected`."""
    values, sigmas = measured_values(priors)
    given = pair_costs(values, sigmas, registered)
    if (given[:, 1] > 0).sum() < LEAST_PAIRS:
        return None
    costs: dict[str, np.ndarray] = {}
    for name, changed in corrected(values, origin):
        # standard deviations keep their columns and rows
        costs[name] = pair_costs(changed, sigmas * np.where(LENGTHS, SIZES.get(name, 1.0), 1.0), registered)
    turned: dict[int, np.ndarray] = {}
    for step in (_COARSE, 1):
        near = min(turned, key=lambda by: turned[by][:, 0].sum(), default=0)
        reach = _COARSE if turned else _MAX_TURN
        for by in range(near - reach, near + reach + 1, step):
            if by not in turned and abs(by) >= _MIN_TURN:
                turned[by] = pair_costs(values + by * (np.arange(6) == 2), sigmas, registered)
    by = min(turned, key=lambda by: turned[by][:, 0].sum())
    costs[_TURNED.format(by)] = turned[by]
    return _verdict([given, *_ordinary(values, sigmas, registered)], costs, registered)


def _ordinary(values: Values, sigmas: np.ndarray, registered: Registered) -> list[np.ndarray]:
    """Costs under explanations without a mistake: an instrument has larger errors, or does not see the motion."""
    rivals: list[np.ndarray] = []
    for columns in _KINDS:
        of_kind = np.isin(np.arange(6), columns)
        rivals += [pair_costs(values, np.where(of_kind, times * sigmas, sigmas), registered) for times in TIMES]
        rivals.append(pair_costs(np.where(of_kind, 0.0 * values, values), sigmas, registered))
    return rivals


def _without_wrong(costs: np.ndarray, i: np.ndarray, j: np.ndarray) -> float:
    """Total chi-squared of pairs i, j (n,) with `costs` (n, 3) if the few scans with most of it have wrong fixes."""
    rest, price, scans = costs[:, 0].copy(), 0.0, np.union1d(i, j)
    of_scan = (scans[:, None] == i) | (scans[:, None] == j)
    for _ in range(int(_MAX_WRONG * len(scans))):
        worth = of_scan @ rest
        worst = int(np.argmax(worth))
        if worth[worst] <= _WRONG_COST:
            break
        price += _WRONG_COST
        rest[of_scan[worst]] = 0.0
    return price + float(rest.sum())


def _verdict(
    ordinary: Sequence[np.ndarray], costs: Mapping[str, np.ndarray], registered: Registered
) -> Contradiction | None:
    """The best of the hypotheses, from the (n, 3) `costs` of the pairs under each, compared with the `ordinary`
    explanations, of which the first is the given navigation."""
    given, falls = ordinary[0], dict[str, float]()
    for name, cost in costs.items():
        both = (cost[:, 1] > 0) & (given[:, 1] > 0)  # shifted rows leave pairs at the end without values
        if both.sum() >= LEAST_PAIRS and (cost[both, 0] <= chi2.ppf(_CONFIDENCE, cost[both, 1])).mean() >= _AGREE:
            i, j = registered.i[both], registered.j[both]
            rivals = (_without_wrong(each[both], i, j) + float((each - given)[both, 2].sum()) for each in ordinary)
            falls[name] = min(rivals) - _without_wrong(cost[both], i, j)
    return best_of(falls, _MIN_SIGMAS)


def pair_costs(values: Values, sigmas: np.ndarray, registered: Registered) -> np.ndarray:
    """(n, 3) capped chi-squared, degrees of freedom, and log determinant of the covariance, of each registration
    compared with the measurements of its scans, as in `spectral.prior.RelativePrior` for many pairs at once. Roll and
    pitch have equal errors. `values` (N, 6) are in the order of COLUMNS, NaN where not measured; `sigmas` (N, 6) [rad,
    m]."""
    i, j, T = registered.i, registered.j, registered.T_i_j
    measured = np.isfinite(values)
    poses = poses_of(np.nan_to_num(values))
    places, R_world = poses.translation, poses.rotation
    R_target, R_source = (Rotation.from_quat(R_world.as_quat()[k]) for k in (i, j))
    error = R_target * T.rotation * R_source.inv()
    turn = twist(error)
    tilt = (error * Rotation.from_euler("Z", -turn[:, None])).as_rotvec()[:, :2]
    shift = R_target.apply(T.translation)
    residual = np.column_stack([tilt, turn, shift - places[j] + places[i]])
    both = measured[i] & measured[j]
    attitude, turned = measured[i, :2].all(axis=1), both[:, :2].all(axis=1)
    moved = both[:, 3:5].all(axis=1) & attitude & measured[i, 2]
    known = np.column_stack([turned, turned, turned & both[:, 2], moved, moved, both[:, 5] & attitude])
    covariance = _covariance(np.where(measured, sigmas, 0.0), shift, R_target * T.rotation, registered)
    # unknown residuals are 0 and uncorrelated with the others
    covariance = np.where(known[:, :, None] & known[:, None, :], covariance, np.eye(6))
    residual = np.where(known, residual, 0.0)
    squared = np.einsum("nk,nk->n", residual, np.linalg.solve(covariance, residual[:, :, None])[:, :, 0])
    return np.column_stack([np.minimum(squared, _CAP), known.sum(axis=1), np.linalg.slogdet(covariance)[1]])


def _covariance(sigmas: np.ndarray, shift: np.ndarray, R_world_source: Rotation, registered: Registered) -> np.ndarray:
    """(n, 6, 6) covariance of the residuals tilt, tilt, turn, East, North, Up, of instruments and registrations."""
    i, j = registered.i, registered.j
    variances = sigmas**2
    variances[:, :2] = variances[:, :2].max(axis=1, keepdims=True)
    # an error of the target's rotation turns the pose and the shift
    of_target = np.concatenate([np.broadcast_to(np.eye(3), (len(i), 3, 3)), -cross_matrices(shift)], axis=1)
    covariance = of_target * variances[i, None, :3] @ of_target.transpose(0, 2, 1)
    diagonal = np.concatenate([variances[j, :3], variances[i, 3:] + variances[j, 3:]], axis=1)
    covariance += diagonal[:, :, None] * np.eye(6)
    of_tangent = np.zeros((len(i), 6, 6))
    of_tangent[:, :3, :3] = of_tangent[:, 3:, 3:] = R_world_source.as_matrix()
    return covariance + of_tangent @ registered.covariances @ of_tangent.transpose(0, 2, 1)


def contradiction_of_map(
    graph: PoseGraph,
    priors: Sequence[PosePrior | None],
    kinds: Sequence[str],
    origin: tuple[float, float] | None = None,
) -> Contradiction | None:
    """The mistake whose correction makes measurements of these kinds, whose errors are too large, agree with a map.

    Args:
        graph: pose graph of the map, at its optimum.
        priors: given measurements of all scans.
        kinds: of `slam.decide.wrong_measurements`.
        origin: as of `corrected`.
    """
    if len(priors) > _MAX_SCANS:
        return None
    values, sigmas = measured_values(priors)
    columns = [k for kind in kinds if kind in KINDS for k in range(*KINDS[kind].indices(6))]
    used = np.isin(np.arange(6), columns) & np.isfinite(values).any(axis=0)
    given, edges = _residuals(graph, values, sigmas)
    counted = np.isfinite(values)[:, used].sum()
    ordinary = [
        _cost(np.where(used, given / times, given), 1) + edges + 2 * counted * np.log(times) for times in (1.0, *TIMES)
    ]
    ordinary.append(_total(graph, np.where(used, 0.0 * values, values), sigmas))
    falls: dict[str, float] = {}
    for name, changed in corrected(values, origin):
        differ = ~np.isclose(changed, values, equal_nan=True).all(axis=0)
        # shifted rows and scaled scans are hypotheses for pairs only
        if np.isnan(changed).sum() == np.isnan(values).sum() and name not in SIZES and (differ & used).any():
            falls[name] = min(ordinary) - _total(graph, changed, sigmas)
    return best_of(falls, _MIN_SIGMAS_OF_MAP)


def _cost(residuals: np.ndarray, numbers: int) -> float:
    """-2 log likelihood of `residuals` [sigmas] of `numbers` dimensions each under Student's t; NaN counts 0."""
    return float(np.nansum((TAILS + numbers) * np.log1p(residuals**2 / TAILS)))


def _total(graph: PoseGraph, values: Values, sigmas: np.ndarray) -> float:
    """Cost of the measurements and edges together; infinite if the graph has no solution."""
    try:
        residuals, edges = _residuals(graph, values, sigmas)
    except InputError:
        return np.inf
    return _cost(residuals, 1) + edges


def _residuals(graph: PoseGraph, values: Values, sigmas: np.ndarray) -> tuple[np.ndarray, float]:
    """(n, 6) residuals of the measurements at the optimum [sigmas], and the cost of the edges there."""
    known = np.isfinite(values)
    poses = poses_of(np.nan_to_num(values))
    given = {
        k: PosePrior(poses[k], np.where(known[k], sigmas[k], np.inf))
        for k in np.flatnonzero(known.any(axis=1)).tolist()
    }
    judged = judge_fixes(replace(graph, priors=()), given)
    solution = replace(graph, priors=tuple(sorted(judged.priors.items()))).optimize(covariances=False)
    residuals = values - values_of(solution.trajectory.T_world_sensor)
    residuals[:, :3] = np.radians((residuals[:, :3] + 180) % 360 - 180)
    return residuals / sigmas, _cost(solution.residuals, 6)
