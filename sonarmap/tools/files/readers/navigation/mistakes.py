"""Mistakes that files of navigation have, as hypotheses: each changes what was measured so that it is right again.

The one that agrees with the scans where the given navigation does not is named. Mistakes of all scans are among them:
mirrored scans agree with navigation whose roll, heading and East have the other sign.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import values_of

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
    _COLUMNS: {
        "roll_deg and pitch_deg exchanged": _exchanged(0, 1),
        "East and North exchanged": _exchanged(3, 4),
    },
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
