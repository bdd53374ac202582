"""Priors of scans from a CSV file: `name,roll_deg,roll_sigma_deg,...`, one row per scan.

The first row names the columns, in any order: `name` (of the scan's file, with its suffix or without) or `stamp` [s],
then what was measured and its standard deviation (see `tools.readers.instruments`). An empty cell was not measured.
Lines that begin with # are comments. Commas, semicolons or tabs separate the cells (`tools.readers.csv_table`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from kernels.errors import InputError
from spectral.scan import PosePrior, Scan
from tools.readers.csv_table import read_csv_table
from tools.readers.instruments import COLUMNS, SIGMA_COLUMNS, check_measured, prior_of
from tools.readers.navigation.match import SAME_STAMP, find_scan, seconds
from tools.readers.navigation.series import at_scans

KEYS = ("name", "stamp")
ON_EARTH = ("lat", "lon", "lng")  # how columns of degrees on the Earth are called
PAIRS = (("roll_deg", "pitch_deg"), ("x_m", "y_m"))
NO_DEFAULTS: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class PriorRow:
    """One row: `line` of the file, the scan's `key` (its name, or its stamp as it is written), and its prior."""

    line: int
    key: str
    prior: PosePrior | None


def with_priors(
    scans: Sequence[Scan],
    path: Path,
    sigmas: Mapping[str, float] = NO_DEFAULTS,
    allow_unknown: bool = False,
    notes: list[str] | None = None,
) -> tuple[Scan, ...]:
    """The scans with their priors from the file; a scan without a row, or with an empty one, has none.

    Args:
        scans: as the readers name and stamp them.
        path: of the CSV file.
        sigmas: {column of COLUMNS: standard deviation in its unit}, used where the file has none.
        allow_unknown: whether rows may belong to scans that are not among these.
        notes: what a user should know of the file is added to it.

    Raises:
        InputError: naming the file and the line: a column or cell that cannot be used, two rows for one scan, a row
            that fits no scan or several, or not one that fits any.
    """
    key, rows = read_prior_rows(path, sigmas, notes)
    if key == "stamp" and _is_series(scans, rows):
        return _from_series(scans, path, rows, notes)
    lines: dict[int, int] = {}  # of each scan, in the file
    changed = list(scans)
    for row in rows:
        index = find_scan(scans, key, row.key, f"{path}: line {row.line}", allow_unknown)
        if index is None:
            continue
        if index in lines:
            raise InputError(
                f"{path}: lines {lines[index]} and {row.line} are both for the scan {scans[index].name}; delete one"
            )
        lines[index] = row.line
        changed[index] = replace(scans[index], prior=row.prior)
    if not lines:
        raise InputError(
            f"{path}: no row belongs to any of the scans, which are {_some([scan.name for scan in scans])}"
        )
    return tuple(changed)


def _is_series(scans: Sequence[Scan], rows: Sequence[PriorRow]) -> bool:
    """Whether rows have times of their own: some that are no scan's, of more than half of the rows."""
    stamps = np.array([scan.stamp for scan in scans])
    times = np.array([seconds(row.key) for row in rows])
    if not np.isfinite(times).all():
        return False  # told row by row
    lone = [np.abs(stamps - time).min() > SAME_STAMP for time in times.tolist()]
    return sum(lone) > len(rows) / 2


def _from_series(
    scans: Sequence[Scan], path: Path, rows: Sequence[PriorRow], notes: list[str] | None
) -> tuple[Scan, ...]:
    told = [(seconds(row.key), row.prior) for row in rows if row.prior is not None]
    times = np.array([time for time, _ in told])
    priors = at_scans(scans, times, [prior for _, prior in told])
    if all(prior is None for prior in priors):
        stamps = [scan.stamp for scan in scans]
        raise InputError(
            f"{path}: no row is at the time of a scan, or near it: the rows run from {times.min():.3f} to "
            f"{times.max():.3f} s, the scans from {min(stamps):.3f} to {max(stamps):.3f} s; wanted stamps of one clock"
        )
    if notes is not None:
        notes.append(f"{path} has times of its own; it was interpolated to those of the scans")
    return tuple(replace(scan, prior=prior) for scan, prior in zip(scans, priors, strict=True))


def read_prior_rows(
    path: Path, sigmas: Mapping[str, float] = NO_DEFAULTS, notes: list[str] | None = None
) -> tuple[str, list[PriorRow]]:
    """The column that identifies the scans, "name" or "stamp", and every row; arguments as those of `with_priors`.

    Raises:
        InputError: a column or cell that cannot be used.
    """
    table = read_csv_table(path)
    header = table.heading.cells
    try:
        _check_header(header, sigmas)
    except InputError as error:
        raise InputError(f"{path}: line {table.heading.line}: {error}") from error
    table.require_even(path)
    if not table.rows:
        raise InputError(f"{path} has no row below its heading; wanted one per scan")
    rows = []
    for row in table.rows:
        try:
            rows.append(_row(row.line, header, row.cells, sigmas))
        except InputError as error:
            raise InputError(f"{path}: line {row.line}: {error}; fix that line") from error
    if notes is not None:
        notes += table.notes
    return next(key for key in KEYS if key in header), rows


def _check_header(header: list[str], sigmas: Mapping[str, float]) -> None:
    known = (*KEYS, *COLUMNS, *SIGMA_COLUMNS)
    if on_earth := [name for name in header if name.lower().startswith(ON_EARTH)]:
        raise InputError(
            f"the columns {_some(on_earth)} are places on the Earth, which are not read; give East and North in meters "
            "from any origin as x_m and y_m"
        )
    if unknown := [name for name in header if name not in known]:
        raise InputError(
            f"unknown column {_some(unknown)}; known are {', '.join(known)}, separated by commas, semicolons or tabs"
        )
    if twice := [name for name in known if header.count(name) > 1]:
        raise InputError(f"the column {twice[0]} is there {header.count(twice[0])} times; delete all but one")
    if sum(key in header for key in KEYS) != 1:
        raise InputError("wanted either a column name or a column stamp, which says which scan a row is for")
    if not any(column in header for column in COLUMNS):
        raise InputError(f"there is no column of measurements; wanted one or more of {', '.join(COLUMNS)}")
    for first, second in PAIRS:
        if (first in header) != (second in header):
            raise InputError(f"{first} and {second} can only be used together; give both or neither")
    for column, sigma in zip(COLUMNS, SIGMA_COLUMNS, strict=True):
        if sigma in header and column not in header:
            raise InputError(f"there is a column {sigma} but no {column}; delete it, or add {column}")
        if column in header and sigma not in header and column not in sigmas:
            raise InputError(f"{column} has no standard deviation; add a column {sigma}, or give --prior-sigmas")


def _row(number: int, header: list[str], cells: list[str], sigmas: Mapping[str, float]) -> PriorRow:
    row = dict(zip(header, cells, strict=True))
    key = next(row[key] for key in KEYS if key in header)
    if not key:
        raise InputError(f"its {'name' if 'name' in row else 'stamp'} is empty")
    values = np.array([_number(column, row.get(column, "")) for column in COLUMNS])
    deviations = np.array([_number(sigma, row.get(sigma, "")) for sigma in SIGMA_COLUMNS])
    deviations = np.where(np.isnan(deviations), [sigmas.get(column, np.nan) for column in COLUMNS], deviations)
    measured = np.isfinite(values)
    for column, sigma, needed, deviation in zip(COLUMNS, SIGMA_COLUMNS, measured, deviations, strict=True):
        if needed and np.isnan(deviation):
            raise InputError(f"{column} has no standard deviation; fill in {sigma}, or give --prior-sigmas")
    for first, second in PAIRS:
        if measured[COLUMNS.index(first)] != measured[COLUMNS.index(second)]:
            raise InputError(f"{first} and {second} can only be used together, and one is empty")
    return PriorRow(number, key, prior_of(values, deviations) if measured.any() else None)


def _number(column: str, cell: str) -> float:
    """The number in a cell, NaN where it is empty."""
    if not cell:
        return np.nan
    try:
        number = float(cell) if "_" not in cell else np.nan
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise InputError(
            f"{column} is {cell[:40]!r}; wanted a finite number, or an empty cell for what was not measured"
        )
    check_measured(column, number)
    return number


def _some(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in names[:3]) + (", ..." if len(names) > 3 else "")
