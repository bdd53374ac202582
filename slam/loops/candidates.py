"""Which scans to register besides consecutive ones: by the estimate and its uncertainty, or by what they look like."""

from collections import defaultdict
from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np

from kernels.errors import InputError
from slam.graph.pose_graph import Solution
from slam.loops.forecast import predict_overlap, sureness
from slam.loops.places import PlaceIndex

# So many times the wanted number of lookalikes are looked up, as neighbors show the same place.
_LOOKALIKES = 3


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How eagerly loops are sought and how strictly they are judged.

    Attributes:
        per_scan: most loops of a round that one scan takes part in; 0 seeks none.
        rounds: how often loops are sought; the later rounds go by an estimate that the earlier loops have bettered.
        min_overlap: expected overlap that makes a pair a candidate, 0..1.
        cell_voxels: edge of the cells in which overlap is predicted [voxels]: coarse, as the estimate has
            drifted.
        spread: a scan's loops lead to scans more than this apart, so that its neighbors do not take them all.
        bound: largest distance of two answers that agree [sigmas]; 4.74 holds 99.9 % of right ones (six degrees of
            freedom).
        floor_rotation, floor_voxels: an uncertainty that is granted in any case, added in quadrature [rad,
            voxels].
    """

    per_scan: int = 2
    rounds: int = 2
    min_overlap: float = 0.3
    cell_voxels: float = 4.0
    spread: int = 2
    bound: float = 4.74
    floor_rotation: float = float(np.radians(1.0))
    floor_voxels: float = 1.0

    def __post_init__(self) -> None:
        if min(self.per_scan, self.spread, self.rounds) < 0:
            raise InputError(
                f"per_scan {self.per_scan}, rounds {self.rounds} and spread {self.spread}: wanted 0 or more of each"
            )
        if not 0 < self.min_overlap <= 1:
            raise InputError(f"min_overlap is {self.min_overlap}; wanted more than 0 and at most 1")
        if min(self.cell_voxels, self.bound) <= 0 or min(self.floor_rotation, self.floor_voxels) < 0:
            raise InputError("cell_voxels and bound have to be positive, the floors not negative")

    def floor(self, voxel: float) -> np.ndarray:
        """(6,) standard deviations that are granted in any case [rad, m]."""
        return np.repeat([self.floor_rotation, self.floor_voxels * voxel], 3)


@dataclass(frozen=True, slots=True)
class Candidate:
    """Two scans that may overlap.

    Attributes:
        i, j: indices of the scans, i < j.
        overlap: expected, 0..1; NaN where no estimate tells.
        alike: distance of their signatures; NaN where the estimate proposed them.
    """

    i: int
    j: int
    overlap: float = float("nan")
    alike: float = float("nan")


def find_candidates(
    outlines: Sequence[np.ndarray],
    solution: Solution,
    voxel: float,
    settings: LoopSettings,
    tried: Set[tuple[int, int]] = frozenset(),
) -> list[Candidate]:
    """Pairs that the estimate and its uncertainty say overlap, best first within the limits per scan.

    What counts is the expected overlap: that at the estimate, less what the joint marginal of both poses leaves open.
    Only scans of one component are compared: between components the estimate says nothing.

    Args:
        outlines: of N scans, as `outline` gives them in the settings' cells.
        solution: the optimized graph of their N poses.
        voxel: edge of the survey's voxels [m].
        settings: thresholds and limits.
        tried: pairs (i, j), i < j, that are not wanted again; consecutive ones never are.
    """
    cell = settings.cell_voxels * voxel
    ranked: list[Candidate] = []
    for members in solution.graph.components:
        if settings.per_scan == 0 or len(members) < 3:
            continue
        chosen = np.array(members)
        overlap = predict_overlap([outlines[k] for k in members], solution.trajectory.T_world_sensor[chosen], cell)
        a, b = np.nonzero(np.triu(overlap >= settings.min_overlap, 1))
        ranked += [
            Candidate(i, j, float(share))
            for i, j, share in zip(chosen[a].tolist(), chosen[b].tolist(), overlap[a, b], strict=True)
        ]
    new = [c for c in ranked if c.j - c.i > 1 and (c.i, c.j) not in tried]
    # the most that can be wanted, and as many again for those that prove unsure
    likely = within_limits(sorted(new, key=lambda c: (-c.overlap, c.i, c.j)), 2 * settings.per_scan, settings.spread)
    expected = [
        Candidate(c.i, c.j, c.overlap * sureness(outlines[c.i], outlines[c.j], *solution.relative(c.i, c.j), cell))
        for c in likely
    ]
    kept = [c for c in expected if c.overlap >= settings.min_overlap]
    return within_limits(sorted(kept, key=lambda c: (-c.overlap, c.i, c.j)), settings.per_scan, settings.spread)


def find_lookalikes(
    signatures: Sequence[np.ndarray | None],
    parts: Sequence[Sequence[int]],
    settings: LoopSettings,
    tried: Set[tuple[int, int]] = frozenset(),
) -> list[Candidate]:
    """Pairs of different parts that look alike: where no estimate tells how two parts lie, their scans may.

    Args:
        signatures: of N scans; None where a scan has none.
        parts: the scans of each part, as edges join them; surveys of one place are parts until something joins them.
        settings: limits.
        tried: pairs (i, j), i < j, that are not wanted again.
    """
    part = {k: number for number, members in enumerate(parts) for k in members}
    scans = sorted((k for k, one in enumerate(signatures) if one is not None), key=lambda k: (part[k], k))
    if settings.per_scan == 0 or len({part[k] for k in scans}) < 2:
        return []
    index = PlaceIndex(np.stack([signatures[k] for k in scans]), np.array([part[k] for k in scans]))  # pyright: ignore
    found = index.candidates(_LOOKALIKES * settings.per_scan, gap=0, elsewhere=True)
    pairs = [(*sorted((scans[one.i], scans[one.j])), one.distance) for one in found]
    ranked = sorted((distance, i, j) for i, j, distance in pairs if (i, j) not in tried)
    return within_limits([Candidate(i, j, alike=d) for d, i, j in ranked], settings.per_scan, settings.spread)


def within_limits(ranked: Sequence[Candidate], per_scan: int, spread: int) -> list[Candidate]:
    """The first of these, so that a scan has no more than `per_scan` partners, more than `spread` scans apart."""
    partners: dict[int, list[int]] = defaultdict(list)
    kept = []
    for candidate in ranked:
        i, j = candidate.i, candidate.j
        full = max(len(partners[i]), len(partners[j])) >= per_scan
        near = [abs(j - other) for other in partners[i]] + [abs(i - other) for other in partners[j]]
        if not full and all(gap > spread for gap in near):
            partners[i].append(j)
            partners[j].append(i)
            kept.append(candidate)
    return kept
