"""A file of ties: what a person says of pairs of scans."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import propagated
from sonarmap.slam.tie import VERDICTS, Tie, Verdict
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.csv_table import CsvTable, read_csv_table
from sonarmap.tools.files.readers.navigation.log import named_scan
from sonarmap.tools.files.readers.navigation.rows import number_within, refuse

NAMES = ("target", "source", "verdict")
POSE = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")
SIGMAS = ("sigma_m", "sigma_deg")
NOTE = "note"
TRANSFORM = (*POSE, *SIGMAS)
COLUMNS = (*NAMES, *TRANSFORM, NOTE)
_VERDICTS: dict[str, Verdict] = {verdict: verdict for verdict in VERDICTS}
# Nobody measures better, and the equations want no better; nor is a pair of scans farther apart [m, deg].
_LEAST = {"sigma_m": 1e-4, "sigma_deg": 1e-3}
_LARGEST = {"sigma_m": 1e4, "sigma_deg": 180.0} | dict.fromkeys(POSE[:3], 1e5) | dict.fromkeys(POSE[3:], 360.0)


def read_ties(path: Path, scans: Sequence[Scan]) -> tuple[Tie, ...]:
    """The ties of a CSV file with the columns target, source and verdict; for pairs with a transform POSE and SIGMAS.

    A transform is T_target_source (angles as docs/conventions.md has them), its standard deviation the same along and
    about all axes. Lines that begin with # are comments. Ties are in the file's order, the scans of each in theirs: a
    transform of a later scan to an earlier is turned around.

    Raises InputError: naming the file and the line: a column or cell that cannot be used, or two verdicts on a pair.
    """
    table = read_csv_table(path)
    columns = _columns(table)
    table.require_even()
    ties: list[Tie] = []
    lines: dict[tuple[int, int], int] = {}
    for row in table.rows:
        tie = _tie({name: row.cells[k] for name, k in columns.items()}, scans, table.where(row))
        if tie.scans in lines:
            raise InputError(
                f"{path}: lines {lines[tie.scans]} and {row.line} both have a verdict on {scans[tie.i].name} and "
                f"{scans[tie.j].name}; delete one"
            )
        lines[tie.scans] = row.line
        ties.append(tie)
    return tuple(ties)


def _columns(table: CsvTable) -> dict[str, int]:
    words = f"{', '.join(NAMES)}, and if need be {', '.join(COLUMNS[3:])}"
    columns = table.declared_columns(COLUMNS, NAMES, words, f"wanted {', '.join(NAMES)}; ")
    transform = [name for name in TRANSFORM if name in columns]
    missing = [name for name in TRANSFORM if name not in columns]
    if transform and missing:
        raise InputError(
            f"{table.where()}: a transform wants a column {missing[0]} too; add it, or delete {transform[0]}"
        )
    return columns


def _tie(cells: Mapping[str, str], scans: Sequence[Scan], where: str) -> Tie:
    target, source = (named_scan(scans, cells[name], f"{where}: {name}") for name in NAMES[:2])
    if target == source:
        raise InputError(f"{where}: it ties {scans[target].name} to itself; wanted two scans; fix that line")
    verdict = _VERDICTS.get(cells["verdict"].lower())
    if verdict is None:
        raise refuse(where, "verdict", cells["verdict"], f"one of {', '.join(VERDICTS)}")
    given = _transform(cells, where)
    if given is None:
        return Tie(min(target, source), max(target, source), verdict, note=cells.get(NOTE, ""))
    if verdict != "add":
        raise InputError(
            f"{where}: the verdict is {verdict}, and there is a transform; only add takes one. Empty its cells, or "
            "write add; fix that line"
        )
    # T_true = T Exp(xi) has the inverse T^-1 Exp(-Ad(T) xi)
    T_i_j, covariance = (given[0].inv(), propagated(*given)) if target > source else given
    measured = Registration(T_i_j, covariance, np.nan, np.nan, True, 0.0, "measured by hand")
    return Tie(min(target, source), max(target, source), verdict, measured, cells.get(NOTE, ""))


def _transform(cells: Mapping[str, str], where: str) -> tuple[RigidTransform, np.ndarray] | None:
    """T_target_source and its (6, 6) covariance, rotation first [rad, m]; None where all cells are empty."""
    if not any(cells.get(name) for name in TRANSFORM):
        return None
    values: dict[str, float] = {}
    for name in TRANSFORM:
        bounds = _LEAST.get(name, -_LARGEST[name]), _LARGEST[name]
        wanted = f"a number from {bounds[0]:g} to {bounds[1]:g}, as the pair has a transform"
        values[name] = number_within(where, name, cells[name], bounds, wanted)
    R = Rotation.from_euler("ZYX", [values[name] for name in reversed(POSE[3:])], degrees=True)
    T = RigidTransform.from_components([values[name] for name in POSE[:3]], R)
    sigmas = np.repeat([np.radians(values["sigma_deg"]), values["sigma_m"]], 3)
    return T, np.diag(sigmas**2)
