"""Point cloud files to scans."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from kernels.errors import InputError
from spectral.scan import Scan
from tools.readers.clouds.cloud import scan_of_cloud
from tools.readers.file import FORMATS, Found, read_file
from tools.readers.selection import select_files


@dataclass(frozen=True, slots=True)
class Unread:
    """A file, or one scan of it, that could not be read.

    Attributes:
        where: the file, with #3 for one scan of several.
        reason: what is wrong with it and what to do, in words, the file named.
        before: index of the scan that follows it, the number of scans where it is the last.
    """

    where: str
    reason: str
    before: int


@dataclass(frozen=True, slots=True)
class ReadScans:
    """What was read.

    Attributes:
        scans: in natural order of the files, and within a file in its own.
        notes: what the user should know about the files, in words: points dropped, strengths mended.
        files: all files that were meant, in their order.
        unread: what could not be read, in the same order.
        surveys: the number of each scan's survey, 0, 1, ...: the scans of one folder are of one survey; where each has
            a folder of its own all are of one.
    """

    scans: tuple[Scan, ...]
    notes: tuple[str, ...]
    files: tuple[Path, ...]
    unread: tuple[Unread, ...] = ()
    surveys: tuple[int, ...] = ()


def read_scans(paths: Sequence[str | Path]) -> ReadScans:
    """Every scan of the files, folders and patterns in `paths`, in natural order.

    As `read_survey`, but all of them have to be readable.

    Raises:
        InputError: naming the file and, where it applies, its line or packet.
    """
    read = read_survey(paths)
    if read.unread:
        raise InputError(read.unread[0].reason)
    return read


def read_survey(paths: Sequence[str | Path], beside: Collection[Path] = ()) -> ReadScans:
    """Every scan of the files, folders and patterns in `paths` that can be read, in natural order.

    `recording.sonar#3` is one scan of a file that holds several, counted from 0. Stamps are those of the
    files where all of them carry one, else 0, 1, 2, ... over the whole input, unreadable ones counted. A scan is
    named after its file, and `recording#3` where the file holds several; files of one name in several folders keep
    their paths. A folder's or pattern's priors.csv, and files `beside` the scans, are passed over.

    Raises:
        InputError: a path that does not exist, or no path at all.
    """
    notes: list[str] = []
    selection = select_files(paths, FORMATS, beside)
    if selection.reordered:
        notes.append("the scans are taken in the natural order of their names, not the order in which they were given")
    files = tuple(dict.fromkeys(selected.path for selected in selection.files))
    stems = Counter(path.stem for path in files)
    found: list[Found | _Faulty] = []
    for selected in selection.files:
        try:
            clouds, told = read_file(selected)
        except InputError as error:
            found.append(_Faulty(str(selected.path), str(error)))
            continue
        found += [_called_by_path(cloud) for cloud in clouds] if stems[selected.path.stem] > 1 else clouds
        notes += told
    stamps, told = _stamps_of(found)
    return _checked(found, stamps, notes + told, files)


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


@dataclass(frozen=True, slots=True)
class _Faulty:
    """What stands in the place of a file that could not be read."""

    where: str
    reason: str


def _checked(
    found: Sequence[Found | _Faulty], stamps: Sequence[float], notes: Sequence[str], files: tuple[Path, ...]
) -> ReadScans:
    """The scans of the clouds that have usable points."""
    scans: list[Scan] = []
    unread: list[Unread] = []
    told = list(notes)
    folders: dict[Path, int] = {}
    surveys: list[int] = []
    for one, stamp in zip(found, stamps, strict=True):
        if isinstance(one, _Faulty):
            unread.append(Unread(one.where, one.reason, len(scans)))
            continue
        try:
            scan, mended = scan_of_cloud(one.cloud, one.name, stamp)
        except InputError as error:
            unread.append(Unread(one.where, f"{one.where}: {error}", len(scans)))
            continue
        scans.append(scan)
        surveys.append(folders.setdefault(Path(one.where).parent, len(folders)))
        told += [f"{one.name if one.name == one.where else Path(one.where).name}: {note}" for note in mended]
    if len(folders) == len(scans):
        surveys = [0] * len(scans)
    return ReadScans(tuple(scans), tuple(told), files, tuple(unread), tuple(surveys))


def _stamps_of(found: Sequence[Found | _Faulty]) -> tuple[list[float], list[str]]:
    """The clouds' own stamps where all of them carry one, else their places; and what to tell of it."""
    own = [one.cloud.stamp for one in found if isinstance(one, Found)]
    untimed = own.count(None)
    if untimed == 0:
        return [(one.cloud.stamp or 0.0) if isinstance(one, Found) else 0.0 for one in found], []
    mixed = f"{untimed} of {len(own)} scans carry no time: all are stamped 0, 1, 2, ..."
    return [float(place) for place in range(len(found))], [mixed] if untimed < len(own) else []


def _called_by_path(found: Found) -> Found:
    return replace(found, name=found.where)
