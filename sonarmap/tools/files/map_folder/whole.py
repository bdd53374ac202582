"""Whether the files of a map's folder are of one run: its summary.json, written last, has the SHA-256 of the others."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.inputs import sha256_of
from sonarmap.tools.files.map_folder.names import FULL_GRAPH, SUMMARY
from sonarmap.tools.files.writers.atomic import writing
from sonarmap.tools.files.writers.json_text import write_json


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
