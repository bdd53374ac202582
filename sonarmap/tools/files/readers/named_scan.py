"""Which scan a cell of a table means: by its name, or by its number as in pairs.csv."""

from collections.abc import Sequence

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.navigation.match import find_scan


def named_scan(scans: Sequence[Scan], cell: str, where: str) -> int:
    """The index of a scan.

    Args:
        cell: a scan's name, with or without the suffix of its file, or its number from 0 as pairs.csv has it; a name
            that is a number counts first.

    Raises InputError: no scan, or several.
    """
    index = find_scan(scans, "name", cell, float("nan"), where, allow_unknown=True)
    if index is None and cell.isascii() and cell.isdecimal() and len(cell) < 10:
        index = int(cell) if int(cell) < len(scans) else None
    if index is None:
        raise InputError(
            f"{where}: no scan is called {cell[:60]!r}; wanted a name as summary.json lists them, as "
            f"{scans[0].name!r}, or a number from 0 to {len(scans) - 1} as in pairs.csv; fix it or delete the line"
        )
    return index
