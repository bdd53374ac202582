"""Finds the scan that a row of a priors file belongs to."""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime

from kernels.errors import InputError
from spectral.scan import Scan
from tools.readers.file import FORMATS
from tools.readers.limits import LARGEST_STAMP

SAME_STAMP = 1e-3  # seconds: files carry stamps with other numbers of digits

_SUFFIX = re.compile(rf"(.+)({'|'.join(map(re.escape, FORMATS))})(#\d+)?", re.IGNORECASE | re.DOTALL)


def find_scan(scans: Sequence[Scan], by: str, key: str, where: str, allow_unknown: bool) -> int | None:
    """The index of the scan with a row's name or stamp; None if there is none and `allow_unknown`.

    Args:
        scans: as the readers name and stamp them.
        by: "name" (with or without the suffix of the scan's file, as `recording.sonar#3`) or "stamp" [s].
        key: the name or stamp as it stands in the row.
        where: the file and line, for messages.
        allow_unknown: whether a row may belong to none of the scans.

    Raises:
        InputError: a stamp that is not a number, or a row that fits several scans or none.
    """
    indices = _by_name(scans, key) if by == "name" else _by_stamp(scans, key, where)
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


def _by_name(scans: Sequence[Scan], name: str) -> list[int]:
    exact = [index for index, scan in enumerate(scans) if scan.name == name]
    match = _SUFFIX.fullmatch(name)
    if exact or not match:
        return exact
    bare = match[1] + (match[3] or "")
    return [index for index, scan in enumerate(scans) if scan.name == bare]


def _by_stamp(scans: Sequence[Scan], text: str, where: str) -> list[int]:
    stamp = seconds(text)
    if math.isnan(stamp):
        raise InputError(
            f"{where}: the stamp is {text[:40]!r}; wanted finite seconds, or a time as 2026-07-01T09:30:00Z; fix that "
            "line"
        )
    return [index for index, scan in enumerate(scans) if abs(scan.stamp - stamp) <= SAME_STAMP]


def seconds(text: str) -> float:
    """Seconds, or the Unix time of an ISO 8601 time, UTC where it names no zone; NaN for anything else."""
    try:
        number = float(text) if "_" not in text else float("nan")
        return number if abs(number) <= LARGEST_STAMP else float("nan")
    except ValueError:
        pass
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return float("nan")
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
