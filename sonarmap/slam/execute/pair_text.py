"""A pair's registration as text without loss, for other processes and for the journal.

It is text because pickling a RigidTransform changes its last bits.
"""

import json
from sys import intern
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.result import Registration


def to_text(registration: Registration | None, failure: str = "") -> str:
    """A registration, or why there is none, as JSON with Python's NaN and Infinity; floats keep all bits."""
    if registration is None:
        return json.dumps({"failure": failure})
    return json.dumps({"registration": _to_json(registration)})


def from_text(text: str) -> tuple[Registration | None, str]:
    """The registration and the failure that `to_text` was given; numbers as Python's own, arrays as float64."""
    content = json.loads(text)
    if "failure" in content:
        return None, content["failure"]
    return _from_json(content["registration"]), ""


def signature_to_text(signature: np.ndarray | None) -> str:
    """A scan's signature, (K,) float32, as JSON; null where the scan has none."""
    return json.dumps(None if signature is None else signature.tolist())


def signature_from_text(text: str) -> np.ndarray | None:
    """The signature that `signature_to_text` was given, bit by bit."""
    content = json.loads(text)
    return None if content is None else np.array(content, np.float32)


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
    parts: dict[str, Any] = {
        # normalizing would change its last bits
        "T_target_source": RigidTransform(np.array(content["T_target_source"], np.float64), normalize=False),
        "covariance": np.array(content["covariance"], np.float64),
    }
    for name in ("step_psr", "evidence"):  # registrations share the names in them
        parts[name] = tuple((intern(key), value) for key, value in content[name])
    parts["alternatives"] = tuple(_from_json(alternative) for alternative in content["alternatives"])
    return Registration(**content | parts)
