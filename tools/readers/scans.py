"""Point cloud files to scans."""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from kernels.errors import InputError
from spectral.scan import Scan
from tools.readers.clouds.cloud import scan_of_cloud
from tools.readers.file import FORMATS, NamedCloud, clouds_of
from tools.readers.point_store import PointStore
from tools.readers.scan_sizes import strange_sizes
from tools.readers.selection import select_files

_ARRAYS = ("points", "strength", "viewpoints")  # of a scan


@dataclass(frozen=True, slots=True)
class Unread:
    """A file, or one scan of it, that could not be read.

    Attributes:
        where: the file, with #3 for one scan of several.
        reason: what is wrong with it and what to do, in words, the file named.
        before: index of the scan that follows it; the number of scans if none does.
    """

    where: str
    reason: str
    before: int


@dataclass(frozen=True, slots=True)
class ReadScans:
    """The scans that were read, and the files that could not be.

    Attributes:
        scans: in natural order of the files, and within a file in its own order.
        notes: what the user should know about the files, in words: dropped points, corrected strengths.
        files: all files that the paths name, in order.
        unread: what could not be read, in the same order.
        surveys: the number of each scan's survey, 0, 1, ...: the scans of a folder are one survey; if each scan has a
            folder of its own, all of them are one.
    """

    scans: tuple[Scan, ...]
    notes: tuple[str, ...]
    files: tuple[Path, ...]
    unread: tuple[Unread, ...] = ()
    surveys: tuple[int, ...] = ()


def read_scans(paths: Sequence[str | Path]) -> ReadScans:
    """Every scan of the files, folders and patterns in `paths`, in natural order.

    Like `read_survey`, but all of them have to be readable.

    Raises:
        InputError: naming the file and, where it applies, its line or packet.
    """
    read = read_survey(paths)
    if read.unread:
        raise InputError(read.unread[0].reason)
    return read


def read_survey(
    paths: Sequence[str | Path],
    not_scans: Collection[Path] = (),
    progress: Callable[[int, int, str], None] | None = None,
) -> ReadScans:
    """Every scan of the files, folders and patterns in `paths` that can be read, in natural order.

    `recording.sonar#3` is one scan of a file that holds several, counted from 0. Stamps are those of the files if all
    of them have one, otherwise 0, 1, 2, ... over the whole input, unreadable scans counted. A scan is named after its
    file, and `recording#3` if the file holds several; files of the same name in several folders keep their paths. The
    priors.csv of a folder or pattern is skipped, and so are the files in `not_scans`. The points of large surveys are
    on disk (`PointStore`). `progress` is called with (files read, files in all, the file's name).

    Raises:
        InputError: a path that does not exist, or no path at all.
    """
    notes: list[str] = []
    selection = select_files(paths, FORMATS, not_scans)
    if selection.reordered:
        notes.append("the scans are taken in the natural order of their names, not the order in which they were given")
    files = tuple(dict.fromkeys(selected.path for selected in selection.files))
    stems = Counter(path.stem for path in files)
    entries: list[_Entry] = []
    store = PointStore()
    for number, selected in enumerate(selection.files):
        named_by_path = stems[selected.path.stem] > 1
        try:
            for cloud in clouds_of(selected, notes):
                entries.append(_entry(_named_by_path(cloud) if named_by_path else cloud, store))
        except InputError as error:
            entries.append(_Entry(str(selected.path), "", reason=str(error)))
        if progress is not None:
            progress(number + 1, len(selection.files), selected.path.name)
    entries = _of_one_size(entries)
    stamps, stamp_notes = _stamps_of(entries)
    return _all_of(entries, stamps, notes + stamp_notes, files)


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
            f"{path} holds {len(scans)} scans ({scans[0].name} to {scans[-1].name}), and one is needed here: "
            "choose one, as in file.sonar#3, or map them all with `sonarmap map`"
        )
    return scans[0]


@dataclass(frozen=True, slots=True)
class _Entry:
    """A scan, or the place of one that could not be read.

    Attributes:
        where, name: of a `NamedCloud`, or the file's.
        scan: not stamped yet; None where it could not be read.
        stamp: that its file has for it, or None.
        is_cloud: whether the file has it, usable or not.
        notes: about its points.
        reason: why there is none.
    """

    where: str
    name: str
    scan: Scan | None = None
    stamp: float | None = None
    is_cloud: bool = False
    notes: tuple[str, ...] = ()
    reason: str = ""


def _entry(named: NamedCloud, store: PointStore) -> _Entry:
    """A cloud's usable points as a scan."""
    where, name, stamp = named.where, named.name, named.cloud.stamp
    try:
        scan, notes = scan_of_cloud(named.cloud, name, 0.0)
    except InputError as error:
        return _Entry(where, name, None, stamp, is_cloud=True, reason=f"{where}: {error}")
    kept = {field: store.keep(array) for field in _ARRAYS if (array := getattr(scan, field)) is not None}
    return _Entry(where, name, replace(scan, **kept), stamp, is_cloud=True, notes=tuple(notes))


def _of_one_size(entries: list[_Entry]) -> list[_Entry]:
    """The entries, without the scans that are in another unit than most."""
    usable = [k for k, entry in enumerate(entries) if entry.scan is not None]
    strange = strange_sizes([scan for entry in entries if (scan := entry.scan) is not None])
    reasons = {usable[k]: reason for k, reason in strange.items()}
    return [
        replace(entry, scan=None, reason=f"{entry.where}: {reasons[k]}") if k in reasons else entry
        for k, entry in enumerate(entries)
    ]


def _all_of(
    entries: Sequence[_Entry], stamps: Sequence[float], notes: Sequence[str], files: tuple[Path, ...]
) -> ReadScans:
    """The scans, stamped, and what could not be read."""
    scans: list[Scan] = []
    unread: list[Unread] = []
    all_notes = list(notes)
    folders: dict[Path, int] = {}
    surveys: list[int] = []
    for entry, stamp in zip(entries, stamps, strict=True):
        if entry.scan is None:
            unread.append(Unread(entry.where, entry.reason, len(scans)))
            continue
        scans.append(replace(entry.scan, stamp=stamp))
        surveys.append(folders.setdefault(Path(entry.where).parent, len(folders)))
        label = entry.name if entry.name == entry.where else Path(entry.where).name
        all_notes += [f"{label}: {note}" for note in entry.notes]
    if len(folders) == len(scans):
        surveys = [0] * len(scans)
    return ReadScans(tuple(scans), tuple(all_notes), files, tuple(unread), tuple(surveys))


def _stamps_of(entries: Sequence[_Entry]) -> tuple[list[float], list[str]]:
    """The clouds' own stamps if all of them have one, otherwise their positions in the input; and a note about it."""
    stamps = [entry.stamp for entry in entries if entry.is_cloud]
    without = stamps.count(None)
    if without == 0:
        return [entry.stamp or 0.0 for entry in entries], []
    note = f"{without} of {len(stamps)} scans have no time: all are stamped 0, 1, 2, ..."
    return [float(position) for position in range(len(entries))], [note] if without < len(stamps) else []


def _named_by_path(cloud: NamedCloud) -> NamedCloud:
    return replace(cloud, name=cloud.where)
