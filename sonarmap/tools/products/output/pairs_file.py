"""`pairs.csv`: every pair that was tried, what was measured, and what became of it, for spreadsheets and scripts."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.tangent import worst_sigmas
from sonarmap.slam.pair import Pair
from sonarmap.spectral.result import Registration
from sonarmap.tools.files.map_folder.pairs import ANSWERS, POSE_COLUMNS
from sonarmap.tools.files.writers.table import write_table

COLUMNS = (
    *("target", "source", "role", "kept", "accepted", "reason", "predicted_overlap", "overlap", "alike", "agreeing"),
    *("sigmas_from_estimate", "residual_sigmas", *POSE_COLUMNS, "probability", "psr"),
    *("rotation_sigma_deg", "translation_sigma_m", "alternatives"),
)
_WORDS = {answer: word for word, answer in ANSWERS.items()}


def write_pairs(path: Path, pairs: Sequence[Pair]) -> None:
    """Write one row per pair, in the order of trying, under COLUMNS; a cell of what is not known is empty.

    Numbers are written so that reading them gives the same ones.

    Raises InputError: the file cannot be written."""
    measured = iter(_measured([registration for pair in pairs if (registration := registration_of(pair))]))
    rows = (pair_row(pair) | (next(measured) if registration_of(pair) else {}) for pair in pairs)
    write_table(path, COLUMNS, ([_cell(row.get(name, "")) for name in COLUMNS] for row in rows))


def registration_of(pair: Pair) -> Registration | None:
    """What a pair contributed to the graph, which may be an alternative; what was registered where it was not kept."""
    return pair.edge.registration if pair.edge else pair.registration


def pair_row(pair: Pair) -> dict[str, Any]:
    """What became of a pair and, unless it failed, what speaks for its registration."""
    own = ("role", "kept", "reason", "predicted_overlap", "alike", "agreeing", "sigmas_from_estimate")
    row = {"target": pair.i, "source": pair.j, **fields_of(pair, *own), "residual_sigmas": pair.residual}
    registration = registration_of(pair)
    if registration is None:
        return row
    measured = fields_of(registration, "accepted", "overlap", "probability", "psr")
    return row | measured | {"alternatives": len(registration.alternatives)}


def fields_of(value: Any, *names: str) -> dict[str, Any]:
    """Some attributes of a value, by their names."""
    return {name: getattr(value, name) for name in names}


def _measured(registrations: Sequence[Registration]) -> list[dict[str, float]]:
    """The transforms, and their standard deviations along the worst directions, of all at once."""
    if not registrations:
        return []
    T = RigidTransform.concatenate([registration.T_target_source for registration in registrations])
    roll_pitch_yaw = T.rotation.as_euler("ZYX", degrees=True)[:, ::-1]
    rotation, translation = _sigmas(np.stack([registration.covariance for registration in registrations]))
    names = (*POSE_COLUMNS, "rotation_sigma_deg", "translation_sigma_m")
    rows = np.column_stack([T.translation, roll_pitch_yaw, np.degrees(rotation), translation]).tolist()
    return [dict(zip(names, row, strict=True)) for row in rows]


def _sigmas(covariances: np.ndarray) -> np.ndarray:
    """(2, N) of rotations [rad] and translations [m]; NaN where a failed pair's covariance (N, 6, 6) is none."""
    sigmas = np.full((2, len(covariances)), np.nan)
    finite = np.isfinite(covariances).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):  # the root of a negative variance is NaN
        sigmas[:, finite] = worst_sigmas(covariances[finite])
    return sigmas


def _cell(value: Any) -> Any:
    """A value as it is written: nothing where a number is not known."""
    if isinstance(value, bool | np.bool_):
        return _WORDS[bool(value)]
    return value if isinstance(value, str) or math.isfinite(value) else ""
