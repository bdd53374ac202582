"""Warnings about a finished map as sentences, the most important first."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from sonarmap.kernels.counted import counted
from sonarmap.slam.decide.other_place import OtherPlace
from sonarmap.slam.decide.systematic import Systematic
from sonarmap.slam.decide.weak_steps import unconfirmed_steps
from sonarmap.slam.graph.edge import components
from sonarmap.slam.graph.gauge import MEASURED
from sonarmap.slam.odd.odd_scan import OddScan
from sonarmap.slam.odd.scaled import ScaledScans
from sonarmap.slam.pair import DEFECT, Pair
from sonarmap.slam.parts import placed, unplaced
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.products.output.pairs_file import has_no_effect, is_contradicted, tie_effect

_SURE = 0.8  # probability that all uncertain steps are right, from which they need no warning
LISTED = 10  # largest number of scan names in a sentence
FAR = 4.0  # residual of a control point beyond which a warning is given [standard deviations]
_OPEN = {
    "tilt_x": "its tilt about East",
    "tilt_y": "its tilt about North",
    "heading": "its heading",
    "east": "its East",
    "north": "its North",
    "up": "its height",
}
# Where other pairs bridge a gap between two chains of steps, two similar places may have been taken for one.
_BRIDGED = ", bridged by other pairs"
_CHAINS = (
    f"{_BRIDGED}, as two places of one build would be too, such as two tanks (then give the scans before and after in "
    "folders of their own)"
)
INSTRUMENTS = {
    "attitude": "roll and pitch",
    "heading": "headings",
    "position": "positions",
    "depth": "depths",
    "odometry": "steps of dead reckoning",
}
_CHECK = "; check their axes, unit, mount and times (--nav-frame, --mount, --nav-offset)"
_EACH = 3  # largest number of gaps, fixes or other places with a sentence each


def faults(result: SurveyResult, names: Sequence[str]) -> list[str]:
    """Warnings about a survey, one sentence each, the most important first.

    A fault of a single scan is reported once, for that scan. Arguments of the library are in backticks."""
    unusable = _unusable(result, names)
    return [
        *contradictions(result),
        *_of_defects(result, names),
        *(row["reason"] for row in odd_rows(result, names)),
        *_of_parts(result, names, unusable),
        *_of_gaps(result, names, unusable),
        *_of_steps(result, names),
        *_of_stream(result, names),
        *_of_ties(result, names),
        *_of_control(result, names),
        *_of_fixes(result, names),
        *_of_the_whole(result),
    ]


def instrument_faults(result: SurveyResult, names: Sequence[str]) -> list[str]:
    """Those of `faults` that concern the sonar and the navigation."""
    odd = [row["reason"] for row in odd_rows(result, names)]
    return [*contradictions(replace(result, other_places=())), *odd, *_of_fixes(result, names)]


def contradictions(result: SurveyResult) -> list[str]:
    """Contradictions between navigation and the map, or between groups of scans, one sentence each."""
    rows = {row["kind"]: row["reason"] for row in understated_rows(result)}
    words = [result.mistake] if result.mistake else []
    words += [
        rows.get(kind, f"{INSTRUMENTS[kind]} are {sigmas:.1f} standard deviations from the map in the median{_CHECK}")
        for kind, sigmas in result.disputed.items()
    ]
    refused, sure = result.refused_for_navigation
    if refused:
        words.append(
            f"{refused} of {sure} accepted pairs are rejected, as they contradict navigation: check it for exchanged "
            "axes, another unit and wrong times, or map without it"
        )
    words += [_elsewhere(place, result.names) for place in result.other_places[:_EACH]]
    return words if result.scaled is None else [*words, _scaled(result.scaled, result.names)]


def _elsewhere(place: OtherPlace, names: Sequence[str]) -> str:
    """Sentence about a part of the map that may lie elsewhere."""
    (one, other), (a, b) = place.joints[0], place.pairs[0]
    return (
        f"{_listed([names[k] for k in place.scans])} may lie elsewhere, as at places of similar shape: "
        f"{counted(len(place.pairs), 'pair')}, as {names[a]} with {names[b]}, contradict the {len(place.joints)} that "
        f"join them to the map, as {names[one]} with {names[other]}, with about as much evidence. Give the scans in "
        "the order in which they were taken, or navigation, or reject the wrong pairs by ties"
    )


def _scaled(group: ScaledScans, names: Sequence[str]) -> str:
    """Sentence about a group of scans whose ranges have another scale than the rest."""
    named = [names[k] for k in group.scans]
    in_a_row = len(named) > 2 and group.scans[-1] - group.scans[0] == len(named) - 1
    which = f"{named[0]} to {named[-1]}" if in_a_row else _listed(named)
    share = f"{100 * abs(group.longer):.1f} +- {100 * group.sigma:.1f} % {'longer' if group.longer > 0 else 'shorter'}"
    return (
        f"ranges of {which} ({counted(len(named), 'scan')} of {len(names)}) are {share} than those of the others, as "
        "with another speed of sound. Nothing shows which are right: compute all with the speed that was measured, or "
        f"multiply these by {math.exp(-group.longer):.3f} if the others are right"
    )


def odd_rows(result: SurveyResult, names: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of summary.json for faulty scans: the kind, the change that corrects it, and the reason in words."""
    return [
        {
            "index": each.scan,
            "name": names[each.scan],
            "kind": each.kind,
            "mirrored_axes": each.change.axes,
            "factor": each.change.factor,
            "reason": f"{names[each.scan]} {_oddness(each)}",
        }
        for each in result.odd
    ]


def _oddness(odd: OddScan) -> str:
    fits = "it fits its neighbors, and unchanged it does not. It was left out of the map; write"
    if axis := odd.change.axes:
        return f"is mirrored: with the sign of {axis} changed {fits} it with x forward, y left, z up"
    unit = "feet" if odd.kind == "feet" else "meters and the others in feet"
    return f"is in {unit}: with its lengths multiplied by {odd.change.factor:.4f} {fits} all scans in one unit"


def _of_stream(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    if left := [names[k] for k in result.interpolated]:
        listed = ", ".join(left[:LISTED]) + (f" and {len(left) - LISTED} more" if len(left) > LISTED else "")
        what = "scan was" if len(left) == 1 else "scans were"
        yield f"{len(left)} {what} placed by interpolation, because no registration succeeded: {listed}"


def _unusable(result: SurveyResult, names: Sequence[str]) -> dict[int, str]:
    """Scans that every registration failed for, with the reason, where it is the same each time and names the scan."""
    reasons: dict[int, set[str]] = {}
    for pair in result.pairs:
        for k in pair.scans:
            reasons.setdefault(k, set()).add(pair.failure if pair.registration is None else "")
    own = {k: given.pop() for k, given in reasons.items() if len(given) == 1}
    return {k: reason.removeprefix(f"{names[k]}: ") for k, reason in own.items() if reason.startswith(f"{names[k]}: ")}


def _of_defects(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    defects = [pair for pair in result.pairs if pair.is_defect]
    if defects:
        first = defects[0]
        yield (
            f"{len(defects)} of {len(result.pairs)} pairs ended by an error of the method, whatever the scans show; "
            f"the first, {names[first.i]} and {names[first.j]}: {first.failure.removeprefix(DEFECT)}"
        )


def _of_parts(result: SurveyResult, names: Sequence[str], unusable: dict[int, str]) -> Iterator[str]:
    odd = {each.scan for each in result.odd}
    parts, outside = placed(result.components), [k for k in unplaced(result.components) if k not in odd]
    if len(parts) > 1:
        yield (
            f"no reliable registration joins all the scans: there are {len(parts)} separate parts, each with its own "
            "map; the largest is map.ply"
        )
    if unconfirmed := result.unconfirmed:
        step = unconfirmed[0]
        more = f" (gaps like this: {len(unconfirmed)})" if unconfirmed[1:] else ""
        yield (
            f"between {names[step.i]} and {names[step.j]} only the usual motion joins the map, and pairs sought where "
            f"it expects them{more}: two dives or two tanks in one folder give this too. If the vehicle was moved "
            "meanwhile, give the scans before and after in folders of their own"
        )
    yield from _of_scans(outside, ("is in no map", "are in no map"), names, unusable)
    alone = ("lies in the map by navigation alone", "lie in the map by navigation alone")
    yield from _of_scans(result.by_navigation, alone, names, unusable)


def _of_scans(
    scans: Sequence[int], where: tuple[str, str], names: Sequence[str], unusable: dict[int, str]
) -> Iterator[str]:
    """Sentences about scans that no registration joins; `where` has the words for a single scan and for several."""
    blamed, others = [k for k in scans if k in unusable], [k for k in scans if k not in unusable]
    if len(blamed) == 1:
        yield f"{names[blamed[0]]} {where[0]}: {unusable[blamed[0]]}"
    elif blamed:
        yield f"{len(blamed)} scans {where[1]}: {_listed([names[k] for k in blamed])}; the first: {unusable[blamed[0]]}"
    if others:
        yield (
            f"{len(others)} of {len(names)} scans {where[len(others) > 1]}, as no reliable registration joins them "
            f"to the others: {_listed([names[k] for k in others])}"
        )


def _of_gaps(result: SurveyResult, names: Sequence[str], unusable: dict[int, str]) -> Iterator[str]:
    """Sentences about consecutive pairs that were not kept, those that nothing bridges first. Scans at measured
    positions need not match."""
    shared, joined = (
        {scan: c for c, members in enumerate(parts) for scan in members}
        for parts in (result.components, components(len(names), result.edges))
    )
    gaps: dict[str, list[Pair]] = {"": [], ", bridged by navigation": [], _CHAINS: [], _BRIDGED: []}
    in_chains = {k for pair in result.pairs if pair.role == "sequential" and pair.kept for k in pair.scans}
    faulty, located = {*unusable, *(each.scan for each in result.odd)}, _located(result)
    for pair in result.pairs:
        explained = pair.is_defect or not faulty.isdisjoint(pair.scans)
        explained |= not pair.accepted and located.issuperset(pair.scans)
        if pair.role == "sequential" and not pair.kept and not explained:
            bridged = ", bridged by navigation" if shared[pair.i] == shared[pair.j] else ""
            if joined[pair.i] == joined[pair.j]:
                bridged = _CHAINS if in_chains.issuperset(pair.scans) else _BRIDGED
            gaps[bridged].append(pair)
    for bridged, pairs in gaps.items():
        if len(pairs) > _EACH:
            first = pairs[0]
            between = f"as between {names[first.i]} and {names[first.j]}: {first.reason}"
            yield f"{len(pairs)} gaps between consecutive scans{bridged}, {between}"
        else:
            yield from (f"gap between {names[pair.i]} and {names[pair.j]}{bridged}: {pair.reason}" for pair in pairs)


def _located(result: SurveyResult) -> set[int]:
    """Scans with measured positions that take part."""
    return {pose for pose, prior in result.solution.graph.priors if prior.knows_position}


def _of_steps(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    """A sentence about uncertain steps, such as where a vehicle was moved between two scans; not about those between
    measured positions, which would show that."""
    kept = {pair.scans for pair in result.pairs if pair.role == "sequential" and pair.edge is not None}
    trusted = [pair for pair in result.pairs if pair.kept or not pair.accepted]  # what the map rejects confirms nothing
    unsure = [step for step in unconfirmed_steps(trusted) if step.pair.scans in kept]
    located = _located(result)
    unsure = [step for step in unsure if not located.issuperset(step.pair.scans)]
    right = math.prod(step.pair.registration.probability for step in unsure if step.pair.registration)
    if right < _SURE or any(step.refused for step in unsure):
        first = unsure[0].pair
        yield (
            f"{len(unsure)} of {len(kept)} steps between consecutive scans, as between {names[first.i]} and "
            f"{names[first.j]}, are uncertain: all are right with a probability of {right:.0%}, and no other pair "
            "confirms them independently. If the vehicle was moved in between, give the scans before and after in "
            "folders of their own"
        )


def understated_rows(result: SurveyResult) -> list[dict[str, Any]]:
    """Rows of summary.json for instruments with underestimated sigmas: kind, ratio of error to sigma, and reason."""
    return [
        {"kind": kind, "times": times, "reason": _understated(INSTRUMENTS[kind], times, kind in result.contradicted)}
        for kind, times in result.understated.items()
    ]


def systematic_words(error: Systematic) -> str:
    """Sentence about a systematic error of all fixes, and its correction."""
    if (other := error.alternative) is not None:
        first, second = (systematic_words(replace(each, alternative=None)) for each in (error, other))
        return f"{first}; or, which the track cannot distinguish from it, {second}"
    words: list[str] = []
    if error.turn:
        words.append(
            f"headings fit if {math.degrees(error.turn):+.1f} degrees are subtracted, and were corrected so: a "
            "declination, a grid's North or a turned mount (--magnetic-declination, --heading-reference, --mount)"
        )
    if error.late:
        when = "earlier" if error.late > 0 else "later"
        words.append(
            f"positions fit if their times are {abs(error.late):.2g} s {when}, and were corrected so: the clocks of "
            "log and sonar differ (--nav-offset)"
        )
    if error.drift_east or error.drift_north:
        per_minute = 60 * math.hypot(error.drift_east, error.drift_north)
        words.append(f"positions drift by {per_minute:.2g} m a minute against the scans; the drift was removed")
    if error.forward or error.left:
        words.append(
            f"positions fit if they are moved {error.forward:+.1f} m forward and {error.left:+.1f} m to port, and were "
            "corrected so: a lever arm (--mount) or, at a steady speed, a clock's offset (--nav-offset)"
        )
    if error.longer:
        words.append(
            f"positions and depths fit if their distances are multiplied by {1 / (1 - error.longer):.3f}, and were "
            f"corrected so: ranges are too {'long' if error.longer > 0 else 'short'}, as with another speed of sound "
            f"(--range-scale {scale_of(error)}, or --sound-speed)"
        )
    return "; and ".join(words)


def scale_of(error: Systematic) -> str:
    """The --range-scale that corrects the ranges, by this or the alternative error; "" for none."""
    if error.longer:
        return f"{1 - error.longer:.3f}"
    return "" if error.alternative is None else scale_of(error.alternative)


def _understated(what: str, times: float, left_out: bool) -> str:
    if left_out:
        return (
            f"{what} contradict everything else and were left out: their errors are {times:.0f} times their standard "
            "deviations; check them for exchanged axes, another zone or unit, and wrong times"
        )
    return f"{what} have errors {times:.1f} times their standard deviations, and are weighted down accordingly"


def _of_fixes(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    yield from (row["reason"] for row in understated_rows(result) if row["kind"] not in result.disputed)
    if result.systematic is not None:
        yield systematic_words(result.systematic)
    fixes = [
        f"the {fix.kind} of {names[fix.scan]} is {fix.sigmas:.1f} standard deviations from everything else"
        for fix in result.wrong_fixes
    ]
    if len(fixes) <= _EACH:
        yield from (f"{fix}; it is left out" for fix in fixes)
    else:
        yield f"{len(fixes)} measurements of instruments are left out; the first: {fixes[0]}"


def _of_the_whole(result: SurveyResult) -> Iterator[str]:
    if not result.solution.converged:
        yield "the optimization of the poses stopped before it converged"
    stray = sum(point_map.left_out for point_map in result.maps)
    if stray:
        yield f"{stray:,} points lie too far from the others for the map's voxels and are left out of the map"


def _of_ties(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    """Sentences about ties without effect and contradicted ties."""
    for tie in result.ties:
        effect, pair = tie_effect(result, tie), f"{names[tie.i]} - {names[tie.j]}"
        if has_no_effect(result, tie):
            yield f"tie {pair}: {tie.verdict}: {effect}"
        elif is_contradicted(result, tie):
            yield f"tie {pair}: {effect}; look at both scans, and if it is wrong remove it from `ties`"


def _of_control(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    """Sentences about control points that are left out or far off, and parts with too few of them."""
    for each in result.control:
        if each.left_out:
            where = f"{each.point.name} in {names[each.point.scan]}"
            yield (
                f"the control point {where} is {math.hypot(*each.residual.tolist()):.2f} m from where everything else "
                f"puts it ({each.wrong:.1f} standard deviations); it is left out. Check its numbers and its scan"
            )
    used = [each for each in result.control if each.point.holds and not each.left_out]
    for each in used:
        if each.in_sigmas > FAR:
            yield (
                f"the control point {each.point.name} in {names[each.point.scan]} is {each.in_sigmas:.1f} of its "
                "standard deviations from where the map has it, and it is unclear which is wrong: check its numbers, "
                "or give more points"
            )
    if any(each.point.holds for each in result.control):
        yield from _open_parts(result, {each.point.scan for each in used})


def _open_parts(result: SurveyResult, constrained: set[int]) -> Iterator[str]:
    """Sentences about degrees of freedom that control points do not fix; `constrained`: the scans with such points."""
    graph = result.solution.graph
    for rank, c in enumerate(placed(result.components), 1):
        members = result.components[c]
        part = "the map" if len(result.components) == 1 else f"map_{rank}.ply" if rank > 1 else "map.ply"
        if graph.gauge.lies_in_world(members):
            continue
        if constrained.isdisjoint(members):
            yield f"no control point is in a scan of {part}, so nothing fixes its place in the world"
        else:
            free = [
                _OPEN[name] for name, open_ in zip(MEASURED, graph.gauge.unmeasured[members[0]], strict=True) if open_
            ]
            yield f"the control points of {part} do not fix {', '.join(free)}; give three or more off one line"


def _listed(names: Sequence[str], most: int = LISTED) -> str:
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")
