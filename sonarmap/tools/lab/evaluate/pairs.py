"""Which tried pairs of a survey are right: precision and recall of what was kept, and of what was rejected."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from scipy.spatial.transform import RigidTransform

from sonarmap.tools.files.map_folder.pairs import TriedPair
from sonarmap.tools.lab.evaluate.trajectory import pair_error


@dataclass(frozen=True, slots=True)
class PairScore:
    """How many pairs were kept or rejected, and were right or wrong."""

    # kept_right, kept_wrong, rejected_right, rejected_wrong: numbers of pairs whose registration did not fail
    kept_right: int
    kept_wrong: int
    rejected_right: int
    rejected_wrong: int
    failed: int = 0  # pairs whose registration failed
    unjudged: int = 0  # pairs with a scan that has no true pose

    @property
    def precision(self) -> float | None:
        """Share of the kept that are right; None where none was kept."""
        return _share(self.kept_right, self.kept_wrong)

    @property
    def recall(self) -> float | None:
        """Share of the right that were kept; None where none was right."""
        return _share(self.kept_right, self.rejected_right)

    @property
    def rejected_precision(self) -> float | None:
        """Share of the rejected that are wrong; None where none was rejected."""
        return _share(self.rejected_wrong, self.rejected_right)

    @property
    def rejected_recall(self) -> float | None:
        """Share of the wrong that were rejected; None where none was wrong."""
        return _share(self.rejected_wrong, self.kept_wrong)

    def to_json(self) -> dict[str, Any]:
        """The numbers and the shares."""
        shares = ("precision", "recall", "rejected_precision", "rejected_recall")
        return asdict(self) | {name: getattr(self, name) for name in shares}


def score_pairs(pairs: Sequence[TriedPair], truth: Mapping[int, RigidTransform], voxel: float) -> PairScore:
    """Compare pairs with the truth: right is what `PairError.is_right` says.

    Recall is among the pairs that were tried: a place that was revisited and never tried is not missed here.

    Args:
        pairs: as they were tried.
        truth: T_world_sensor of the scans that have a true pose, by index.
        voxel: edge of the voxels on which they were registered [m].
    """
    counts = Counter(_outcome(pair, truth, voxel) for pair in pairs)
    return PairScore(*(counts[field.name] for field in fields(PairScore)))


def _outcome(pair: TriedPair, truth: Mapping[int, RigidTransform], voxel: float) -> str:
    """The field of PairScore that counts the pair."""
    if pair.T_target_source is None:
        return "failed"
    if pair.target not in truth or pair.source not in truth:
        return "unjudged"
    right = pair_error(pair.T_target_source, truth[pair.target].inv() * truth[pair.source]).is_right(voxel)
    return f"{'kept' if pair.kept else 'rejected'}_{'right' if right else 'wrong'}"


def _share(part: int, rest: int) -> float | None:
    return part / (part + rest) if part + rest else None
