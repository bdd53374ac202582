"""Which files a command line means: files, folders and patterns, in natural order."""

from __future__ import annotations

import glob
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from kernels.errors import InputError
from tools.readers.instruments import PRIORS

_INDEXED = re.compile(r"(.+)#(\d{1,9})", re.ASCII | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Selection:
    """Files in natural order, and whether they were named in another."""

    files: tuple[Selected, ...]
    reordered: bool


@dataclass(frozen=True, slots=True)
class Selected:
    """One file, and which of its scans is wanted (None: all)."""

    path: Path
    index: int | None = None


def select_files(paths: Sequence[str | Path], suffixes: Collection[str], beside: Collection[Path] = ()) -> Selection:
    """The files that `paths` name, each once whatever its path, in natural order (scan2 before scan10).

    Args:
        paths: files (`recording.sonar#3` is its scan 3, from 0), folders, and patterns such as `scans/*.ply`.
        suffixes: of the files that are taken from folders and patterns; others there are passed over, as is priors.csv.
        beside: more files to pass over there, whatever their suffix.

    Raises:
        InputError: a path that does not exist, a folder or pattern without such a file, no path at all.
    """
    if not paths:
        raise InputError("no scans given; name files, folders or patterns such as scans/*.ply")
    chosen: dict[tuple[Path, int | None], Selected] = {}
    passed = {path.resolve() for path in beside}
    for path in paths:
        for found in sorted(_expand(str(path), suffixes, passed), key=_order):
            chosen.setdefault((found.path.resolve(), found.index), found)
    given = list(chosen.values())
    files = sorted(given, key=_order)
    return Selection(tuple(files), reordered=files != given)


def _order(selected: Selected) -> tuple[tuple[tuple[str, int], ...], int]:
    return natural_key(str(selected.path)), selected.index or 0


def natural_key(text: str) -> tuple[tuple[str, int], ...]:
    """A sorting key that counts: scan2 before scan10."""
    pieces = re.findall(r"(\D*)(\d*)", text, re.ASCII)
    return tuple((letters.casefold(), int(digits[:4000] or -1)) for letters, digits in pieces)


def _expand(text: str, suffixes: Collection[str], passed: Collection[Path]) -> list[Selected]:
    path = Path(text)
    try:
        if path.is_dir():
            return _known(path.iterdir(), suffixes, passed, f"the folder {text}")
        if path.exists():
            return [Selected(path)]
        indexed = _INDEXED.fullmatch(text)
        if indexed and Path(indexed[1]).is_file():
            return [Selected(Path(indexed[1]), int(indexed[2]))]
        if glob.has_magic(text):
            found = [Path(name) for name in glob.glob(text, recursive=True)]  # noqa: PTH207 (absolute patterns too)
            return _known(found, suffixes, passed, f"the pattern {text}")
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {text!r}: {error}. Check the path and its permissions") from error
    raise InputError(f"no such file or folder: {text}. Check the spelling; relative paths start from {Path.cwd()}")


def _known(found: Iterable[Path], suffixes: Collection[str], passed: Collection[Path], where: str) -> list[Selected]:
    files = [path for path in found if path.suffix.lower() in suffixes and not path.name.startswith(".")]
    files = [path for path in files if path.is_file() and path.name != PRIORS and path.resolve() not in passed]
    if not files:
        raise InputError(f"{where} holds no scans; known formats are {', '.join(suffixes)}")
    return [Selected(path) for path in files]
