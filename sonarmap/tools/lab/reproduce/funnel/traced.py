"""A spectral registration that looks, stage by stage, whether the true pose is still among what is followed."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.so3 import RotationPeaks
from sonarmap.spectral.verify.candidates import Candidates
from sonarmap.spectral.verify.hypothesis import Hypothesis
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, pair_error
from sonarmap.tools.lab.reproduce.evidence.section import NEAR
from sonarmap.tools.lab.reproduce.experiment import Value

ROUNDS = ("few_points", "more_points", "rough")  # of refinement, after each of which hypotheses are left out
_STAGES = ("rotations", "candidates", *ROUNDS, "compared", "final")
NOWHERE = -1  # the rank of what is not there
# What is given away: nothing, one more rotation, one more hypothesis
NOTHING, ROTATION, POSE = "nothing", "rotation", "pose"


@dataclass(frozen=True)
class TracedTest(HypothesisTest):
    """Notes at which rank, 0 the best, the first is that is near the truth, by stage."""

    truth: RigidTransform  # T_target_source
    given: str
    # by stage; where nothing is possible there is nothing near the truth
    ranks: dict[str, Value] = field(default_factory=lambda: dict[str, Value](dict.fromkeys(_STAGES, NOWHERE)))
    rounds: list[int] = field(default_factory=list[int])  # likewise after each of ROUNDS that there was

    def find_candidates(self, rotations: RotationPeaks) -> Candidates:
        """As its base, and of the true rotation too where that is given."""
        if self.given == ROTATION:
            R = Rotation.concatenate([rotations.R, self.truth.rotation])
            rotations = RotationPeaks(R, np.append(rotations.scores, 0.0))
        off = np.rad2deg((rotations.R * self.truth.rotation.inv()).magnitude())
        self.ranks.update(rotations=_first(off <= NEAR[0]), rotation_deg=float(off.min()))
        candidates = super().find_candidates(rotations)
        turned = np.rad2deg((candidates.R * self.truth.rotation.inv()).magnitude()) <= NEAR[0]
        # under a rotation that is not exact the middle of the scan is where it should be
        middle = self.source.volume.center
        places = self._sensor_shift(candidates.R, candidates.shifts) + candidates.R.apply(middle)
        off = np.linalg.norm(places - self.truth.apply(middle), axis=1) / self.grid.voxel
        self.ranks["candidates"] = _first((turned & (off <= NEAR[1]))[np.argsort(-candidates.psr, kind="stable")])
        return candidates

    def conclude(self, hypotheses: list[Hypothesis], spectral: bool) -> list[Hypothesis]:
        """As its base, with the true pose as well where that is given."""
        if self.given == POSE:
            shift = self.truth.translation - self.target.volume.center
            shift = (shift + self.truth.rotation.apply(self.source.volume.center)) / self.grid.voxel
            one = (np.zeros(1, np.int64), Rotation.concatenate([self.truth.rotation]), shift[None])
            hypotheses = hypotheses + self.refine_candidates(Candidates(*one, np.zeros(1), np.zeros(1)), 1)
        self.ranks["compared"] = self._rank(hypotheses)
        # a candidate that is left alone goes through no more rounds
        rounds = [*self.rounds, *[self.ranks["compared"]] * len(ROUNDS)]
        self.ranks.update(zip(ROUNDS, rounds, strict=False))
        concluded = super().conclude(hypotheses, spectral)
        self.ranks["final"] = self._rank(concluded)
        self.ranks["right"] = self._is_near(concluded[0], (RIGHT_DEG, RIGHT_VOXELS))
        return concluded

    def _possible(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        possible = super()._possible(hypotheses)
        self.rounds.append(self._rank(possible))
        return possible

    def _rank(self, hypotheses: Sequence[Hypothesis]) -> int:
        return _first(np.array([self._is_near(each, NEAR) for each in hypotheses], dtype=bool))

    def _is_near(self, hypothesis: Hypothesis, within: tuple[float, float]) -> bool:
        error = pair_error(self.transform(hypothesis.fit), self.truth)
        return error.rotation_deg <= within[0] and error.translation_m <= within[1] * self.grid.voxel


class TracingRegistrar(SpectralRegistrar):
    """Registers as its base does, and says where the truth was lost."""

    def trace(self, target: SpectralScan, source: SpectralScan, truth: RigidTransform) -> dict[str, Value]:
        """The ranks of what is near the truth, by stage, and whether the pair is right: as it is, with the true
        rotation among the others, with the true pose among the hypotheses."""
        bounds, cells = self._bounds(target, source), dict[str, Value]()
        for given in (NOTHING, ROTATION, POSE):
            test = TracedTest(self.grid, target, source, bounds, self._verifier, truth, given)
            self._answer(test)
            cells[f"right_given_{given}"] = test.ranks.pop("right", False)
            cells |= test.ranks if given == NOTHING else {}
        return cells


def _first(near: np.ndarray) -> int:
    """The first of (n,) bool that is true."""
    return int(near.argmax()) if near.any() else NOWHERE
