# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""Candidates for loop closures: by the estimate and its uncertainty, or by what the scans look like."""

from collections import defaultdict
from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np

from slam.graph.pose_graph import Solution
from slam.loops.forecast import certainty
from slam.loops.places import PlaceIndex
from slam.loops.separation import separations
from slam.loops.settings import LoopSettings
from slam.map.shared_cells import predict_overlap
from slam.pair import Pair

# The power of the overlap in a loop's worth: where scans share less, they see it from other sides, and err more.
_OVERLAP = 2
# So many times the wanted number of lookalikes are looked up, as neighbors show the same place.
_LOOKALIKES = 3


def find_candidates(
    outlines: Sequence[np.ndarray],
    solution: Solution,
    voxel: float,
    settings: LoopSettings,
    tried: Set[tuple[int, int]] = frozenset(),
) -> list[Pair]:
    """Candidates for loops that the estimate and its uncertainty expect to overlap, best first within the limits.

    What counts is the expected overlap: that at the estimate, less what the joint marginal of both poses leaves open;
    and how far apart the scans are along the edges that there are. Drift grows with that, so that loops between far
    parts tell most, while those between neighbors repeat what the chain says.
    Only scans of one component are compared: between components there is no estimate.

    Args:
        outlines: of N scans, as `outline` gives them in the settings' cells.
        solution: the optimized graph of their N poses.
        voxel: edge of the survey's voxels [m].
        settings: thresholds and limits.
        tried: pairs (i, j), i < j, to leave out; consecutive scans are always left out.
    """
    cell = settings.cell_voxels * voxel
    ranked: list[Pair] = []
    for members in solution.graph.components:
        if settings.per_scan == 0 or len(members) < 3:
            continue
        scans = np.array(members)
        overlap = predict_overlap([outlines[k] for k in members], solution.trajectory.T_world_sensor[scans], cell)
        a, b = np.nonzero(np.triu(overlap >= settings.min_overlap, 1))
        ranked += [
            Pair(i, j, "loop", float(share))
            for i, j, share in zip(scans[a].tolist(), scans[b].tolist(), overlap[a, b], strict=True)
        ]
    new = [pair for pair in ranked if pair.j - pair.i > 1 and pair.scans not in tried]
    # the most that can be taken, and as many again for those that prove uncertain
    likely = within_limits(_by_worth(new, solution), 2 * settings.per_scan, settings.spread)
    expected: list[Pair] = []
    for pair in likely:
        share = certainty(outlines[pair.i], outlines[pair.j], *solution.relative(pair.i, pair.j), cell)
        expected.append(replace(pair, predicted_overlap=pair.predicted_overlap * share))
    kept = [pair for pair in expected if pair.predicted_overlap >= settings.min_overlap]
    return within_limits(_by_worth(kept, solution), settings.per_scan, settings.spread)


def find_lookalikes(
    signatures: Sequence[np.ndarray | None],
    parts: Sequence[Sequence[int]],
    settings: LoopSettings,
    tried: Set[tuple[int, int]] = frozenset(),
) -> list[Pair]:
    """Candidates for loops between parts, of scans that look alike: where no estimate exists, their looks may tell.

    Args:
        signatures: of N scans; None where a scan has none.
        parts: the scans of each part, as edges join them; surveys of one place are parts until something joins them.
        settings: limits.
        tried: pairs (i, j), i < j, to leave out.
    """
    part = {k: number for number, members in enumerate(parts) for k in members}
    known = {k: signature for k, signature in enumerate(signatures) if signature is not None}
    scans = sorted(known, key=lambda k: (part[k], k))
    if settings.per_scan == 0 or len({part[k] for k in scans}) < 2:
        return []
    index = PlaceIndex(np.stack([known[k] for k in scans]), np.array([part[k] for k in scans]))
    alike = index.candidates(_LOOKALIKES * settings.per_scan, gap=0, elsewhere=True)
    ranked = sorted((look.distance, *sorted((scans[look.i], scans[look.j]))) for look in alike)
    new = [Pair(i, j, "loop", alike=distance) for distance, i, j in ranked if (i, j) not in tried]
    return within_limits(new, settings.per_scan, settings.spread)


def within_limits(ranked: Sequence[Pair], per_scan: int, spread: int) -> list[Pair]:
    """The first of these, so that a scan has no more than `per_scan` partners, more than `spread` scans apart."""
    partners: dict[int, list[int]] = defaultdict(list)
    kept: list[Pair] = []
    for pair in ranked:
        i, j = pair.scans
        full = max(len(partners[i]), len(partners[j])) >= per_scan
        gaps = [abs(j - partner) for partner in partners[i]] + [abs(i - partner) for partner in partners[j]]
        if not full and all(gap > spread for gap in gaps):
            partners[i].append(j)
            partners[j].append(i)
            kept.append(pair)
    return kept


def _by_worth(pairs: Sequence[Pair], solution: Solution) -> list[Pair]:
    """Those first that are likely to succeed and tie far parts together."""
    if not pairs:
        return []
    scans = np.array([pair.scans for pair in pairs])
    apart = separations(len(solution.trajectory), solution.graph.edges, scans)
    overlap = np.array([pair.predicted_overlap for pair in pairs])
    # what instruments alone place is infinitely far along the edges
    worth = overlap**_OVERLAP * np.log2(1 + np.minimum(apart, len(solution.trajectory)))
    return [pairs[k] for k in np.lexsort((scans[:, 1], scans[:, 0], -worth))]
