"""One point cloud file to clouds. A new format is a file here and a row of FORMATS."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from kernels.errors import InputError
from tools.readers.clouds import content as kinds
from tools.readers.clouds.cloud import Cloud
from tools.readers.clouds.npy import read_npy
from tools.readers.clouds.npz import read_npz
from tools.readers.clouds.pcd import read_pcd
from tools.readers.clouds.ply import read_ply
from tools.readers.clouds.text import read_text
from tools.readers.selection import Selected


@dataclass(frozen=True, slots=True)
class Format:
    """What a file of one suffix must begin like, and who reads it."""

    kind: str
    read: Callable[[bytes], list[Cloud]]


def _read_sonar(content: bytes) -> list[Cloud]:
    from tools.readers.clouds.sonar import read_sonar  # wlsonar brings an HTTP client: a third of a second

    return read_sonar(content)


FORMATS = {
    ".ply": Format(kinds.PLY, read_ply),
    ".pcd": Format(kinds.PCD, read_pcd),
    ".xyz": Format(kinds.TEXT, read_text),
    ".txt": Format(kinds.TEXT, read_text),
    ".csv": Format(kinds.TEXT, read_text),
    ".npy": Format(kinds.NPY, read_npy),
    ".npz": Format(kinds.NPZ, read_npz),
    ".sonar": Format(kinds.SONAR, _read_sonar),
}


@dataclass(frozen=True, slots=True)
class Found:
    """A cloud, where it comes from, for messages, and the name of its scan."""

    where: str
    name: str
    cloud: Cloud


def read_file(selected: Selected) -> tuple[list[Found], list[str]]:
    """The clouds of one file that hold points, and notes about those that do not.

    Raises:
        InputError: naming the file and, where it applies, its line or packet.
    """
    path = selected.path
    try:
        clouds = _format_of(path).read(_content_of(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except MemoryError as error:
        raise InputError(f"{path}: too large for this machine's memory; thin its points out first") from error
    if selected.index is not None and selected.index >= len(clouds):
        raise InputError(f"{path}#{selected.index}: the file holds scans #0 to #{len(clouds) - 1}; choose one of them")
    label = "#{}" if len(clouds) > 1 else ""
    found = [Found(f"{path}{label.format(i)}", f"{path.stem}{label.format(i)}", c) for i, c in enumerate(clouds)]
    if selected.index is not None:
        return [found[selected.index]], []
    kept = [one for one in found if len(one.cloud.points)]
    if not kept:
        raise InputError(f"{path}: no points in it; give a scan with at least one finite point")
    empty = [one for one in found if not len(one.cloud.points)]
    return kept, [f"{Path(one.where).name}: passed over, it holds no point" for one in empty]


def _format_of(path: Path) -> Format:
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise InputError(
            f"unknown format {path.suffix or '(no suffix)'!r}; known formats are {', '.join(FORMATS)}"
        ) from None


def _content_of(path: Path) -> bytes:
    """The file's bytes, once they begin as its suffix says."""
    try:
        if not path.is_file():
            raise InputError("it is no regular file; give a file, a folder or a pattern")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error}); check its permissions") from error
    if not content:
        raise InputError("the file is empty (0 bytes); write or copy it again")
    wanted, kind = FORMATS[path.suffix.lower()].kind, kinds.kind_of(content)
    if kind != wanted:
        fitting = [suffix for suffix, known in FORMATS.items() if known.kind == kind]
        hint = f"rename it to {' or '.join(fitting)} if that is what it is" if fitting else "write or copy it again"
        raise InputError(f"it is called {path.suffix} but holds {kind}; wanted {wanted}: {hint}")
    return content
