"""The names of the files in the folder that `sonarmap map` writes, and which of them are of an earlier run."""

import re
from collections.abc import Iterable
from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.csv_table import PAIRS, SUMMARY
from sonarmap.tools.files.readers.json_file import read_json

OF_EACH = ("map{}.ply", "map{}.png", "trajectory{}.tum")  # with a place for the number of the component
GRAPH, FULL_GRAPH = "graph.g2o", "graph.json"
OF_ALL = (GRAPH, FULL_GRAPH, PAIRS, SUMMARY)  # the files of all components
TIMES, JOURNAL = "times.json", "journal.sqlite"
PICTURE = ".png"
REPORT = "report.html"  # written after the others, from them
OF_LINES = NAVIGATION, SOUNDINGS, LINES = "navigation.csv", "soundings.laz", "lines.json"  # of a map of lines of pings
_MAP = re.compile(r"map(_all)?(_\d+)?(_survey_\d+)?\.ply")
_OF_PART = re.compile(_MAP.pattern + r"|map(_\d+)?\.png|trajectory(_\d+)?\.tum")


def side_car(name: str) -> str:
    """The name of the file that says what an exported file of this name is."""
    return f"{name}.json"


def require_apart(folder: Path, files: Iterable[Path]) -> None:
    """Refuse scans that are the map of an earlier run, or would be overwritten by the new map."""
    for path in files:
        if (_MAP.fullmatch(path.name) or path.name == PAIRS) and path.parent.resolve() == folder.resolve():
            raise InputError(
                f"{path} is among the scans, but the map is written to {folder}: the file is of an earlier "
                "run, or would be overwritten. Leave it out, or choose another output folder."
            )


def earlier_files(folder: Path) -> set[str]:
    """The components' files of an earlier run in the folder, and what was exported of it, as its summary lists them;
    none without a summary."""
    try:
        names = set(read_json(folder / SUMMARY, "the summary.json of an earlier map")["files"])
        exported = {name for name in names if Path(name).name == name and side_car(name) in names}
        own = {name for name in names if _OF_PART.fullmatch(name) or name in (REPORT, *OF_LINES)}
        return own | exported | {side_car(name) for name in exported}
    except (ValueError, LookupError, TypeError):  # missing, or not ours: nothing is removed
        return set()
