"""A spectral registration that keeps what it measured of all hypotheses, and texts that hold it."""

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from math import nan
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.fit import Fit
from sonarmap.spectral.verify.hypothesis import Hypothesis
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from sonarmap.spectral.verify.observability import Observability
from sonarmap.spectral.verify.prior_term import PriorTerm
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.experiment import Value

# What says that no pose is right [degrees, voxels]
_NOWHERE = 180.0, 1e3


class Recorder(SpectralRegistrar):
    """Registers as its base does, and keeps of the last pair what it measured."""

    _measured: tuple[HypothesisTest, Sequence[Hypothesis], Observability] | None = None

    def _conclude(self, test: HypothesisTest, hypotheses: Sequence[Hypothesis], seen: Observability) -> Registration:
        self._measured = test, hypotheses, seen
        return super()._conclude(test, hypotheses, seen)

    def _looked_at_again(self, target: SpectralScan, source: SpectralScan, bounds: Bounds) -> None:
        """What is kept was measured on its own grid; another is none of it."""

    def cells(self, truth: RigidTransform | None) -> list[dict[str, Value]]:
        """A row of each hypothesis of the pair that was registered since the last call, the best first.

        Of each its evidence and its error; of the best what else was measured, as `fit_of` and `seen_of` read it.
        """
        if self._measured is None:
            return []
        (test, hypotheses, seen), self._measured = self._measured, None
        T = [test.transform(hypothesis.fit) for hypothesis in hypotheses]
        rows: list[dict[str, Value]] = []
        for rank, hypothesis in enumerate(hypotheses):
            row: dict[str, Value] = {"rank": rank} | _error(T[rank], truth, self.grid.voxel)
            row |= {f"e_{name}": float(value) for name, value in asdict(hypothesis.evidence).items()}
            row |= {"e_rotation": hypothesis.rotation_score, "e_candidate": hypothesis.candidate_psr}
            row["numbers"] = _text(away=(T[0].inv() * T[rank]).as_exp_coords())
            rows.append(row)
        best = hypotheses[0].fit
        xi = np.full(6, nan) if truth is None else (T[0].inv() * truth).as_exp_coords()
        centers = [scan.volume.center for scan in (test.target, test.source)]
        rows[0] |= {"refused": bool(test.bounds.refusal(T[0])), "search": test.bounds.search(self.grid.extent)}
        rows[0]["numbers"] = _text(xi=xi, centers=centers, fit=_contents(best), seen=_contents(seen))
        return rows


def fit_of(numbers: dict[str, Any]) -> Fit:
    """The best hypothesis' fit, from what the text of its row's `numbers` holds."""
    arrays: dict[str, Any] = {
        name: np.array(value) if isinstance(value, list) else value for name, value in numbers["fit"].items()
    }
    prior: dict[str, Any] | None = arrays.pop("prior")
    term = None if prior is None else PriorTerm(**{name: np.array(value) for name, value in prior.items()})
    return Fit(**arrays | {"R": Rotation.from_quat(arrays["R"]), "prior": term})


def seen_of(numbers: dict[str, Any]) -> Observability:
    """What was seen along its directions, likewise."""
    return Observability(**{name: np.array(value) for name, value in numbers["seen"].items()})


def _contents(value: Any) -> dict[str, Any]:
    """The fields of a dataclass by name, and those of dataclasses in it."""
    found = {field.name: getattr(value, field.name) for field in fields(value)}
    return {name: _contents(part) if isinstance(part, PriorTerm) else part for name, part in found.items()}


def _text(**values: Any) -> str:
    return json.dumps(values, default=_plain)


def _plain(value: Any) -> Any:
    return value.as_quat().tolist() if isinstance(value, Rotation) else np.asarray(value).tolist()


def _error(T: RigidTransform, truth: RigidTransform | None, voxel: float) -> dict[str, Value]:
    if truth is None:
        return {"rotation_deg": _NOWHERE[0], "off_voxels": _NOWHERE[1]}
    error = pair_error(T, truth)
    return {"rotation_deg": error.rotation_deg, "off_voxels": error.translation_m / voxel}
