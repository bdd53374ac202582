# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""What is wrong with navigation that the scans contradict: a sign turned, axes exchanged, rows shifted.

Each hypothesis changes the navigation, or the registrations, as the mistake would have; the one that agrees where
the given one does not is named.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from sonarmap.spectral.covariance_at_sensor import cross_matrices
from sonarmap.spectral.measured import twist
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import poses_of, values_of

LEAST_PAIRS = 6
_CAP = 100.0  # of a pair's chi-squared: one wrong registration is not worth more
_RARE = 0.999  # of right pairs this share is below the limit of agreement
_AGREE, _CONTRADICT = 0.8, 0.75  # shares of the pairs that have to agree, and at most may
_LEAST_SIGMAS = 8.0
_TIE = 20.0  # of chi-squared: two hypotheses so close are both named
_MOST_NAMED = 3
# Beside any hypothesis some fixes may be wrong: of at most this share of the scans, each at this price of chi-squared.
_MOST_WRONG, _WRONG = 0.25, 10.0
_ROWS = 10  # rows of scans this far before or behind are tried
# Headings are turned by whole degrees up to this, and no less than this.
_MOST_TURNED, _LEAST_TURNED = 45, 3
_FOOT = 0.3048  # [m]


@dataclass(frozen=True, slots=True)
class Registered:
    """What the scans alone say of n pairs."""

    i: np.ndarray  # i, j: (n,) int64, targets and sources
    j: np.ndarray
    T_i_j: RigidTransform  # n registrations
    covariances: np.ndarray  # (n, 6, 6), rotation first [rad, m], body tangent of j

    def changed(self, change: np.ndarray, scale: float = 1.0) -> "Registered":
        """With all points of all scans changed by a rotation or reflection (3, 3) and a scale."""
        R = Rotation.from_matrix(change @ self.T_i_j.rotation.as_matrix() @ change.T)
        shifts = scale * self.T_i_j.translation @ change.T
        # a turn is an axial vector: a reflection changes its sign as well
        of_tangent = block_diag(np.linalg.det(change) * change, scale * change)
        covariances = of_tangent @ self.covariances @ of_tangent.T
        return Registered(self.i, self.j, RigidTransform.from_components(shifts, R), covariances)


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Navigation that the scans contradict, and what would agree."""

    sigmas: float  # the square root of by how much chi-squared falls
    instead: tuple[str, ...]  # the hypotheses that agree, best first

    def __str__(self) -> str:
        instead = ", or ".join(self.instead)
        return f"the scans contradict the navigation ({self.sigmas:.0f} sigmas); they agree with {instead}"

    @property
    def remedy(self) -> str:
        """What to do about each, in words."""
        found = (next((todo for words, todo in _REMEDIES.items() if words in name), "") for name in self.instead)
        return ", or ".join(dict.fromkeys(todo for todo in found if todo))


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


def _headed(degrees: float, sign: float = 1.0) -> _Change:
    return lambda values: np.column_stack([values[:, :2], degrees + sign * values[:, 2], values[:, 3:]])


_NAVIGATION: Mapping[str, _Change] = {
    "heading_deg with its sign turned": _signed(2),
    "heading_deg as a yaw, counterclockwise from East": _headed(90.0, -1.0),
    "heading_deg turned by 90 degrees": _headed(90.0),
    "heading_deg turned by 180 degrees": _headed(180.0),
    "heading_deg turned by 270 degrees": _headed(270.0),
    "roll_deg with its sign turned": _signed(0),
    "pitch_deg with its sign turned": _signed(1),
    "roll_deg and pitch_deg with their signs turned": _signed(0, 1),
    "roll_deg and pitch_deg exchanged": _exchanged(0, 1),
    "East and North exchanged": _exchanged(3, 4),
    "East with its sign turned": _signed(3),
    "North with its sign turned": _signed(4),
    "East and North with their signs turned": _signed(3, 4),
    "depth_m with its sign turned": _signed(5),
    "angles in radians": _scaled(180 / np.pi, 0, 1, 2),
    "places in feet": _scaled(_FOOT, 3, 4),
    "places and depths in feet": _scaled(_FOOT, 3, 4, 5),
    "depths in feet": _scaled(_FOOT, 5),
    "the rows of the scans before": _shifted(-1),
    "the rows of the scans after": _shifted(1),
    **{f"the rows {by} scans before": _shifted(-by) for by in range(2, _ROWS + 1)},
    **{f"the rows {by} scans after": _shifted(by) for by in range(2, _ROWS + 1)},
}

# By words of a hypothesis, what is done about it; the first that fits counts.
_REMEDIES = {
    "as a yaw": "give --nav-frame enu and name the column yaw",
    "heading_deg turned": "give the turn by --mount 0,0,DEGREES, or --heading-reference, --magnetic-declination",
    "exchanged": "exchange the columns' names, by --nav-columns",
    "sign": "give --nav-frame, or turn the sign in the file",
    "radians": "name the columns roll_rad, pitch_rad, heading_rad, by --nav-columns",
    "feet": "name the unit in the column's heading, as Depth (ft), or convert places to meters",
    "the rows": "give the clock's offset by --nav-offset SECONDS",
    "scans mirrored": "give --frame",
    "scans upside down": "give --frame",
    "scans a thousand": "give --units",
}


_SCANS: Mapping[str, tuple[np.ndarray, float]] = {
    "scans mirrored, left for right": (np.diag([1.0, -1.0, 1.0]), 1.0),
    "scans upside down": (np.diag([1.0, -1.0, -1.0]), 1.0),
    "scans a thousand times smaller": (np.eye(3), 1e-3),
    "scans a thousand times larger": (np.eye(3), 1e3),
}


def contradiction(priors: Sequence[PosePrior | None], registered: Registered) -> Contradiction | None:
    """What is wrong with the navigation, as far as the scans tell it. Something is named only if many pairs contradict
    the navigation as it is, most agree with it changed, and the evidence is overwhelming; hypotheses that agree alike
    are named together, or, where there are many, none is. `priors` are of the scans in the order of their times,
    `registered` pairs that registrations without any prior are sure of."""
    values, sigmas = _table(priors)
    given = pair_costs(values, sigmas, registered)
    counted = given[:, 1] > 0
    if counted.sum() < LEAST_PAIRS or _agreeing(given[counted]) > _CONTRADICT:
        return None
    costs: dict[str, np.ndarray] = {}
    for name, change in _NAVIGATION.items():
        if not np.array_equal(changed := change(values), values, equal_nan=True):
            costs[name] = pair_costs(changed, sigmas, registered)  # deviations stay with their columns and rows
    turns = [*range(-_MOST_TURNED, 1 - _LEAST_TURNED), *range(_LEAST_TURNED, _MOST_TURNED + 1)]
    turned = {by: pair_costs(_headed(by)(values), sigmas, registered) for by in turns}
    by = min(turned, key=lambda by: turned[by][:, 0].sum())
    costs[f"heading_deg turned by {by} degrees"] = turned[by]
    for name, (axes, scale) in _SCANS.items():
        costs[name] = pair_costs(values, sigmas, registered.changed(axes, scale))
    return _verdict(given, costs, registered)


def _without_wrong(costs: np.ndarray, i: np.ndarray, j: np.ndarray) -> float:
    """Chi-squared (n, 2) of pairs i, j (n,) if a few scans, those that explain most of it, have wrong fixes."""
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


def _verdict(given: np.ndarray, costs: Mapping[str, np.ndarray], registered: Registered) -> Contradiction | None:
    """The hypotheses that agree, of (n, 2) chi-squared and degrees of freedom of the pairs under each."""
    falls: dict[str, float] = {}
    for name, cost in costs.items():
        both = (cost[:, 1] > 0) & (given[:, 1] > 0)  # rows shifted by one leave a pair at the end
        if both.sum() >= LEAST_PAIRS and _agreeing(cost[both]) >= _AGREE:
            i, j = registered.i[both], registered.j[both]
            falls[name] = _without_wrong(given[both], i, j) - _without_wrong(cost[both], i, j)
    best = max(falls.values(), default=0.0)
    named = tuple(name for name in sorted(falls, key=lambda name: -falls[name]) if falls[name] > best - _TIE)
    if best < _LEAST_SIGMAS**2 or len(named) > _MOST_NAMED:
        return None
    return Contradiction(float(np.sqrt(best)), named)


def _agreeing(costs: np.ndarray) -> float:
    """The share of pairs (n, 2) that agree."""
    return float((costs[:, 0] <= chi2.ppf(_RARE, costs[:, 1])).mean())


def pair_costs(values: Values, sigmas: np.ndarray, registered: Registered) -> np.ndarray:
    """(n, 2) chi-squared, capped, and degrees of freedom, of each registration beside what was measured of its scans.
    As `spectral.prior_pair.PriorPair` has them, for many pairs at once; errors of roll and pitch are taken to be alike.
    `values` (N, 6) are in the order of COLUMNS, NaN where not measured; `sigmas` (N, 6) [rad, m]."""
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
    return np.column_stack([np.minimum(squared, _CAP), known.sum(axis=1)])


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


def _table(priors: Sequence[PosePrior | None]) -> tuple[Values, np.ndarray]:
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
