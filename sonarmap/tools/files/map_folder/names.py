"""The names of the files in the folder that `sonarmap map` writes, and whether they are of one run.

summary.json is written last and has the SHA-256 of the others.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.inputs import sha256_of
from sonarmap.tools.files.readers.csv_table import PAIRS, SUMMARY
from sonarmap.tools.files.user_file import read_json
from sonarmap.tools.files.writers.atomic import writing
from sonarmap.tools.files.writers.tables import write_json

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


@contextmanager
def as_written(folder: Path) -> Iterator[None]:
    """Values that `map` does not write are the fault of summary.json or graph.json, not of who uses them."""
    try:
        yield
    except InputError:
        raise
    except (ValueError, LookupError, TypeError, ArithmeticError, AttributeError) as error:
        where = f"{folder / SUMMARY} and {FULL_GRAPH}"
        raise InputError(f"{where} are not as `sonarmap map` writes them ({error!r}); map again") from error


def write_summary(folder: Path, summary: Mapping[str, Any], also: Iterable[str] = ()) -> None:
    """Write a map's summary.json, with the names of further files in its list."""
    files = dict.fromkeys([*summary.get("files", ()), *also])
    write_json(folder / SUMMARY, {**summary, "files": list(files)})


def checksums(written: Sequence[tuple[Path, Path]]) -> dict[str, dict[str, Any]]:
    """Size and SHA-256 of files, by name, as `all_or_none` gives them: the temporary path of each and its own."""
    rows: dict[str, dict[str, Any]] = {}
    for temporary, path in written:
        with writing(path):
            rows[path.name] = {"bytes": temporary.stat().st_size, "sha256": sha256_of(temporary)}
    return rows


def require_own(folder: Path, summary: Mapping[str, Any], read: Iterable[str]) -> None:
    """Refuse files of another run than summary.json's, by their sizes and, of those that are `read`, by their SHA-256.
    Maps of earlier versions have no checksums. Raises InputError: naming the file."""
    known, wanted = summary.get("checksums", {}), set(read)
    for name, row in known.items():
        path = folder / name
        if path.is_file() and (
            path.stat().st_size != row["bytes"] or (name in wanted and sha256_of(path) != row["sha256"])
        ):
            raise InputError(
                f"{path} does not belong to {SUMMARY} beside it: its size or SHA-256 is another. It was changed, or a "
                "run was killed while it wrote; run `sonarmap map` again, which continues from what is done"
            )
