# pyright: strict
"""A finished map in a sentence, and what its user should look at."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

LISTED = 5  # names in a sentence
_UNSURE = 3.0  # standard deviation of a map's rotation that is said [deg]
_FEW = 0.5  # share of the voxels that several scans should have seen


def verdict(summary: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """What summary.json says, in words: a `sentence` about what came of the survey, and `concerns`, what its user
    should look at, a sentence each; names are of all the survey's scans."""
    unplaced, parts = summary["unplaced"], summary["components"]
    inside = len(names) - len(unplaced)
    place = "one map" if len(parts) == 1 else f"{len(parts)} separate maps"
    scans = f"all {inside} scans" if not unplaced else f"{inside} of {len(names)} scans"
    sentence = f"{scans} lie in {place}".capitalize()
    against = "".join(f"{_capital(each)}. " for each in summary.get("contradictions", []))
    return {
        "sentence": f"{against}{sentence}{_tilt(summary)}; {_loops(summary)}{_crossings(summary)}.",
        "concerns": list(_concerns(summary, names)),
    }


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


def _tilt(summary: Mapping[str, Any]) -> str:
    """That the tilt of the largest map is not known, or not well, where navigation places it."""
    part = summary["components"][0]
    if {"tilt_x", "tilt_y"}.intersection(part["unmeasured"]):
        return ", whose tilt is not known: navigation does not determine it"
    sigma = min((summary["scans"][k]["sigmas"]["rotation_deg"] for k in part["scans"]), default=0.0)
    return f", whose tilt and heading are known to {sigma:.0f}° alone" if sigma >= _UNSURE else ""


def _capital(sentence: str) -> str:
    return sentence[0].upper() + sentence[1:]


def _crossings(summary: Mapping[str, Any]) -> str:
    error = summary["crossing_error_m"]
    if not error["pairs"]:
        return ""
    after, before = error["after"], error["before"]
    return f"; where the track crosses itself scans lie {after:.2g} m apart ({before:.2g} m before the loops)"


def _concerns(summary: Mapping[str, Any], names: Sequence[str]) -> Iterator[str]:
    parts = summary["components"]
    if len(parts) > 1:
        separate = f"there are {len(parts)} separate maps, each in a frame of its own"
        yield f"No reliable registration joins all scans: {separate}."
    odd = summary.get("odd_scans", [])  # which earlier maps do not have
    yield from (f"{row['reason']}." for row in odd)
    outside = [scan for scan in summary["unplaced"] if scan not in {row["index"] for row in odd}]
    lost, alone = _named(outside, names), _named(summary["by_navigation"], names)
    for what, words, listing in (
        ("scan", "in no map: no reliable registration joins them to the others", lost),
        ("scan", "placed by navigation alone: no reliable registration joins them", alone),
        ("scan", "could not be read", [row["name"] for row in summary["unread"]]),
        ("gap", "between consecutive scans", [" to ".join(_named(gap, names)) for gap in summary["gaps"]]),
    ):
        if listing:
            yield f"{counted(len(listing), what)} {words}: {listed(listing)}."
    # which earlier maps do not have either
    rows = [*summary.get("understated", []), *([summary["systematic"]] if summary.get("systematic") else [])]
    reasons = [row["reason"] for row in rows if row["reason"] not in summary.get("contradictions", [])]
    yield from (f"{_capital(reason)}." for reason in reasons)
    for fix in summary["wrong_fixes"]:
        away = f"{fix['sigmas']:.1f} standard deviations from what everything else says"
        yield f"The {fix['kind']} of {fix['name']} is {away}; it is left out."
    if not summary["graph"]["converged"]:
        yield "The optimization of the poses stopped before it converged."
    several = parts[0]["map"]["seen_by_two_or_more"]
    if several < _FEW:
        yield f"Only {several:.0%} of the map was seen by more than one scan; the rest is not confirmed."
