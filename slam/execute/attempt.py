"""What came of registering a pair, and the same as text, bit by bit.

Everything that a pair's result passes through, another process or a journal, takes the text: pickling a RigidTransform
changes its last bits.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from spectral.result import Registration


@dataclass(frozen=True, slots=True)
class Attempt:
    """What came of registering a pair.

    Attributes:
        registration: its result; None where it raised.
        failure: why it raised, in words.
    """

    registration: Registration | None
    failure: str = ""


def to_text(attempt: Attempt) -> str:
    """JSON, with NaN and Infinity as Python writes them; floats are told so that they come back as they were."""
    if attempt.registration is None:
        return json.dumps({"failure": attempt.failure})
    return json.dumps({"registration": _to_json(attempt.registration)})


def from_text(text: str) -> Attempt:
    """What `to_text` was given; numbers as Python's own, arrays as float64.

    Raises:
        ValueError, LookupError, TypeError: the text is something else.
    """
    content = json.loads(text)
    if "failure" in content:
        return Attempt(None, str(content["failure"]))
    return Attempt(_from_json(content["registration"]))


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
        "alternatives": [_to_json(other) for other in registration.alternatives],
    }


def _from_json(content: dict[str, Any]) -> Registration:
    return Registration(
        **content
        | {
            # not normalized, which would change its last bits
            "T_target_source": RigidTransform(np.array(content["T_target_source"]), normalize=False),
            "covariance": np.array(content["covariance"], np.float64),
            "step_psr": tuple((name, psr) for name, psr in content["step_psr"]),
            "alternatives": tuple(_from_json(other) for other in content["alternatives"]),
        }
    )
