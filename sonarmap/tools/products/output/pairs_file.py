"""Outcome of pairs, ties and control points: `pairs.csv` with every tried pair, and rows of summary.json."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.decide.verdict import CONTRADICTED
from sonarmap.slam.graph.control import MeasuredControl
from sonarmap.slam.graph.tangent import worst_sigmas
from sonarmap.slam.pair import Pair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registration
from sonarmap.tools.files.map_folder.names import ANSWERS, POSE_COLUMNS
from sonarmap.tools.files.readers.constraints import POSE, SIGMAS
from sonarmap.tools.files.writers.tables import write_table

COLUMNS = (
    *("target", "source", "role", "kept", "accepted", "reason", "predicted_overlap", "overlap", "alike", "agreeing"),
    *("sigmas_from_estimate", "residual_sigmas", *POSE_COLUMNS, "probability", "psr"),
    *("rotation_sigma_deg", "translation_sigma_m", "alternatives"),
)
_WORDS = {answer: word for word, answer in ANSWERS.items()}


def write_pairs(path: Path, pairs: Sequence[Pair]) -> None:
    """Write one row of COLUMNS per pair, in the order they were tried, at full precision; unknown values are empty."""
    measured = iter(_measured([registration for pair in pairs if (registration := registration_of(pair))]))
    rows = (pair_row(pair) | (next(measured) if registration_of(pair) else {}) for pair in pairs)
    write_table(path, COLUMNS, ([_cell(row.get(name, "")) for name in COLUMNS] for row in rows))


def registration_of(pair: Pair) -> Registration | None:
    """The registration in the graph, which may be an alternative; for a pair that was not kept, the best one."""
    return pair.edge.registration if pair.edge else pair.registration


def pair_row(pair: Pair) -> dict[str, Any]:
    """Row of a pair: its outcome and, unless it failed, the evidence for its registration."""
    own = ("role", "kept", "reason", "predicted_overlap", "alike", "agreeing", "sigmas_from_estimate")
    row = {"target": pair.i, "source": pair.j, **fields_of(pair, *own), "residual_sigmas": pair.residual}
    registration = registration_of(pair)
    if registration is None:
        return row
    measured = fields_of(registration, "accepted", "overlap", "probability", "psr")
    return row | measured | {"alternatives": len(registration.alternatives)}


def fields_of(value: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names}


def _measured(registrations: Sequence[Registration]) -> list[dict[str, float]]:
    """Rows with the transforms and their standard deviations along the worst directions, computed together."""
    if not registrations:
        return []
    T = RigidTransform.concatenate([registration.T_target_source for registration in registrations])
    roll_pitch_yaw = T.rotation.as_euler("ZYX", degrees=True)[:, ::-1]
    rotation, translation = _sigmas(np.stack([registration.covariance for registration in registrations]))
    names = (*POSE_COLUMNS, "rotation_sigma_deg", "translation_sigma_m")
    rows = np.column_stack([T.translation, roll_pitch_yaw, np.degrees(rotation), translation]).tolist()
    return [dict(zip(names, row, strict=True)) for row in rows]


def _sigmas(covariances: np.ndarray) -> np.ndarray:
    """(2, N) sigmas of rotation [rad] and translation [m]; NaN where a covariance (N, 6, 6) is not finite."""
    sigmas = np.full((2, len(covariances)), np.nan)
    finite = np.isfinite(covariances).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):  # the root of a negative variance is NaN
        sigmas[:, finite] = worst_sigmas(covariances[finite])
    return sigmas


def _cell(value: Any) -> Any:
    """A value as written in the table; empty for an unknown number."""
    if isinstance(value, bool | np.bool_):
        return _WORDS[bool(value)]
    return value if isinstance(value, str) or math.isfinite(value) else ""


def tie_rows(result: SurveyResult, names: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of summary.json for ties, with their effects; `names` are those of all scans."""
    return [
        {"target": names[tie.i], "source": names[tie.j], "verdict": tie.verdict, "note": tie.note}
        | {"effect": tie_effect(result, tie)}
        | ({} if tie.given is None else _transform_row(tie.given))
        for tie in result.ties
    ]


def _transform_row(given: Registration) -> dict[str, float]:
    """A transform and its sigmas under the columns of a ties file [m, deg]; sigmas are the RMS over the directions."""
    turn, shift = np.sqrt(np.diag(given.covariance).reshape(2, 3).mean(axis=1)).tolist()
    angles = given.T_target_source.rotation.as_euler("ZYX", degrees=True)[::-1]
    values = [*given.T_target_source.translation.tolist(), *angles.tolist(), shift, float(np.degrees(turn))]
    return dict(zip((*POSE, *SIGMAS), values, strict=True))


def tie_effect(result: SurveyResult, tie: Tie) -> str:
    """The outcome of a tie in words."""
    pair = next((pair for pair in result.pairs if pair.scans == tie.scans), None)
    if pair is None:
        if tie.verdict == "reject":
            return "was not tried, so there is nothing to reject"
        return "was not tried, so there is no registration to accept; use the verdict add to register it"
    if tie.verdict == "reject":
        return "rejected by hand: left out of the graph"
    if not pair.kept or pair.edge is None:
        return f"not in the graph: {pair.reason}"
    words = pair.reason
    if tie.given is None and not pair.edge.registration.accepted:
        words += f"; the registration itself was not accepted ({pair.edge.registration.probability:.0%})"
    if is_contradicted(result, tie):
        words += (
            f"; the rest of the survey contradicts it: chi-squared {pair.contradicted:.4g}, where at most "
            f"{CONTRADICTED:.1f} is usual"
        )
    return words


def is_contradicted(result: SurveyResult, tie: Tie) -> bool:
    """Whether the rest of the survey contradicts a tie that is in the graph."""
    return any(pair.scans == tie.scans and pair.contradicted > CONTRADICTED for pair in result.pairs)


def has_no_effect(result: SurveyResult, tie: Tie) -> bool:
    """Whether a tie that should be in the graph is not."""
    return tie.verdict != "reject" and not any(pair.scans == tie.scans and pair.kept for pair in result.pairs)


def control_rows(result: SurveyResult, names: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of summary.json for control and check points, with residuals; `names` are those of all scans."""
    return [
        {"name": each.point.name, "scan": names[each.point.scan], **fields_of(each.point, "point", "known")}
        | {**fields_of(each, "estimated", "residual"), "sigma": each.point.sigmas, "use": each.point.use}
        | {"in_sigmas": each.in_sigmas}
        for each in result.control
    ]


def control_fit(result: SurveyResult, names: Sequence[str]) -> dict[str, Any] | None:
    """Fit of the map to its control and check points, and the points that were left out; None without points.

    Only points of parts that lie in the world, and that were not left out, count in the fit."""
    if not result.control:
        return None
    used = [each for each in result.control if each.in_world and not each.left_out]
    return {
        **{use: _fit([each for each in used if each.point.use == use]) for use in ("control", "check")},
        "left_out": [
            {"name": each.point.name, "scan": names[each.point.scan], "sigmas": each.wrong}
            for each in result.control
            if each.left_out
        ],
    }


def _fit(points: Sequence[MeasuredControl]) -> dict[str, Any]:
    lengths = np.array([np.linalg.norm(each.residual) for each in points])
    squares = [each.residual @ each.residual for each in points]
    rms, largest = (float(np.sqrt(np.mean(squares))), float(lengths.max())) if points else (None, None)
    return {"points": len(points), "rms_m": rms, "largest_m": largest}
