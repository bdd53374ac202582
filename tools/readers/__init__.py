"""Point cloud files to scans. A new format is a file here and a row of FORMATS."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from kernels.errors import InputError
from spectral.scan import Scan
from tools.readers import content as kinds
from tools.readers.cloud import Cloud, scan_of_cloud
from tools.readers.npy import read_npy
from tools.readers.npz import read_npz
from tools.readers.pcd import read_pcd
from tools.readers.ply import read_ply
from tools.readers.selection import Selected, select_files
from tools.readers.text import read_text


@dataclass(frozen=True, slots=True)
class Format:
    """What a file of one suffix must begin like, and who reads it."""

    kind: str
    read: Callable[[bytes], list[Cloud]]


def _read_sonar(content: bytes) -> list[Cloud]:
    from tools.readers.sonar import read_sonar  # wlsonar brings an HTTP client: a third of a second

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
class ReadScans:
    """What was read.

    Attributes:
        scans: in natural order of the files, and within a file in its own.
        notes: what the user should know about the files, in words: points dropped, strengths mended.
        files: the files that were read, in their order.
    """

    scans: tuple[Scan, ...]
    notes: tuple[str, ...]
    files: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class _Found:
    """A cloud, where it comes from, for messages, and the name of its scan."""

    where: str
    name: str
    cloud: Cloud


def read_scans(paths: Sequence[str | Path]) -> ReadScans:
    """Every scan of the files, folders and patterns in `paths`, in natural order.

    `recording.sonar#3` is one scan of a file that holds several, counted from 0. Stamps are those of the
    files where all of them carry one, else 0, 1, 2, ... over the whole input. A scan is named after its
    file, and `recording#3` where the file holds several; files of one name in several folders keep their paths.

    Raises:
        InputError: naming the file and, where it applies, its line or packet.
    """
    found: list[_Found] = []
    notes: list[str] = []
    chosen = select_files(paths, FORMATS)
    files = tuple(dict.fromkeys(selected.path for selected in chosen))
    stems = Counter(path.stem for path in files)
    for selected in chosen:
        clouds, told = _read_file(selected)
        found += [_called_by_path(cloud) for cloud in clouds] if stems[selected.path.stem] > 1 else clouds
        notes += told
    timed = [one.cloud.stamp for one in found if one.cloud.stamp is not None]
    if 0 < len(timed) < len(found):
        notes.append(f"{len(found) - len(timed)} of {len(found)} scans carry no time: all are stamped 0, 1, 2, ...")
    stamps = timed if len(timed) == len(found) else [float(order) for order in range(len(found))]
    scans: list[Scan] = []
    for one, stamp in zip(found, stamps, strict=True):
        try:
            scan, told = scan_of_cloud(one.cloud, one.name, stamp)
        except InputError as error:
            raise InputError(f"{one.where}: {error}") from error
        scans.append(scan)
        notes += [f"{one.name if one.name == one.where else Path(one.where).name}: {note}" for note in told]
    return ReadScans(tuple(scans), tuple(notes), files)


def read_scan(path: str | Path) -> Scan:
    """The scan of a file that holds one, or one of several as `recording.sonar#3`.

    Raises:
        InputError: as `read_scans`, and where there are several.
    """
    return only_scan(path, read_scans([path]))


def only_scan(path: str | Path, read: ReadScans) -> Scan:
    """The one scan that was read from `path`; InputError where there are several."""
    scans = read.scans
    if len(scans) != 1:
        raise InputError(
            f"{path} holds {len(scans)} scans ({scans[0].name} to {scans[-1].name}) and one is wanted here: "
            "choose one of a recording as in file.sonar#3, or chain them all with `sonarmap map`"
        )
    return scans[0]


def _called_by_path(found: _Found) -> _Found:
    return replace(found, name=found.where)


def _read_file(selected: Selected) -> tuple[list[_Found], list[str]]:
    """The clouds of one file that hold points, and notes about those that do not."""
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
    found = [_Found(f"{path}{label.format(i)}", f"{path.stem}{label.format(i)}", c) for i, c in enumerate(clouds)]
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
