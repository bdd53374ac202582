"""Scans while they come: of files that grow, and of finished ones at the pace at which they were taken."""

import math
import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.bags.clouds import CLOUD_KINDS, stream_recording
from sonarmap.tools.files.readers.bags.open import open_recording
from sonarmap.tools.files.readers.clouds.cloud import scan_of_cloud
from sonarmap.tools.files.readers.scans import FORMATS, Corrections, read_survey
from sonarmap.tools.files.readers.selection import is_bag_folder, natural_key, select_files
from sonarmap.tools.files.readers.sonar.recording import Recording

RECORDING, MCAP = ".sonar", ".mcap"
GROWING = (RECORDING, MCAP)  # files that give scans while they are written
_PART = re.compile(r"\.part(\d*)(?=\.sonar$)")  # in the name of a recording that goes on
_LOOKS = 0.02  # between looks at a file that grows [s]
_LOOKS_FOR_FILES = 0.3  # between looks at a folder; a file that did not change meanwhile is whole [s]


@dataclass(frozen=True, slots=True)
class Mark:
    """How far an input was read."""

    file: str = ""  # name of the file; "" for none
    count: int = 0  # bytes of it that were read, or scans, or messages
    shots: int = 0  # of a recording that were read


@dataclass(frozen=True, slots=True)
class Incoming:
    scan: Scan
    behind: Mark  # from which reading can go on
    missing: int = 0  # shots that did not come, by their numbers, so far


def incoming(
    source: Path, corrections: Corrections, ended: Callable[[], bool], after: Mark = Mark()
) -> Iterator[Incoming]:
    """Scans of a recording, an MCAP file or a folder that grows, as they come, until it has `ended`; those after a
    mark. Files of a folder follow one another by their names. Unusable scans and, of the folder, unreadable files are
    left out."""
    if source.is_file() and source.suffix.lower() in GROWING:
        yield from _of_growing(source, corrections, lambda: not ended() and source.exists(), after)
    else:
        yield from _of_folder(source, corrections, ended, after)


def final_path(path: Path) -> Path:
    """Where a recording is that may have been given its name at its end."""
    return path if path.exists() else path.with_name(_final_name(path))


def _of_folder(folder: Path, corrections: Corrections, ended: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    stamp = float("-inf")  # of the last file's scan: of files without times, scans are counted
    passed, missing = "", 0  # name of the last file that is done, and what is missing in those that are
    sizes: dict[str, tuple[int, int] | None] = {}
    unreadable: tuple[int, int] | None = None  # size of the last file, as of which it could not be read
    while not ended():
        files = {name: path for name, path in _files(folder).items() if _follows(name, passed, after.file)}
        before, sizes = sizes, {name: _size(path) for name, path in files.items()}
        for name, path in files.items():
            begin, here = after if name == after.file else Mark(name), 0
            is_recording, is_last = path.suffix.lower() in GROWING, name == next(reversed(files))
            size = sizes[name]
            if is_recording:
                scans = _of_growing(path, corrections, partial(_is_last, folder, name, ended), begin)
            elif size is not None and size == before.get(name) and not (is_last and size == unreadable):
                scans = _of_file(path, corrections, begin)
            else:
                break
            try:
                for each in scans:
                    after, here = each.behind, each.missing
                    if not is_recording:
                        stamp = each.scan.stamp if each.scan.stamp > stamp else stamp + 1
                        each = replace(each, scan=replace(each.scan, stamp=stamp))
                    yield replace(each, missing=missing + here)
            except InputError:
                if is_recording and path.exists():
                    raise
                if is_recording or is_last:  # it was renamed, or its writer pauses
                    unreadable = size
                    break
            passed, missing, unreadable = name, missing + here, None
            if ended():
                return
        time.sleep(_LOOKS_FOR_FILES)


def replayed(
    inputs: Sequence[str], corrections: Corrections, factor: float, ended: Callable[[], bool], after: Mark = Mark()
) -> Iterator[Incoming]:
    """Scans of finished files, so many times faster than they were taken, or all at once for a factor of 0."""
    scans = _read(inputs, corrections)
    start, begun = scans[min(after.count, len(scans) - 1)].stamp, time.monotonic()
    for number, scan in enumerate(scans[after.count :], after.count + 1):
        due = begun + (scan.stamp - start) / factor if factor > 0 else begun
        while (left := due - time.monotonic()) > 0 and not ended():
            time.sleep(min(left, _LOOKS_FOR_FILES))
        if ended():
            return
        yield Incoming(scan, Mark("", number))


def _of_growing(path: Path, corrections: Corrections, grows: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    """What is there when it no longer grows comes too."""
    is_last = False

    def more() -> bool:
        nonlocal is_last
        if is_last:
            return False
        time.sleep(_LOOKS)
        is_last = not grows()  # what came before it ended is read once more
        return True

    scans = _of_recording if path.suffix.lower() == RECORDING else _of_mcap
    yield from scans(path, corrections, more, after)


def _of_mcap(path: Path, corrections: Corrections, more: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    while not _has_clouds(path):
        if not more():
            return
    for number, cloud in enumerate(stream_recording(path, None, [], more)):
        if number < after.count:
            continue
        try:
            scan, _ = scan_of_cloud(corrections.corrected(cloud), f"{path.stem}#{number}", 0.0)
        except InputError:  # a message that cannot be used
            continue
        stamp = float(number) if cloud.stamp is None else cloud.stamp
        yield Incoming(replace(scan, stamp=stamp), Mark(after.file, number + 1))


def _has_clouds(path: Path) -> bool:
    """Whether there is a cloud in an MCAP file yet."""
    try:
        return bool(open_recording(path, []).of_kinds(CLOUD_KINDS))
    except InputError:
        return False


def _of_recording(path: Path, corrections: Corrections, more: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    recording, latest = Recording(), -1
    name = Path(_final_name(path)).stem
    for number, shot in enumerate(recording.read(path, 0, more, after.count), after.shots):
        if shot.place <= latest:  # it came late
            continue
        latest = shot.place
        try:
            scan, _ = scan_of_cloud(corrections.corrected(recording.cloud(shot)), f"{name}#{number}", 0.0)
        except InputError:  # without an echo
            continue
        stamp = float(number) if shot.frame.stamp is None else shot.frame.stamp
        behind = Mark(after.file, recording.read_until, number + 1)
        yield Incoming(replace(scan, stamp=stamp), behind, recording.queue.numbers.missing)


def _of_file(path: Path, corrections: Corrections, after: Mark) -> Iterator[Incoming]:
    scans = _read([path], corrections)[after.count :]
    yield from (Incoming(scan, Mark(path.name, number)) for number, scan in enumerate(scans, after.count + 1))


def _read(inputs: Sequence[str | Path], corrections: Corrections) -> Sequence[Scan]:
    """The scans of finished files, of which there is one at least."""
    read = read_survey(inputs, corrections=corrections)
    if not read.scans:
        raise InputError(f"no scan can be read: {read.unread[0].reason}")
    return read.scans


def _files(folder: Path) -> dict[str, Path]:
    """The files with scans in a folder, in natural order, by the names that they have or will have at last."""
    try:
        # a bag that has ended meanwhile
        looked = sorted(folder.glob(f"*{MCAP}")) if is_bag_folder(folder) else [folder]
        paths = [selected.path for selected in select_files(looked, FORMATS).files]
    except InputError:  # none yet
        return {}
    named: dict[str, Path] = {}
    for path in sorted(paths, key=lambda path: (natural_key(_final_name(path)), _number(path))):
        name = first = _final_name(path)
        while name in named:  # of a recording that was cut, and the one after it
            name = f"{first}~{name.count('~') + 2}"
        named[name] = path
    return named


def _final_name(path: Path) -> str:
    return _PART.sub("", path.name)


def _number(path: Path) -> float:
    """Of a recording among those of one name: the one that has its name at last was the last."""
    part = _PART.search(path.name)
    return math.inf if part is None else int(part[1] or 1)


def _follows(name: str, passed: str, begin: str) -> bool:
    """Whether a file comes after the one that was passed, and not before the one with which to begin."""
    key, last, first = ((natural_key(each), each) for each in (name, passed, begin))
    return key >= first and (not passed or key > last)


def _size(path: Path) -> tuple[int, int] | None:
    """What changes with a file; None if it has gone."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def _is_last(folder: Path, name: str, ended: Callable[[], bool]) -> bool:
    return not ended() and next(reversed(_files(folder)), name) == name
