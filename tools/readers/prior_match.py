"""Which scan a row of a CSV file of priors is of."""

import re
from collections.abc import Sequence

from kernels.errors import InputError
from spectral.scan import Scan
from tools.readers.file import FORMATS

SAME_STAMP = 1e-3  # seconds: files carry stamps with other numbers of digits

_SUFFIX = re.compile(rf"(.+)({'|'.join(map(re.escape, FORMATS))})(#\d+)?", re.IGNORECASE | re.DOTALL)


def find_scan(scans: Sequence[Scan], by: str, key: str, where: str, strangers: bool) -> int | None:
    """The index of the scan that a row's name or stamp means; None where it is a stranger's, if these may be.

    Args:
        scans: as the readers name and stamp them.
        by: "name" (with the suffix of a scan's file or without, as `recording.sonar#3`) or "stamp" [s].
        key: as the row has it.
        where: the file and line, for messages.
        strangers: whether a row may be of no scan.

    Raises:
        InputError: a stamp that is no number, a row that fits several scans, or none.
    """
    found = _by_name(scans, key) if by == "name" else _by_stamp(scans, key, where)
    if len(found) > 1:
        both = " and ".join(scans[index].name for index in found[:2])
        raise InputError(
            f"{where}: the {by} {key!r} fits {len(found)} scans, among them {both}; call their files differently, and "
            "tell them apart by name"
        )
    if not found and not strangers:
        raise InputError(
            f"{where}: no scan has the {by} {key!r}; the first is called {scans[0].name!r} and has the stamp "
            f"{scans[0].stamp!r}. Mend the {by} or drop the line"
        )
    return found[0] if found else None


def _by_name(scans: Sequence[Scan], name: str) -> list[int]:
    exact = [index for index, scan in enumerate(scans) if scan.name == name]
    match = _SUFFIX.fullmatch(name)
    if exact or not match:
        return exact
    bare = match[1] + (match[3] or "")
    return [index for index, scan in enumerate(scans) if scan.name == bare]


def _by_stamp(scans: Sequence[Scan], text: str, where: str) -> list[int]:
    try:
        stamp = float(text) if "_" not in text else float("nan")
    except ValueError:
        stamp = float("nan")
    if not abs(stamp) < float("inf"):
        raise InputError(f"{where}: the stamp is {text[:40]!r}; wanted finite seconds. Mend that line")
    return [index for index, scan in enumerate(scans) if abs(scan.stamp - stamp) <= SAME_STAMP]
