"""Priors of scans as a CSV file, in the columns of `tools.files.readers.instruments`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import COLUMNS, SIGMA_COLUMNS, sigmas_of, values_of
from sonarmap.tools.files.writers.table import write_table


def require_new(path: Path) -> None:
    """Refuse to write over a file, as what was filled in would be lost. Raises InputError: it is there already."""
    if path.exists():
        raise InputError(f"{path} is there already; remove it, or give the template another name")


def write_template(path: Path, names: Sequence[str], stamps: Sequence[float]) -> None:
    """Write one row per scan with its name and stamp [s], and all columns of measurements empty, to be filled in.
    Raises InputError: the file is there already, or it cannot be written."""
    require_new(path)
    empty = [""] * (len(COLUMNS) + len(SIGMA_COLUMNS))
    rows = ([name, f"{stamp:.6f}", *empty] for name, stamp in zip(names, stamps, strict=True))
    write_table(path, ["name", "stamp", *COLUMNS, *SIGMA_COLUMNS], rows)


def write_priors(path: Path, names: Sequence[str], priors: Sequence[PosePrior]) -> None:
    """Write one row per scan, with the columns of what any of them measured; nothing in a cell that one did not."""
    values = np.array([values_of(prior.T_world_sensor) for prior in priors])
    sigmas = np.array([sigmas_of(prior) for prior in priors])
    known = np.isfinite(sigmas)
    columns = np.flatnonzero(known.any(axis=0))
    rows: list[list[str]] = []
    for row, name in enumerate(names):
        measured = [f"{values[row, k]:z.6f}" if known[row, k] else "" for k in columns]
        deviations = [f"{sigmas[row, k]:.6g}" if known[row, k] else "" for k in columns]
        rows.append([name, *measured, *deviations])
    write_table(path, ["name", *(COLUMNS[k] for k in columns), *(SIGMA_COLUMNS[k] for k in columns)], rows)
