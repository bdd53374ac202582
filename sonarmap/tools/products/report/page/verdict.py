# pyright: strict
"""A finished map in a sentence, and what its user should look at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

LISTED = 5  # names in a sentence
_FEW = 0.5  # share of the voxels that several scans should have seen


@dataclass(frozen=True, slots=True)
class Verdict:
    """Attributes:
    sentence: what came of the survey.
    concerns: what its user should look at, a sentence each; none where all is well.
    """

    sentence: str
    concerns: tuple[str, ...]


def verdict(summary: Mapping[str, Any], names: Sequence[str]) -> Verdict:
    """What summary.json says, in words; names are of all the survey's scans."""
    unplaced, parts = summary["unplaced"], summary["components"]
    inside = len(names) - len(unplaced)
    place = "one map" if len(parts) == 1 else f"{len(parts)} separate maps"
    scans = f"all {inside} scans" if not unplaced else f"{inside} of {len(names)} scans"
    sentence = f"{scans} lie in {place}".capitalize()
    return Verdict(f"{sentence}; {_loops(summary)}{_crossings(summary)}.", tuple(_concerns(summary, names)))


def counted(count: int, what: str) -> str:
    """A number of things, such as "1 loop" or "no loops"."""
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def listed(names: Sequence[str]) -> str:
    """The first of some names."""
    return ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")


def _named(scans: Sequence[int | None], names: Sequence[str]) -> list[str]:
    return ["?" if scan is None else names[scan] for scan in scans]


def _loops(summary: Mapping[str, Any]) -> str:
    loops = summary["pairs"]["by_role"].get("loop", {"tried": 0, "kept": 0})
    if not loops["tried"]:
        return "no loops were tried"
    return f"{loops['kept']} of {counted(loops['tried'], 'loop')} {'was' if loops['kept'] == 1 else 'were'} kept"


def _crossings(summary: Mapping[str, Any]) -> str:
    error = summary["crossing_error_m"]
    if not error["pairs"]:
        return ""
    after, before = error["after"], error["before"]
    return f"; where the track crosses itself scans lie {after:.2g} m apart ({before:.2g} m before the loops)"


def _concerns(summary: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    parts, graph, gaps = summary["components"], summary["graph"], summary["gaps"]
    concerns: list[str] = []
    if len(parts) > 1:
        concerns.append(
            f"No reliable registration joins all scans: there are {len(parts)} separate maps, each in a frame of its "
            "own."
        )
    for scans, words in (
        (summary["unplaced"], "in no map: no reliable registration joins them to the others"),
        (summary["by_navigation"], "placed by navigation alone: no reliable registration joins them"),
    ):
        if scans:
            concerns.append(f"{counted(len(scans), 'scan')} {words}: {listed(_named(scans, names))}.")
    if unread := summary["unread"]:
        concerns.append(f"{counted(len(unread), 'scan')} could not be read: {listed([row['name'] for row in unread])}.")
    if gaps:
        pairs = [" to ".join(_named(gap, names)) for gap in gaps]
        concerns.append(f"{counted(len(gaps), 'gap')} between consecutive scans: {listed(pairs)}.")
    concerns += [
        f"The {fix['kind']} of {fix['name']} is {fix['sigmas']:.1f} standard deviations from what everything else "
        "says; it is left out."
        for fix in summary["wrong_fixes"]
    ]
    if not graph["converged"]:
        concerns.append("The optimization of the poses stopped before it converged.")
    several = parts[0]["map"]["seen_by_two_or_more"]
    if several < _FEW:
        concerns.append(f"Only {several:.0%} of the map was seen by more than one scan; the rest is not confirmed.")
    return concerns
