"""What is wrong with navigation that the scans contradict: a sign turned, axes exchanged, another unit, rows shifted.

Mistakes are hypotheses: each changes what was measured so that it is right again. Pairs of scans, registered without
the navigation, are compared with it as it is given and as each mistake would have it; the mistake that agrees is named.
All pairs of a finished map together show more than each alone. Mistakes of all scans are among them: mirrored scans
agree with navigation whose roll, heading and East have the other sign.
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
from sonarmap.tools.files.readers.instruments import poses_of, values_of

LEAST_PAIRS = 6
# Right navigation that errs up to 10 times more than stated came to 3.5 in three simulated surveys.
_LEAST_SIGMAS = 4.5
_CAP = 100.0  # of a pair's chi-squared: one wrong registration is not worth more
_RARE = 0.999  # of right pairs this share is below the limit of agreement
_AGREE = 0.8  # share of the pairs that have to agree
# Beside any hypothesis some fixes may be wrong: of at most this share of the scans, each at this price of chi-squared.
_MOST_WRONG, _WRONG = 0.25, 10.0
# Headings are turned by whole degrees up to this, and no less than this.
_MOST_TURNED, _LEAST_TURNED, _COARSE = 45, 3, 3
_KINDS = ((0, 1), (2,), (3, 4), (5,))  # columns that an instrument measures
# Depths alone, that err four times more than stated, came to 4.6 in feet.
_LEAST_OF_A_MAP = 5.5
_MOST_SCANS = 1000  # beyond, the graph takes long to be solved for every hypothesis
_FOOT = 0.3048  # [m]
_ROWS = 10  # rows of scans this far before or behind are tried
_TIE = 20.0  # of chi-squared: two hypotheses so close are both named
_MOST_NAMED = 3
TIMES = (2.0, 4.0, 8.0)  # by which standard deviations may be too small
LENGTHS = np.isin(np.arange(6), (3, 4, 5))  # columns in meters


@dataclass(frozen=True, slots=True)
class Contradiction:
    sigmas: float  # the square root of by how much chi-squared falls
    instead: tuple[str, ...]  # the hypotheses that agree, best first

    def __str__(self) -> str:
        instead = ", or ".join(self.instead)
        return f"the scans contradict the navigation ({self.sigmas:.0f} sigmas); they agree with {instead}"

    @property
    def remedy(self) -> str:
        """What to do about each, in words."""
        return ", or ".join(dict.fromkeys(_REMEDIES.get(name, _TURN) for name in self.instead))


Values = np.ndarray  # (n, 6) in the order of COLUMNS
_Change = Callable[[Values], Values]


def _scaled(by: float, *columns: int) -> _Change:
    return lambda values: values * np.where(np.isin(np.arange(6), columns), by, 1.0)


def _signed(*columns: int) -> _Change:
    return _scaled(-1.0, *columns)


def _exchanged(first: int, second: int) -> _Change:
    order = [{first: second, second: first}.get(k, k) for k in range(6)]
    return lambda values: values[:, order]


def _shifted(by: int) -> _Change:
    def change(values: Values) -> Values:
        moved = np.roll(values, by, axis=0)
        moved[slice(0, by) if by > 0 else slice(by, None)] = np.nan
        return moved

    return change


def added(degrees: float, column: int, sign: float = 1.0) -> _Change:
    return lambda values: np.where(np.arange(6) == column, degrees + sign * values, values)


_COLUMNS = "exchange the columns' names, by --nav-columns"
_TURN = "give the turn by --mount 0,0,DEGREES, or --heading-reference, --magnetic-declination"
# By what is done about them, the mistakes, and the change of the navigation that takes each back.
_MISTAKES: Mapping[str, Mapping[str, _Change]] = {
    "give --nav-frame, or turn the sign in the file": {
        "heading_deg with the opposite sign": _signed(2),
        "roll_deg with the opposite sign": _signed(0),
        "pitch_deg with the opposite sign": _signed(1),
        "roll_deg and pitch_deg with their signs turned": _signed(0, 1),
        "East with the opposite sign": _signed(3),
        "North with the opposite sign": _signed(4),
        "East and North with their signs turned": _signed(3, 4),
        "depth_m with the opposite sign": _signed(5),
    },
    "give --nav-frame enu and name the column yaw": {
        "heading_deg as a yaw, counterclockwise from East": added(90.0, 2, -1.0)
    },
    _TURN: {f"heading_deg turned by {by} degrees": added(by, 2) for by in (90, 180, 270)},
    _COLUMNS: {"roll_deg and pitch_deg exchanged": _exchanged(0, 1), "East and North exchanged": _exchanged(3, 4)},
    "name the columns roll_rad, pitch_rad, heading_rad, by --nav-columns": {
        "angles in radians": _scaled(180 / np.pi, 0, 1, 2)
    },
    "name the unit in the column's heading, as Depth (ft), or convert places to meters": {
        "places in feet": _scaled(_FOOT, 3, 4),
        "depths in feet": _scaled(_FOOT, 5),
        "places and depths in feet": _scaled(_FOOT, 3, 4, 5),
    },
    "give the clock's offset by --nav-offset SECONDS": {
        "the rows of the scans before": _shifted(-1),
        "the rows of the scans after": _shifted(1),
        **{f"the rows {by} scans before": _shifted(-by) for by in range(2, _ROWS + 1)},
        **{f"the rows {by} scans after": _shifted(by) for by in range(2, _ROWS + 1)},
    },
    "give --frame": {
        # with M and W the reflections of y and East, T -> W T M leaves the pairs as mirrored scans have them
        "scans mirrored, left for right": _signed(0, 2, 3),
        "scans upside down": added(180.0, 0),
    },
    "give --units": {
        "scans a thousand times smaller": _scaled(1e3, 3, 4, 5),
        "scans a thousand times larger": _scaled(1e-3, 3, 4, 5),
    },
}
_GEOGRAPHIC = "latitude and longitude exchanged"
_REMEDIES = {name: remedy for remedy, named in _MISTAKES.items() for name in named}
_REMEDIES[_GEOGRAPHIC] = _COLUMNS
SIZES = {"scans a thousand times smaller": 1e3, "scans a thousand times larger": 1e-3}  # lengths err alike


def _geographic(origin: tuple[float, float]) -> _Change:
    """Latitude and longitude exchanged [deg], about an origin that has them so as well."""
    shrink_east, shrink_north = np.cos(np.radians(origin))
    order = [0, 1, 2, 4, 3, 5]
    return lambda values: values[:, order] * np.array([1, 1, 1, shrink_north, 1 / shrink_east, 1])


def corrected(values: Values, origin: tuple[float, float] | None = None) -> Iterator[tuple[str, Values]]:
    """What was measured as each mistake would have it, but for headings turned by other angles; those alone that change
    anything, and of several that do the same and have one remedy the first. `origin`: latitude and longitude of the
    places' origin, where they were read as such [deg]."""
    geographic = {} if origin is None else {_GEOGRAPHIC: _geographic(origin)}
    for remedy, named in _MISTAKES.items():
        before = [values]
        for name, change in {**named, **(geographic if remedy == _COLUMNS else {})}.items():
            changed = change(values)
            if not any(np.array_equal(changed, other, equal_nan=True) for other in before):
                before.append(changed)
                yield name, changed


def best_of(falls: Mapping[str, float], least: float) -> Contradiction | None:
    """The hypotheses that agree better than the navigation as it is given, by how much chi-squared falls, where that is
    by `least` sigmas or more."""
    best = max(falls.values(), default=0.0)
    named = tuple(name for name in sorted(falls, key=lambda name: -falls[name]) if falls[name] > best - _TIE)
    if best < least**2 or len(named) > _MOST_NAMED:
        return None
    return Contradiction(float(np.sqrt(best)), named)


def measured_values(priors: Sequence[PosePrior | None]) -> tuple[Values, np.ndarray]:
    """(n, 6) values, NaN where not measured, and standard deviations [rad, m], the column's usual where it has none."""
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
    """What the scans alone say of n pairs."""

    i: np.ndarray  # i, j: (n,) int64, targets and sources
    j: np.ndarray
    T_i_j: RigidTransform  # n registrations
    covariances: np.ndarray  # (n, 6, 6), rotation first [rad, m], body tangent of j


def contradiction(
    priors: Sequence[PosePrior | None], registered: Registered, origin: tuple[float, float] | None = None
) -> Contradiction | None:
    """What is wrong with the navigation, as far as the scans tell it. Something is named only if most pairs agree with
    it, and the evidence is overwhelming, also beside instruments that err more than stated or say nothing of the way;
    hypotheses that agree alike are named together, or, where there are many, none is. `priors` are of the scans in the
    order of their times, `registered` pairs that registrations without any prior are sure of, `origin` as of
    `corrected`."""
    values, sigmas = measured_values(priors)
    given = pair_costs(values, sigmas, registered)
    if (given[:, 1] > 0).sum() < LEAST_PAIRS:
        return None
    costs: dict[str, np.ndarray] = {}
    for name, changed in corrected(values, origin):
        # deviations stay with their columns and rows
        costs[name] = pair_costs(changed, sigmas * np.where(LENGTHS, SIZES.get(name, 1.0), 1.0), registered)
    turned: dict[int, np.ndarray] = {}
    for step in (_COARSE, 1):
        near = min(turned, key=lambda by: turned[by][:, 0].sum(), default=0)
        reach = _COARSE if turned else _MOST_TURNED
        for by in range(near - reach, near + reach + 1, step):
            if by not in turned and abs(by) >= _LEAST_TURNED:
                turned[by] = pair_costs(added(by, 2)(values), sigmas, registered)
    by = min(turned, key=lambda by: turned[by][:, 0].sum())
    costs[f"heading_deg turned by {by} degrees"] = turned[by]
    return _verdict([given, *_ordinary(values, sigmas, registered)], costs, registered)


def _ordinary(values: Values, sigmas: np.ndarray, registered: Registered) -> list[np.ndarray]:
    """Costs of what is no mistake that has a name: an instrument errs more than it says, or does not see the way."""
    rivals: list[np.ndarray] = []
    for columns in _KINDS:
        own = np.isin(np.arange(6), columns)
        rivals += [pair_costs(values, np.where(own, times * sigmas, sigmas), registered) for times in TIMES]
        rivals.append(pair_costs(np.where(own, 0.0 * values, values), sigmas, registered))
    return rivals


def _without_wrong(costs: np.ndarray, i: np.ndarray, j: np.ndarray) -> float:
    """Chi-squared (n, 3) of pairs i, j (n,) if a few scans, those that explain most of it, have wrong fixes."""
    left, price, scans = costs[:, 0].copy(), 0.0, np.union1d(i, j)
    of_scan = (scans[:, None] == i) | (scans[:, None] == j)
    for _ in range(int(_MOST_WRONG * len(scans))):
        worth = of_scan @ left
        worst = int(np.argmax(worth))
        if worth[worst] <= _WRONG:
            break
        price += _WRONG
        left[of_scan[worst]] = 0.0
    return price + float(left.sum())


def _verdict(
    ordinary: Sequence[np.ndarray], costs: Mapping[str, np.ndarray], registered: Registered
) -> Contradiction | None:
    """The hypotheses that agree, of (n, 3) costs of the pairs under each; the first of those that are `ordinary` is of
    the navigation as it is given."""
    given, falls = ordinary[0], dict[str, float]()
    for name, cost in costs.items():
        both = (cost[:, 1] > 0) & (given[:, 1] > 0)  # rows shifted by one leave a pair at the end
        if both.sum() >= LEAST_PAIRS and (cost[both, 0] <= chi2.ppf(_RARE, cost[both, 1])).mean() >= _AGREE:
            i, j = registered.i[both], registered.j[both]
            rivals = (_without_wrong(each[both], i, j) + float((each - given)[both, 2].sum()) for each in ordinary)
            falls[name] = min(rivals) - _without_wrong(cost[both], i, j)
    return best_of(falls, _LEAST_SIGMAS)


def pair_costs(values: Values, sigmas: np.ndarray, registered: Registered) -> np.ndarray:
    """(n, 3) chi-squared, capped, its degrees of freedom, and the logarithm of the covariance's determinant, of each
    registration beside what was measured of its scans. As `spectral.prior.RelativePrior` has them, for many pairs at
    once; errors of roll and pitch are taken to be alike. `values` (N, 6) are in the order of COLUMNS, NaN where not
    measured; `sigmas` (N, 6) [rad, m]."""
    i, j, T = registered.i, registered.j, registered.T_i_j
    measured = np.isfinite(values)
    poses = poses_of(np.nan_to_num(values))
    places, R_world = poses.translation, poses.rotation
    R_target, R_source = (Rotation.from_quat(R_world.as_quat()[k]) for k in (i, j))
    left = R_target * T.rotation * R_source.inv()
    turn = twist(left)
    tilt = (left * Rotation.from_euler("Z", -turn[:, None])).as_rotvec()[:, :2]
    shift = R_target.apply(T.translation)
    residual = np.column_stack([tilt, turn, shift - places[j] + places[i]])
    both = measured[i] & measured[j]
    attitude, turned = measured[i, :2].all(axis=1), both[:, :2].all(axis=1)
    moved = both[:, 3:5].all(axis=1) & attitude & measured[i, 2]
    known = np.column_stack([turned, turned, turned & both[:, 2], moved, moved, both[:, 5] & attitude])
    covariance = _covariance(np.where(measured, sigmas, 0.0), shift, R_target * T.rotation, registered)
    # what is not known stands apart from the rest, and is 0
    covariance = np.where(known[:, :, None] & known[:, None, :], covariance, np.eye(6))
    residual = np.where(known, residual, 0.0)
    squared = np.einsum("nk,nk->n", residual, np.linalg.solve(covariance, residual[:, :, None])[:, :, 0])
    return np.column_stack([np.minimum(squared, _CAP), known.sum(axis=1), np.linalg.slogdet(covariance)[1]])


def _covariance(sigmas: np.ndarray, shift: np.ndarray, R_world_source: Rotation, registered: Registered) -> np.ndarray:
    """(n, 6, 6) of tilt, tilt, turn, East, North, Up: of both scans' instruments and of the registrations."""
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
    return best_of(falls, _LEAST_OF_A_MAP)


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
