"""Reading scans from point cloud files of any format."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.sweep import Sweep, span_of
from sonarmap.spectral.point_store import PointStore
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.bags.clouds import moved
from sonarmap.tools.files.readers.clouds.axes import axes_matrix
from sonarmap.tools.files.readers.clouds.cloud import Bounds, Cloud, Note, PingPatch, refuse_other_unit, scan_of_cloud
from sonarmap.tools.files.readers.file import FORMATS, NamedCloud, clouds_of
from sonarmap.tools.files.readers.pings.line_file import AS_LINES, LineReading
from sonarmap.tools.files.readers.selection import Selection, select_files
from sonarmap.tools.files.time_scales import by_clock, years_apart

Progress = Callable[[int, int, str], None]

_ARRAYS = ("points", "strength", "viewpoints", "times")  # array attributes of a scan
_TEXTS = (".txt", ".csv")  # suffixes of text files, which may hold points or anything else
_SHOWN = 100  # progress is reported after this number of scans of a file
SOUND_SPEEDS = (1000.0, 2000.0)  # accepted range [m/s]; in water it is 1400 to 1600
# Name -> meters. The US survey foot is 1200/3937 m.
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200 / 3937}


@dataclass(frozen=True, slots=True)
class PointFrame:
    """The axes and the unit of the points in files."""

    # a name for `axes_matrix`; None for the axes that the file states, or flu if it states none
    axes: str | None = None
    unit: str | None = None  # a name of UNITS; None for meters that nobody named

    def __post_init__(self) -> None:
        if self.axes is not None:
            axes_matrix(self.axes)
        if self.unit is not None and self.unit not in UNITS:
            raise InputError(f"{self.unit!r} is not known; choose one of {', '.join(UNITS)}")

    def turned(self, cloud: Cloud) -> Cloud:
        """The cloud with points and viewpoints in meters, x forward, y left, z up."""
        axes = self.axes or cloud.axes
        if axes != "flu" or self.unit not in (None, "m"):
            viewpoints = None if cloud.viewpoints is None else self._turned(cloud.viewpoints, axes)
            cloud = replace(cloud, points=self._turned(cloud.points, axes), viewpoints=viewpoints)
        return cloud if cloud.T_base_flu is None else moved(cloud, cloud.T_base_flu)

    def _turned(self, points: np.ndarray, axes: str) -> np.ndarray:
        R_flu_file = axes_matrix(axes)
        with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite are dropped later
            # columns are permuted, as a matrix product would spread NaN over the other axes
            columns = points[:, np.abs(R_flu_file).argmax(axis=1)].astype(np.float64)
            return columns * (R_flu_file.sum(axis=1) * UNITS[self.unit or "m"])


AS_THE_FILE_SAYS = PointFrame()


@dataclass(frozen=True, slots=True)
class Corrections:
    """Corrections of the points of scans."""

    # true speed of sound [m/s]: ranges are multiplied by its ratio to the recorded one; None for no correction
    sound_speed: float | None = None
    scale: float = 1.0  # further factor on ranges, for any format
    frame: PointFrame = AS_THE_FILE_SAYS  # axes and unit of the points in files
    lines: LineReading = AS_LINES  # how lines of pings are divided into scans
    bounds: Bounds = field(default_factory=Bounds)  # which points are used, in the corrected frame and unit

    def __post_init__(self) -> None:
        low, high = SOUND_SPEEDS
        if self.sound_speed is not None and not low <= self.sound_speed <= high:
            raise InputError(
                f"`sound_speed={self.sound_speed:g}` is not a speed of sound in water; wanted {low:g} to {high:g} m/s"
            )
        if not (0 < self.scale < math.inf):
            raise InputError(f"`range_scale={self.scale:g}` is not a factor; wanted a number above 0, as 1.02")

    def question(self, cloud: Cloud) -> str:
        """Why the axes of the points are not known, and what to do; "" if they are."""
        return cloud.question if self.frame.axes is None else ""

    def corrected(self, cloud: Cloud) -> Cloud:
        """The cloud in forward-left-up axes and meters, with ranges from its viewpoints corrected."""
        cloud, factor = self.frame.turned(cloud), self.scale
        if self.sound_speed is not None:
            if cloud.sound_speed is None:
                raise InputError("it does not say the speed of sound of its ranges; give `range_scale` instead")
            factor *= self.sound_speed / cloud.sound_speed
        if factor == 1.0:
            return cloud
        if cloud.viewpoints is None:
            return replace(cloud, points=factor * cloud.points)
        return replace(cloud, points=cloud.viewpoints + factor * (cloud.points - cloud.viewpoints))

    def scan(self, cloud: Cloud, name: str) -> tuple[Scan, list[Note]]:
        """The corrected scan of a cloud within the bounds, with the stamp 0, and notes about its points."""
        scan, notes = scan_of_cloud(self.corrected(cloud), name, 0.0, self.bounds)
        if self.frame.unit is None and cloud.patch is None:
            refuse_other_unit(scan.points)
        return scan, notes


AS_RECORDED = Corrections()


@dataclass(frozen=True, slots=True)
class Unread:
    where: str  # the file, with #3 for one scan of several
    reason: str  # message with the file, what is wrong and what to do
    before: int  # index of the scan that follows it; the number of scans if none does


@dataclass(frozen=True, slots=True)
class ReadScans:
    """The scans that were read, and the files that could not be."""

    scans: tuple[Scan, ...]  # in natural order of the files, and within a file in its own order
    notes: tuple[str, ...]  # messages about the files: dropped points, corrected strengths, and the faults
    faults: tuple[str, ...]  # what is wrong with the stamps of scans and the times of points
    files: tuple[Path, ...]  # all files that the paths name, in order
    unread: tuple[Unread, ...] = ()  # unreadable files and scans, in the same order
    # survey of each scan, 0, 1, ...: a folder is one survey, or all scans are if each is in a folder of its own
    surveys: tuple[int, ...] = ()
    # {scan: patch} of scans that are patches of survey lines; each line is a survey
    patches: Mapping[int, PingPatch] = field(default_factory=dict[int, PingPatch])


def read_scans(paths: Sequence[str | Path], corrections: Corrections = AS_RECORDED) -> ReadScans:
    """Read every scan of the files, folders and patterns in `paths`, like `read_survey`. Raises InputError: a file or
    scan cannot be read."""
    read = read_survey(paths, corrections=corrections)
    if read.unread:
        raise InputError(read.unread[0].reason)
    return read


def read_survey(
    paths: Sequence[str | Path],
    not_scans: Collection[Path] = (),
    progress: Progress | None = None,
    corrections: Corrections = AS_RECORDED,
    correct_times: bool = True,
) -> ReadScans:
    """Read every readable scan of the files, folders and patterns in `paths`, in natural order; `recording.sonar#3` is
    scan 3, counted from 0, of a file that holds several.

    Stamps are those of the files if all scans have one, otherwise 0, 1, 2, ... over the whole input, including
    unreadable scans. A scan is named after its file, and `recording#3` if the file holds several; files with the same
    name in several folders are named by their paths. The priors.csv of a folder or pattern and the files in `not_scans`
    are skipped. The points of large surveys are kept on disk (`PointStore`). `progress` is called with (files read,
    number of files, file name), and within a file every 100 scans. `corrections` are applied to all points.
    `correct_times`: points' times in another unit become seconds.
    """
    notes: list[str] = []
    selection = select_files(paths, FORMATS, not_scans)
    store = PointStore()
    entries = list[ScanEntry]()
    for entry in read_entries(selection, notes, progress, corrections):
        if entry.question:
            raise InputError(f"{entry.where}: {entry.question}")
        entries.append(_kept(entry, store))
    times, are_clouds = [entry.stamp for entry in entries], [entry.is_cloud for entry in entries]
    stamps, stamp_notes = stamps_of(times, are_clouds)
    sweep = Sweep.of([span_of(entry.scan) for entry in entries], times) if correct_times else Sweep()
    if correct_times:
        entries = [replace(entry, scan=sweep.in_seconds(entry.scan, store)) for entry in entries]
    return _all_of(entries, stamps, notes, (*stamp_notes, *sweep.notes), files_of(selection))


def files_of(selection: Selection) -> tuple[Path, ...]:
    """All files of a selection, each once, including those in ROS 2 bag folders."""
    paths = dict.fromkeys(selected.path for selected in selection.files)
    return tuple(file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path]))


def read_scan(path: str | Path) -> Scan:
    """Read the only scan of a file, or one of several, as `recording.sonar#3`."""
    return only_scan(path, read_scans([path]))


def only_scan(path: str | Path, read: ReadScans) -> Scan:
    """The only scan read from `path`. Raises InputError: there are several."""
    first, last = read.scans[0], read.scans[-1]
    if len(read.scans) > 1:
        raise InputError(
            f"{path} holds {len(read.scans)} scans ({first.name} to {last.name}); choose one, as in file.sonar#3"
        )
    return first


@dataclass(frozen=True, slots=True)
class ScanEntry:
    """A scan that was read, or could not be read."""

    path: Path  # path, where, name: of a `NamedCloud`, or of the file
    where: str
    name: str
    scan: Scan | None = None  # the scan without its final stamp; None if it could not be read
    stamp: float | None = None  # time in the file [s, UTC], or None
    is_cloud: bool = False  # whether it is a cloud in a file, usable or not, rather than an unreadable file
    notes: tuple[Note, ...] = ()  # about its points
    reason: str = ""  # why it could not be read
    sound_speed: float | None = None  # recorded speed of sound [m/s], or None
    patch: PingPatch | None = None  # the pings it is made of, or None
    question: str = ""  # why its axes are not known, and what to do


def read_entries(
    selection: Selection, notes: list[str], progress: Progress | None = None, corrections: Corrections = AS_RECORDED
) -> Iterator[ScanEntry]:
    """Yield an entry for every scan of the files, and for every file that cannot be read. Messages about whole files
    are appended to `notes`; other arguments as in `read_survey`."""
    if selection.reordered:
        notes.append("the scans are taken in the natural order of their names, not the order in which they were given")
    notes += [f"{path} is given more than once, and used once" for path in selection.repeated]
    notes.extend(selection.passed_over)
    files = files_of(selection)
    _require_known(files, corrections)
    stems = Counter(path.stem for path, _ in {(selected.path, selected.topic) for selected in selection.files})
    for number, selected in enumerate(selection.files):
        named_by_path = stems[selected.path.stem] > 1
        try:
            for count, cloud in enumerate(clouds_of(selected, notes, corrections.lines), start=1):
                yield _entry(replace(cloud, name=cloud.where) if named_by_path else cloud, corrections)
                if progress is not None and count % _SHOWN == 0:
                    progress(number, len(selection.files), f"{selected.path.name}: {count:,} scans")
        except InputError as error:
            # a text file without points, such as a README.txt or a log, beside scans of another format
            is_text = selected.path.suffix.lower() in _TEXTS
            if is_text and any(path.suffix.lower() not in _TEXTS for path in files):
                notes.append(f"{selected.path} holds no points, and the scans are in another format: it is left out")
            else:
                yield ScanEntry(selected.path, selected.place, "", reason=str(error))
        if progress is not None:
            progress(number + 1, len(selection.files), selected.path.name)


def _require_known(files: Sequence[Path], corrections: Corrections) -> None:
    """Raise InputError for corrections that do not apply to a file's format."""
    for path in files:
        if (known := FORMATS.get(path.suffix.lower())) is None:
            continue
        if known.has_axes and corrections.frame != AS_RECORDED.frame:
            raise InputError(f"{path}: `frame` and `units` cannot be used; {known.kind} defines both")
        if known.is_line and corrections.scale != 1.0:
            raise InputError(f"{path}: `range_scale` cannot be used, as {known.kind} has soundings and no ranges")
        if corrections.sound_speed is not None and not known.has_sound_speed:
            raise InputError(f"{path}: `sound_speed` cannot be used, as {known.kind} has no speed; give `range_scale`")


def _entry(named: NamedCloud, corrections: Corrections) -> ScanEntry:
    """The entry of a cloud, with its usable points as a scan."""
    path, where, name, cloud = named.path, named.where, named.name, named.cloud
    question = corrections.question(cloud)
    try:
        scan, notes = corrections.scan(cloud, name)
    except InputError as error:
        return ScanEntry(path, where, name, None, cloud.stamp, is_cloud=True, reason=f"{where}: {error}")
    return ScanEntry(
        path, where, name, scan, cloud.stamp, True, tuple(notes), "", cloud.sound_speed, cloud.patch, question
    )


def _kept(entry: ScanEntry, store: PointStore) -> ScanEntry:
    """The entry with its arrays moved to the point store."""
    if entry.scan is None:
        return entry
    kept = {field: store.keep(array) for field in _ARRAYS if (array := getattr(entry.scan, field)) is not None}
    # pyrefly: ignore[bad-argument-type]
    return replace(entry, scan=replace(entry.scan, **kept))


def _all_of(
    entries: Sequence[ScanEntry],
    stamps: Sequence[float],
    notes: Sequence[str],
    faults: tuple[str, ...],
    files: tuple[Path, ...],
) -> ReadScans:
    """The result of entries and their stamps."""
    scans: list[Scan] = []
    unread: list[Unread] = []
    folders: dict[Path, int] = {}
    surveys: list[int] = []
    patches: dict[int, PingPatch] = {}
    for entry, stamp in zip(entries, stamps, strict=True):
        if entry.scan is None:
            unread.append(Unread(entry.where, entry.reason, len(scans)))
            continue
        scans.append(replace(entry.scan, stamp=stamp))
        if entry.patch is not None:
            patches[len(scans) - 1] = entry.patch
        folder = entry.path if entry.patch is not None or entry.path.is_dir() else entry.path.parent
        surveys.append(folders.setdefault(folder, len(folders)))
    if len(folders) == len(scans):
        surveys = [0] * len(scans)
    said = (*notes, *faults, *notes_about(entries))
    return ReadScans(tuple(scans), said, faults, files, tuple(unread), tuple(surveys), patches)


def notes_about(entries: Iterable[ScanEntry]) -> list[str]:
    """The notes about the points of scans, each once, with the sum of its counts."""
    labels, sums = dict[str, list[str]](), dict[str, Note]()
    for entry in entries:
        in_file = entry.path.name + entry.where.removeprefix(str(entry.path))
        for note in entry.notes:
            labels.setdefault(note.words, []).append(entry.name if entry.name == entry.where else in_file)
            before = sums.get(note.words, Note(note.words))
            sums[note.words] = Note(note.words, before.count + note.count, before.total + note.total)
    return [f"{of[0]}{f' and {len(of) - 1:,} more' * (len(of) > 1)}: {sums[words]}" for words, of in labels.items()]


def stamps_of(own: Sequence[float | None], are_clouds: Sequence[bool]) -> tuple[list[float], list[str]]:
    """Stamps [s] of the scans: their `own` if all clouds have one, otherwise their indices, and a note if only some
    have none. `are_clouds`: which entries are clouds, usable or not."""
    stamps = [stamp for stamp, is_cloud in zip(own, are_clouds, strict=True) if is_cloud]
    without = stamps.count(None)
    if without == 0:
        times = np.array([stamp for stamp in stamps if stamp is not None])
        first, *others = by_clock(times)
        notes = [
            f"the stamps of {len(rows)} of {len(stamps)} scans are {years_apart(times[rows], times[first])} those of "
            "the others; if these are not two surveys, a clock was not set: leave some out, or correct their times"
            for rows in others
        ]
        return [stamp or 0.0 for stamp in own], notes
    note = f"{without} of {len(stamps)} scans have no time: all are stamped 0, 1, 2, ..."
    return [float(position) for position in range(len(own))], [note] if without < len(stamps) else []
