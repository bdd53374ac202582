"""Pose priors of scans from navigation files.

Rows of a file are assigned to scans by name or stamp, or interpolated to their stamps. docs/navigation.md describes the
files; `tools.files.readers.navigation.overview` recognizes their kind.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.instruments import COLUMNS, prior_of, sigmas_of, values_of
from sonarmap.tools.files.readers.navigation.columns import some
from sonarmap.tools.files.readers.navigation.faults import fault_notes, usable_rows
from sonarmap.tools.files.readers.navigation.log import SAME_STAMP, NavigationLog, at_scans, find_scan
from sonarmap.tools.files.readers.navigation.overview import read_navigation
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings, by_the_maps_north, grid_of
from sonarmap.tools.files.readers.navigation.why_apart import why_apart


@dataclass(frozen=True, slots=True)
class Navigated:
    """Scans with their priors.

    Attributes:
        scans: the given scans, with priors where a file has measurements.
        georeference: of the world's origin; None if neither the files nor the user give it.
        faults: which rows cannot be right and were left out, one sentence each.
    """

    scans: tuple[Scan, ...]
    georeference: Georeference | None
    faults: tuple[str, ...] = ()

    def __repr__(self) -> str:
        priors = [scan.prior for scan in self.scans if scan.prior is not None]
        names = ("attitude", "heading", "depth", "position")
        known = {name: sum(getattr(prior, f"knows_{name}") for prior in priors) for name in names}
        counts = ", ".join(f"{name} of {count}" for name, count in known.items() if count)
        return f"<Navigated {counted(len(self.scans), 'scan')}: {counts or 'nothing measured'}>"


def navigate(
    scans: Sequence[Scan],
    paths: Path | Sequence[Path],
    settings: NavigationSettings = AS_IT_SAYS,
    allow_unknown: bool = False,
    notes: list[str] | None = None,
) -> Navigated:
    """Scans with priors from one or several navigation files; a scan without measurements has none.

    Args:
        paths: the files. They may measure different quantities, or different scans.
        allow_unknown: whether rows of other scans are ignored; else they are refused.
    """
    notes, faults = [] if notes is None else notes, list[str]()
    paths = [paths] if isinstance(paths, Path) else paths
    if len(paths) > 1:
        scans = [replace(scan, prior=None) for scan in scans]
    of_files: list[list[PosePrior | None]] = []
    origin, on_earth = settings.origin, list[Path]()
    for path in paths:
        own = replace(settings, origin=origin, are_shared=settings.are_shared or len(paths) > 1)
        of_file, here = _of_scans(scans, path, own, allow_unknown, notes, faults)
        of_files.append(of_file)
        origin, on_earth = here or origin, on_earth + [path] * (here is not None)
    priors = _merged(scans, paths, of_files)
    grid = grid_of(settings, origin) if settings.heading_reference == "grid" else None
    for path, of_file in zip(paths, of_files, strict=True) if on_earth and settings.origin is None else ():
        if path not in on_earth and any(prior is not None and prior.knows_position for prior in of_file):
            raise InputError(f"{on_earth[0]} has positions on the Earth, {path} has not; give --origin LAT,LON")
    if origin is not None and (grid is not None or on_earth):
        priors = by_the_maps_north(priors, origin, grid)
    if settings.mount is not None:
        priors = [prior and settings.mount.of_sensor(prior) for prior in priors]
    if settings.correction is not None:
        priors = [prior and settings.correction.of_prior(prior) for prior in priors]
    placed = tuple(replace(scan, prior=prior) for scan, prior in zip(scans, priors, strict=True))
    notes += faults
    return Navigated(placed, origin, tuple(faults))


def _of_scans(
    scans: Sequence[Scan],
    path: Path,
    settings: NavigationSettings,
    allow_unknown: bool,
    notes: list[str],
    faults: list[str],
) -> tuple[list[PosePrior | None], Georeference | None]:
    """Priors of the scans from one file, for the vehicle if the sonar's mount is given; and the georeference of the
    origin of x and y, None if unknown."""
    stamps = np.array([scan.stamp for scan in scans], np.float64)
    log = read_navigation(path, settings, settings.sigmas, stamps, notes)
    defaults = [settings.sigmas.get(column, np.nan) for column in COLUMNS]
    sigmas = np.where(np.isnan(log.sigmas), defaults, log.sigmas)
    log = replace(log, sigmas=sigmas, times=log.times + settings.offset)
    log, wrong = usable_rows(log, settings.fastest, stamps)
    faults += [f"{path}: {note}" for note in fault_notes(wrong)]
    if log.key == "stamp" and _is_series(stamps, log):
        priors = _from_series(path, log, stamps, notes)
    else:
        priors = _from_rows(scans, path, log, allow_unknown)
    return priors, log.georeference


def _merged(
    scans: Sequence[Scan], paths: Sequence[Path], of_files: Sequence[Sequence[PosePrior | None]]
) -> list[PosePrior | None]:
    """Combine the files' priors; refuse a value that two files give."""
    if len(of_files) == 1:
        return list(of_files[0])
    values, sigmas = np.full((2, len(paths), len(scans), 6), np.nan)
    for f, priors in enumerate(of_files):
        for k, prior in enumerate(priors):
            if prior is not None:
                known = np.isfinite(prior.sigmas)
                values[f, k, known] = values_of(prior.T_world_sensor)[known]
                sigmas[f, k, known] = sigmas_of(prior)[known]
    for k, column in np.argwhere(np.isfinite(values).sum(axis=0) > 1).tolist():
        one, other = (paths[f] for f in np.flatnonzero(np.isfinite(values[:, k, column]))[:2])
        raise InputError(f"{one} and {other} both give {COLUMNS[column]} of {scans[k].name}; delete one")
    together = zip(np.fmax.reduce(values), np.fmax.reduce(sigmas), strict=True)
    return [prior_of(*row) if np.isfinite(row[0]).any() else None for row in together]


def _from_rows(scans: Sequence[Scan], path: Path, log: NavigationLog, allow_unknown: bool) -> list[PosePrior | None]:
    """Priors from rows that each belong to one scan."""
    lines: dict[int, int] = {}  # {scan: line of its row}
    priors = [scan.prior for scan in scans]
    for row, line in enumerate(log.lines.tolist()):
        time, where = float(log.times[row]), f"{path}: line {line}"
        index = find_scan(scans, log.key, log.keys[row], time, where, allow_unknown)
        if index is None:
            continue
        if index in lines:
            raise InputError(f"{path}: lines {lines[index]} and {line} are both for {scans[index].name}; delete one")
        lines[index] = line
        priors[index] = prior_of(log.values[row], log.sigmas[row]) if log.measured[row] else None
    if not lines:
        raise InputError(f"{path}: no row belongs to any of the scans, which are {some([scan.name for scan in scans])}")
    return priors


def _is_series(stamps: np.ndarray, log: NavigationLog) -> bool:
    """Whether rows are a log at its own times, and not one per scan: some are before or after all scans, they outnumber
    the scans and some are at no scan's time, or more than half are at no scan's time."""
    sorted_stamps = np.sort(stamps)
    after = np.clip(np.searchsorted(sorted_stamps, log.times), 0, len(stamps) - 1)
    nearest = np.minimum(
        np.abs(sorted_stamps[after] - log.times), np.abs(sorted_stamps[np.maximum(after - 1, 0)] - log.times)
    )
    of_no_scan = int((nearest > SAME_STAMP).sum())
    more = of_no_scan > 0 and len(log.times) > len(stamps)
    beyond = (log.times < stamps.min() - SAME_STAMP) | (log.times > stamps.max() + SAME_STAMP)
    return bool(beyond.any()) or more or of_no_scan > len(log.times) / 2


def _from_series(path: Path, log: NavigationLog, stamps: np.ndarray, notes: list[str]) -> list[PosePrior | None]:
    """Priors from rows at their own times."""
    rows = log.measured
    values, sigmas = at_scans(stamps, log.times[rows], log.values[rows], log.sigmas[rows])
    measured = np.any(np.isfinite(values), axis=1)
    if not measured.any():
        raise InputError(f"{path}: no row is at the time of a scan, or near it: {why_apart(log.times, stamps)}")
    notes.append(f"{path} has times of its own; it was interpolated to those of the scans")
    return [prior_of(values[k], sigmas[k]) if measured[k] else None for k in range(len(stamps))]
