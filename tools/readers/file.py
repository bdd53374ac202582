"""One point cloud file to clouds. A new format is a file in clouds/ and a row of FORMATS."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from kernels.errors import InputError
from tools.memory import require_memory
from tools.readers.clouds.cloud import Cloud
from tools.readers.clouds.npy import read_npy
from tools.readers.clouds.npz import read_npz
from tools.readers.clouds.pcd import read_pcd
from tools.readers.clouds.ply import read_ply
from tools.readers.clouds.text import read_text
from tools.readers.selection import SelectedFile
from tools.readers.trajectory_beside import TRAJECTORY, with_viewpoints

_HEAD = 4096  # bytes that are looked at to recognize a format


@dataclass(frozen=True, slots=True)
class Format:
    """A format of point clouds.

    Attributes:
        kind: what its files are, in words.
        start: a regular expression for the first bytes of its files.
        read: from a file's content to its clouds.
    """

    kind: str
    start: bytes
    read: Callable[[bytes], list[Cloud]]


def _read_sonar(content: bytes) -> list[Cloud]:
    from tools.readers.clouds.sonar import read_sonar  # wlsonar imports an HTTP client, which takes a third of a second

    return read_sonar(content)


_TEXT = Format("text", rb"[^\x00-\x08\x0e-\x1f\x7f]*\Z", read_text)

# Suffix -> format. Text comes last, as the start of a PLY or PCD file is text too.
FORMATS = {
    ".ply": Format("a PLY file", rb"ply[ \t]*[\r\n]", read_ply),
    ".pcd": Format("a PCD file", rb"# ?\.PCD|(?:\s*#[^\n]*\n)*\s*VERSION\s+0?\.\d", read_pcd),
    ".npy": Format("a NumPy .npy array", rb"\x93NUMPY", read_npy),
    ".npz": Format("a zip archive, as NumPy's .npz is", rb"PK(\x03\x04|\x05\x06)", read_npz),
    ".sonar": Format("a Sonar 3D-15 recording", rb"RIP[12]", _read_sonar),
    ".xyz": _TEXT,
    ".txt": _TEXT,
    ".csv": _TEXT,
}


@dataclass(frozen=True, slots=True)
class NamedCloud:
    """A cloud, the file it comes from (for messages), and the name of its scan."""

    where: str
    name: str
    cloud: Cloud


def read_file(selected: SelectedFile) -> tuple[list[NamedCloud], list[str]]:
    """The clouds of one file that hold points, and notes about those that do not.

    A trajectory NAME.tum beside NAME.ply, or whatever its suffix, says where the sensor was at each point's time.

    Raises:
        InputError: naming the file and, where it applies, its line or packet.
    """
    path = selected.path
    try:
        clouds = _format_of(path).read(_content_of(path))
        beside = path.with_suffix(TRAJECTORY)
        if beside.is_file():
            clouds = [with_viewpoints(cloud, beside) for cloud in clouds]
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except MemoryError as error:
        raise InputError(f"{path}: too large for this machine's memory; thin its points out first") from error
    if selected.index is not None and selected.index >= len(clouds):
        raise InputError(f"{path}#{selected.index}: the file holds scans #0 to #{len(clouds) - 1}; choose one of them")
    label = "#{}" if len(clouds) > 1 else ""
    named = [
        NamedCloud(f"{path}{label.format(k)}", f"{path.stem}{label.format(k)}", cloud) for k, cloud in enumerate(clouds)
    ]
    if selected.index is not None:
        return [named[selected.index]], []
    kept = [cloud for cloud in named if len(cloud.cloud.points)]
    if not kept:
        raise InputError(f"{path}: no points in it; give a scan with at least one finite point")
    empty = [cloud for cloud in named if not len(cloud.cloud.points)]
    return kept, [f"{Path(cloud.where).name}: skipped, it has no points" for cloud in empty]


def _format_of(path: Path) -> Format:
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise InputError(
            f"unknown format {path.suffix or '(no suffix)'!r}; known formats are {', '.join(FORMATS)}"
        ) from None


def _content_of(path: Path) -> bytes:
    """The file's bytes, if they start as its suffix says."""
    try:
        if not path.is_file():
            raise InputError("it is not a regular file; give a file, a folder or a pattern")
        require_memory("the file", path.stat().st_size, "thin its points out first")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error}); check its permissions") from error
    if not content:
        raise InputError("the file is empty (0 bytes); write or copy it again")
    expected, kind = FORMATS[path.suffix.lower()].kind, _kind_of(content)
    if kind != expected:
        suffixes = [suffix for suffix, known in FORMATS.items() if known.kind == kind]
        hint = f"rename it to {' or '.join(suffixes)} if that is what it is" if suffixes else "write or copy it again"
        raise InputError(f"it is called {path.suffix} but holds {kind}; wanted {expected}: {hint}")
    return content


def _kind_of(content: bytes) -> str:
    """What the content is by its first bytes, whatever the file is called."""
    head = content[:_HEAD]
    kinds = (known.kind for known in FORMATS.values() if re.match(known.start, head))
    return next(kinds, "binary content of no known kind")
