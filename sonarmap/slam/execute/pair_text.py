"""The result of registering a pair as text, bit by bit: the form in which it leaves a process and lies in a journal.

Text, as pickling a RigidTransform changes its last bits.
"""

import json
from sys import intern
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.result import Registration

_ROUNDED = 1e-3  # what rounding may do to R R^T, and to a covariance's symmetry as a share of its largest number
_NUMBERS = ("psr", "overlap", "seconds", "probability")


def to_text(registration: Registration | None, failure: str = "") -> str:
    """A registration, or why there is none, as JSON with NaN and Infinity as Python has them; floats keep all bits."""
    if registration is None:
        return json.dumps({"failure": failure})
    return json.dumps({"registration": _to_json(registration)})


def from_text(text: str) -> tuple[Registration | None, str]:
    """The registration and the failure that `to_text` was given; numbers as Python's own, arrays as float64.

    Raises:
        ValueError, LookupError, TypeError: the text is something else.
    """
    content = _parsed(text)
    if "failure" in content:
        return None, _of_type(content, "failure", str)
    return _from_json(content["registration"]), ""


def signature_to_text(signature: np.ndarray | None) -> str:
    """A scan's signature, (K,) float32, as JSON; null where the scan has none."""
    return json.dumps(None if signature is None else signature.tolist())


def signature_from_text(text: str) -> np.ndarray | None:
    """The signature that `signature_to_text` was given, bit by bit.

    Raises:
        ValueError, TypeError: the text is something else.
    """
    content = _parsed(text)
    return None if content is None else _signature(content)


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _to_json(registration: Registration) -> dict[str, Any]:
    return {
        "T_target_source": registration.T_target_source.as_matrix().tolist(),
        "covariance": np.asarray(registration.covariance, np.float64).tolist(),
        "psr": float(registration.psr),
        "overlap": float(registration.overlap),
        "accepted": bool(registration.accepted),
        "seconds": float(registration.seconds),
        "reason": registration.reason,
        "probability": float(registration.probability),
        "step_psr": [(name, float(psr)) for name, psr in registration.step_psr],
        "evidence": [(name, float(value)) for name, value in registration.evidence],
        "alternatives": [_to_json(alternative) for alternative in registration.alternatives],
    }


def _from_json(content: dict[str, Any]) -> Registration:
    for name, kind in (("accepted", bool), ("reason", str), *((name, float) for name in _NUMBERS)):
        _of_type(content, name, kind)
    return Registration(
        **content
        | {
            "T_target_source": _transform(content["T_target_source"]),
            "covariance": _covariance(content["covariance"]),
            "step_psr": _named_numbers(content, "step_psr"),
            "evidence": _named_numbers(content, "evidence"),
            "alternatives": tuple(_from_json(alternative) for alternative in content["alternatives"]),
        }
    )


def _of_type(content: dict[str, Any], name: str, kind: type) -> Any:
    if type(content[name]) is not kind:
        raise TypeError(f"{name} is {str(content[name])[:40]!r}; wanted a {kind.__name__}")
    return content[name]


def _named_numbers(content: dict[str, Any], name: str) -> tuple[tuple[str, float], ...]:
    rows = tuple((key, value) for key, value in content[name])
    if not all(isinstance(key, str) and isinstance(value, float) for key, value in rows):
        raise TypeError(f"{name} holds something else than names and numbers")
    return tuple((intern(key), value) for key, value in rows)  # of many registrations they are the same


def _transform(content: Any) -> RigidTransform:
    matrix = _array(content, "T_target_source", 4, 4)
    off = np.abs(matrix[:3, :3] @ matrix[:3, :3].T - np.eye(3)).max()
    if not (np.isfinite(matrix).all() and off <= _ROUNDED and np.array_equal(matrix[3], (0, 0, 0, 1))):
        raise ValueError("T_target_source is not a rigid transform")
    return RigidTransform(matrix, normalize=False)  # which would change its last bits


def _covariance(content: Any) -> np.ndarray:
    """(6, 6); where nothing is known of a direction, it may hold infinity or NaN."""
    covariance = _array(content, "covariance", 6, 6)
    slack = _ROUNDED * np.abs(covariance[np.isfinite(covariance)]).max(initial=0.0)
    if not np.allclose(covariance, covariance.T, rtol=0.0, atol=slack, equal_nan=True):
        raise ValueError("covariance is not symmetric")
    return covariance


def _signature(content: Any) -> np.ndarray:
    return _array(content, "signature", len(content)).astype(np.float32)


def _array(content: Any, name: str, *shape: int) -> np.ndarray:
    array = np.array(content, np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; wanted {shape}")
    return array
