"""Remedies that were chosen on the page of a dive: options of the mapping, and of the final map."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

from sonarmap.tools.command.live.kept_keys import FOLDER
from sonarmap.tools.command.navigation import NavigationReading, PriorsFile
from sonarmap.tools.command.survey import PointReading
from sonarmap.tools.files.finding import Remedy
from sonarmap.tools.files.readers.navigation.correction import Correction
from sonarmap.tools.files.writers.atomic import atomic_path

_FILE = "chosen.json"  # beside the key scans
_OF_NAVIGATION = ("correct_priors", "nav_offset")


def changes_scans(remedy: Remedy) -> bool:
    """Whether the remedy changes the points of scans; then all scans are placed again."""
    return remedy.option not in _OF_NAVIGATION


@dataclass(frozen=True, slots=True)
class Reading:
    """Options of reading scans and navigation that remedies change."""

    priors: PriorsFile
    log: NavigationReading
    points: PointReading

    def corrected(self, remedies: Sequence[Remedy]) -> "Reading":
        """The options with these remedies, one after the other."""
        return reduce(_corrected, remedies, self)


def _corrected(reading: Reading, remedy: Remedy) -> Reading:
    priors, log, points, value = reading.priors, reading.log, reading.points, remedy.values[0]
    match remedy.option:
        case "correct_priors":
            before = priors.correct_priors
            both = Correction.of(value) if before is None else Correction.of(value).after(Correction.of(before))
            priors = replace(priors, correct_priors=str(both) or None)
        case "nav_offset":
            log = replace(log, nav_offset=(log.nav_offset or 0.0) + float(value))
        case "range_scale":
            points = replace(points, range_scale=(points.range_scale or 1.0) * float(value))
        case "exclude_box":
            points = replace(points, exclude_box=[*points.exclude_box, *remedy.values])
        case "frame":
            points = replace(points, frame=value)
        case _:
            raise ValueError(remedy)
    return Reading(priors, log, points)


def keep_chosen(out: Path, remedies: Sequence[Remedy]) -> None:
    """Write the chosen remedies to the map's folder, so that a continued dive uses them."""
    with atomic_path(out / FOLDER / _FILE) as temporary:
        temporary.write_text(json.dumps(remedies), encoding="utf-8")


def kept_chosen(out: Path) -> list[Remedy]:
    """The remedies of a continued dive; empty if their file is missing or damaged."""
    try:
        kept = json.loads((out / FOLDER / _FILE).read_text(encoding="utf-8"))
        return [Remedy(str(option), tuple(map(str, values))) for option, values in kept]
    except (OSError, ValueError, TypeError):
        return []
