"""A spectral registration that keeps what it measured of all hypotheses, as rows, and these rows read back."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from math import nan, pi
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.fit import Fit, PriorTerm
from sonarmap.spectral.verify.hypothesis import Evidence, Hypothesis
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from sonarmap.spectral.verify.verifier import Observability
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.evidence_pairs import EvidencePair
from sonarmap.tools.lab.reproduce.experiment import Row, Value

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


class Recording:
    """Registers the pairs of a draw; a scan is prepared once for each grid."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._recorders: dict[object, Recorder] = {}
        self._prepared: dict[object, SpectralScan] = {}

    def rows(self, pair: EvidencePair) -> list[Row]:
        """One of each hypothesis; none where a scan shows too little, or nothing is possible."""
        config = SpectralConfig(max_tilt=pi) if pair.any_tilt else SpectralConfig()
        key = pair.grid, config
        recorder = self._recorders[key] = self._recorders.get(key) or Recorder(self._device, pair.grid, config)
        try:
            target, source = (self._prepare(recorder, scan) for scan in (pair.target, pair.source))
        except InputError:
            return []
        if pair.expected is None:
            recorder.register(target, source)
        else:
            recorder.register_expected(target, source, pair.expected)
        pair_cells = pair.cells | {"edge": pair.grid.edge, "voxel_m": pair.grid.voxel}
        pair_cells |= {"related": pair.truth is not None}
        return [pair_cells | cells for cells in recorder.cells(pair.truth)]

    def _prepare(self, recorder: Recorder, scan: Scan) -> SpectralScan:
        key = id(recorder), id(scan.points)
        if key not in self._prepared:
            self._prepared[key] = recorder.prepare(scan)
        return replace(self._prepared[key], prior=scan.prior)


@dataclass(frozen=True, slots=True)
class RecordedPair:
    """One pair."""

    cells: Row  # what it is: set, number, scene, relief, known, apart, edge, voxel_m, related, search, refused
    hypotheses: tuple[Hypothesis, ...]  # best first; the fit of the others is not known but for their pose
    T: tuple[RigidTransform, ...]  # of each, from the best
    off: np.ndarray  # (n, 2) how far off each is [degrees, voxels]
    seen: Observability
    xi: np.ndarray  # (6,) truth = T Exp(xi) of the best; NaN where none is true
    centers: tuple[np.ndarray, np.ndarray]

    @property
    def grid(self) -> Grid:
        """That both scans share."""
        return Grid(int(self.cells["edge"]), float(self.cells["voxel_m"]))


def recorded_pairs(rows: Iterable[Row]) -> list[RecordedPair]:
    """The pairs that rows of `Recording` hold."""
    by_pair: list[list[Row]] = []
    for row in rows:
        if row["rank"] == 0:
            by_pair.append([])
        by_pair[-1].append(row)
    return [_pair(some) for some in by_pair]


def _pair(rows: Sequence[Row]) -> RecordedPair:
    numbers = [json.loads(str(row["numbers"])) for row in rows]
    fit = fit_of(numbers[0])
    T = [RigidTransform.identity(), *(RigidTransform.from_exp_coords(each["away"]) for each in numbers[1:])]
    target, source = numbers[0]["centers"]
    return RecordedPair(
        cells=rows[0],
        hypotheses=tuple(_hypothesis(row, fit) for row in rows),
        T=tuple(T),
        off=np.array([[float(row["rotation_deg"]), float(row["off_voxels"])] for row in rows]),
        seen=seen_of(numbers[0]),
        xi=np.array(numbers[0]["xi"], np.float64),
        centers=(np.array(target), np.array(source)),
    )


def _hypothesis(row: Row, fit: Fit) -> Hypothesis:
    evidence = Evidence(**{name: float(row[f"e_{name}"]) for name in Evidence.__dataclass_fields__})
    return Hypothesis(fit, float(row["e_rotation"]), float(row["e_candidate"]), evidence)
