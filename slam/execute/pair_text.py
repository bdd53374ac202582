"""The result of registering a pair as text, bit by bit: the form in which it leaves a process and lies in a journal.

Text, as pickling a RigidTransform changes its last bits.
"""

import json
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from spectral.result import Registration


def to_text(registration: Registration | None, failure: str = "") -> str:
    """A registration, or why there is none, as JSON with NaN and Infinity as Python writes them; floats keep all bits.

    Args:
        registration: the result; None where the pair could not be registered.
        failure: why not.
    """
    if registration is None:
        return json.dumps({"failure": failure})
    return json.dumps({"registration": _to_json(registration)})


def from_text(text: str) -> tuple[Registration | None, str]:
    """The registration and the failure that `to_text` was given; numbers as Python's own, arrays as float64.

    Raises:
        ValueError, LookupError, TypeError: the text is something else.
    """
    content = json.loads(text)
    if "failure" in content:
        return None, str(content["failure"])
    return _from_json(content["registration"]), ""


def signature_to_text(signature: np.ndarray | None) -> str:
    """A scan's signature, (K,) float32, as JSON; null where the scan has none."""
    return json.dumps(None if signature is None else signature.tolist())


def signature_from_text(text: str) -> np.ndarray | None:
    """The signature that `signature_to_text` was given, bit by bit.

    Raises:
        ValueError, TypeError: the text is something else.
    """
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
    return Registration(
        **content
        | {
            # not normalized, which would change its last bits
            "T_target_source": RigidTransform(np.array(content["T_target_source"]), normalize=False),
            "covariance": np.array(content["covariance"], np.float64),
            "step_psr": tuple((name, psr) for name, psr in content["step_psr"]),
            "evidence": tuple((name, value) for name, value in content["evidence"]),
            "alternatives": tuple(_from_json(alternative) for alternative in content["alternatives"]),
        }
    )
