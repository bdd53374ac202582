"""Finds the scan that a row of a table belongs to, by its name, its stamp, or its number as in pairs.csv."""

import re
from collections.abc import Sequence

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.csv_table import plain_text
from sonarmap.tools.files.readers.file import FORMATS

SAME_STAMP = 1e-3  # seconds: files carry stamps with other numbers of digits

_SUFFIX = re.compile(rf"(.+)({'|'.join(map(re.escape, FORMATS))})(#\d+)?", re.IGNORECASE | re.DOTALL)


def find_scan(scans: Sequence[Scan], by: str, key: str, time: float, where: str, allow_unknown: bool) -> int | None:
    """The index of the scan with a row's name or stamp; None if there is none and `allow_unknown`. `by` is "name" (with
    or without the suffix of the scan's file, as `recording.sonar#3`) or "stamp"; `key` is what the row has, `time` its
    stamp [s, UTC]. Raises InputError: a row that fits several scans or none."""
    indices = [k for k, scan in enumerate(scans) if abs(scan.stamp - time) <= SAME_STAMP]
    if by == "name":
        match = _SUFFIX.fullmatch(key)
        bare = match[1] + (match[3] or "") if match else key
        indices = _called(scans, key) or _called(scans, bare)
    if len(indices) > 1:
        both = " and ".join(scans[index].name for index in indices[:2])
        raise InputError(
            f"{where}: the {by} {key!r} fits {len(indices)} scans, among them {both}; rename their files, and use "
            "their names"
        )
    if not indices and not allow_unknown:
        raise InputError(
            f"{where}: no scan has the {by} {key!r}; the first scan is called {scans[0].name!r} and has the stamp "
            f"{scans[0].stamp!r}. Fix the {by} or delete the line"
        )
    return indices[0] if indices else None


def _called(scans: Sequence[Scan], name: str) -> list[int]:
    """The scans with a name as a table can have it, which is the scan's own but for line breaks and the like."""

    def fits(own: str) -> bool:
        return own == name or ((not own.isprintable() or own != own.strip()) and plain_text(own) == name)

    return [index for index, scan in enumerate(scans) if fits(scan.name)]


def named_scan(scans: Sequence[Scan], cell: str, where: str) -> int:
    """The index of a scan. `cell`: a scan's name, with or without the suffix of its file, or its number from 0 as
    pairs.csv has it; a name that is a number counts first. Raises InputError: no scan, or several."""
    index = find_scan(scans, "name", cell, float("nan"), where, allow_unknown=True)
    if index is None and cell.isascii() and cell.isdecimal() and len(cell) < 10:
        index = int(cell) if int(cell) < len(scans) else None
    if index is None:
        raise InputError(
            f"{where}: no scan is called {cell[:60]!r}; wanted a name as summary.json lists them, as "
            f"{scans[0].name!r}, or a number from 0 to {len(scans) - 1} as in pairs.csv; fix it or delete the line"
        )
    return index
