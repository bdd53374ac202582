"""What is wrong with a person's ties and control points, or with what they contradict: sentences for the user."""

import math
from collections.abc import Iterator, Sequence

from sonarmap.slam.graph.gauge import MEASURED
from sonarmap.slam.parts import placed
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.products.output.hand import has_no_effect, is_contradicted, tie_effect

FAR = 4.0  # sigmas beyond which a point that holds the map is warned of
LISTED = 5  # pairs in a sentence
_OPEN = {
    "tilt_x": "its tilt about East",
    "tilt_y": "its tilt about North",
    "heading": "which way it points",
    "east": "its East",
    "north": "its North",
    "up": "its height",
}


def tie_faults(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    """Ties without effect, ties that the rest contradicts, and pairs that ties displaced."""
    for tie in result.ties:
        effect, pair = tie_effect(result, tie), f"{names[tie.i]} - {names[tie.j]}"
        if has_no_effect(result, tie):
            yield f"tie {pair}: {tie.verdict}: {effect}"
        elif is_contradicted(result, tie):
            yield f"tie {pair}: {effect}; look at both scans, and if it is wrong take it out of `ties`"
    if result.displaced:
        listed = ", ".join(f"{names[i]} - {names[j]}" for i, j in result.displaced[:LISTED])
        more = ", ..." if len(result.displaced) > LISTED else ""
        yield (
            f"{len(result.displaced)} pairs that the survey keeps by itself are refused for the ties and control "
            f"points: {listed}{more}"
        )


def control_faults(result: SurveyResult, names: Sequence[str]) -> Iterator[str]:
    """Control points that are left out or far off, and parts that too few of them hold."""
    for each in result.control:
        if each.left_out:
            where = f"{each.point.name} in {names[each.point.scan]}"
            yield (
                f"the control point {where} is {math.hypot(*each.residual.tolist()):.2f} m from where everything else "
                f"puts it ({each.wrong:.1f} standard deviations); it is left out. Check its numbers and its scan"
            )
    held = [each for each in result.control if each.point.holds and not each.left_out]
    for each in held:
        if each.in_sigmas > FAR:
            yield (
                f"the control point {each.point.name} in {names[each.point.scan]} is {each.in_sigmas:.1f} of its "
                "standard deviations from where the map has it, and nothing tells which is wrong: check its numbers, "
                "or give more points"
            )
    if any(each.point.holds for each in result.control):
        yield from _open_parts(result, {each.point.scan for each in held})


def _open_parts(result: SurveyResult, holding: set[int]) -> Iterator[str]:
    """What control points leave open of each part; `holding` are the scans with points that hold the map."""
    graph = result.solution.graph
    for rank, c in enumerate(placed(result.components), 1):
        members = result.components[c]
        part = "the map" if len(result.components) == 1 else f"map_{rank}.ply" if rank > 1 else "map.ply"
        if graph.gauge.lies_in_world(members):
            continue
        if holding.isdisjoint(members):
            yield f"no control point is in a scan of {part}, so nothing fixes its place in the world"
        else:
            free = [
                _OPEN[name] for name, open_ in zip(MEASURED, graph.gauge.unmeasured[members[0]], strict=True) if open_
            ]
            yield (
                f"the control points of {part} leave open {', '.join(free)}; at least three that are not on a line "
                "fix all"
            )
