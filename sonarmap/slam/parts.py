"""Which components of a survey are maps, and which scans nothing places."""

from collections.abc import Sequence


def placed(components: Sequence[Sequence[int]]) -> list[int]:
    """The numbers of the components that are maps of their own, largest first, the earlier of equals.

    A scan that nothing joined to another is no map; where nothing joined any two, the first scan stands for all.
    """
    ranked = sorted(range(len(components)), key=lambda c: (-len(components[c]), c))
    return [c for c in ranked if len(components[c]) > 1] or ranked[:1]


def unplaced(components: Sequence[Sequence[int]]) -> list[int]:
    """The scans that are in no map, ascending."""
    maps = set(placed(components))
    return sorted(scan for c, members in enumerate(components) if c not in maps for scan in members)
