"""Pairs whose evidence was recorded, as the judgement takes them."""

import csv
import json
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.verify.fit import Fit
from sonarmap.spectral.verify.hypothesis import Evidence, Hypothesis
from sonarmap.spectral.verify.observability import Observability
from sonarmap.tools.lab.reproduce.evidence.recorder import fit_of, seen_of
from sonarmap.tools.lab.reproduce.experiment import Row

EVIDENCE = "evidence.csv"
_NAMES = tuple(Evidence.__dataclass_fields__)


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


def read_recorded(folder: Path) -> list[RecordedPair]:
    """The pairs of a folder of `sonarmap reproduce evidence`.

    Raises:
        InputError: there are none.
    """
    path = folder / EVIDENCE
    csv.field_size_limit(2**24)
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
    except OSError as error:
        raise InputError(f"cannot read {path}: run 'sonarmap reproduce evidence -o {folder}' first") from error
    starts = [n for n, row in enumerate(rows) if row["rank"] == "0"]
    return [_pair(rows[a:b]) for a, b in zip(starts, [*starts[1:], len(rows)], strict=True)]


def _pair(rows: list[dict[str, str]]) -> RecordedPair:
    best, numbers = rows[0], [json.loads(row["numbers"]) for row in rows]
    fit = fit_of(numbers[0])
    T = [RigidTransform.identity(), *(RigidTransform.from_exp_coords(each["away"]) for each in numbers[1:])]
    target, source = numbers[0]["centers"]
    text = {name: best[name] for name in ("set", "scene", "relief", "known")}
    whole = {name: int(best[name]) for name in ("number", "apart", "edge", "related", "refused")}
    return RecordedPair(
        cells=text | whole | {"voxel_m": float(best["voxel_m"]), "search": float(best["search"])},
        hypotheses=tuple(_hypothesis(row, fit) for row in rows),
        T=tuple(T),
        off=np.array([[float(row["rotation_deg"]), float(row["off_voxels"])] for row in rows]),
        seen=seen_of(numbers[0]),
        xi=np.array(numbers[0]["xi"]),
        centers=(np.array(target), np.array(source)),
    )


def _hypothesis(row: dict[str, str], fit: Fit) -> Hypothesis:
    evidence = Evidence(**{name: _number(row[f"e_{name}"]) for name in _NAMES})
    return Hypothesis(fit, _number(row["e_rotation"]), _number(row["e_candidate"]), evidence)


def _number(text: str) -> float:
    return float(text) if text else nan
