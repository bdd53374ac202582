"""Scans that were given twice: a map would believe what they show twice."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.spectral.scan import Scan

_LISTED = 5  # scans in a sentence
_FIRST = 64  # points by which scans are compared first


def same_points(scans: Sequence[Scan]) -> list[tuple[int, int]]:
    """Each scan whose points are exactly those of an earlier one, and the first that has them: (earlier, later)."""
    firsts: dict[tuple[int, bytes], list[int]] = {}
    pairs: list[tuple[int, int]] = []
    for k, scan in enumerate(scans):
        alike = firsts.setdefault((len(scan.points), scan.points[:_FIRST].tobytes()), [])
        earlier = next((j for j in alike if np.array_equal(scans[j].points, scan.points)), None)
        if earlier is None:
            alike.append(k)
        else:
            pairs.append((earlier, k))
    return pairs


def repeated_in_words(given_twice: Sequence[Path], scans: Sequence[Scan]) -> list[str]:
    """What to tell the user of files that were given twice, and of scans that are another's copy; none if all is well.

    Args:
        given_twice: files that several of the given paths name; each is read once.
        scans: that were read.
    """
    words: list[str] = []
    if given_twice:
        files = _listed([str(path) for path in given_twice])
        words.append(f"given more than once, and used once: {files}")
    copies = same_points(scans)
    if copies:
        named = _listed([f"{scans[later].name} of {scans[earlier].name}" for earlier, later in copies])
        words.append(f"the same points twice: {named}; leave the copies out, or the map believes them twice")
    return words


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED:,} more" if len(names) > _LISTED else "")
