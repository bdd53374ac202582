"""Which components of a survey are maps, and which scans belong to none. No library is imported here."""

from collections.abc import Sequence


def placed(components: Sequence[Sequence[int]]) -> list[int]:
    """The numbers of the components that are maps of their own, largest first, the earlier of equals.

    A component of a single scan is no map, unless there are only such components: then the first is the map.
    """
    ranked = sorted(range(len(components)), key=lambda c: (-len(components[c]), c))
    return [c for c in ranked if len(components[c]) > 1] or ranked[:1]


def unplaced(components: Sequence[Sequence[int]]) -> list[int]:
    """The scans that are in no map, ascending."""
    maps = set(placed(components))
    return sorted(scan for c, members in enumerate(components) if c not in maps for scan in members)
