"""Live input of scans from files that are being written, and replay of finished files at their recorded rate."""

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
from sonarmap.tools.files.readers.scans import FORMATS, Corrections, read_survey
from sonarmap.tools.files.readers.selection import is_bag_folder, natural_key, select_files
from sonarmap.tools.files.readers.sonar.recording import Recording

RECORDING, MCAP = ".sonar", ".mcap"
GROWING = (RECORDING, MCAP)  # suffixes of files from which scans can be read while they are written
_PART = re.compile(r"\.part(\d*)(?=\.sonar$)")  # part of the name of an unfinished recording
_POLL_INTERVAL = 0.02  # interval between checks of a growing file [s]
_FOLDER_INTERVAL = 0.3  # interval between checks of a folder; a file unchanged for this long is complete [s]


@dataclass(frozen=True, slots=True)
class Mark:
    """The position in an input up to which it was read."""

    file: str = ""  # name of the file; "" for none
    count: int = 0  # bytes, scans or messages of the file that were read
    shots: int = 0  # shots of a recording that were read


@dataclass(frozen=True, slots=True)
class Incoming:
    scan: Scan
    behind: Mark  # position at which reading can continue
    missing: int = 0  # shots missing, by gaps in their numbers


def incoming(
    source: Path, corrections: Corrections, ended: Callable[[], bool], after: Mark = Mark()
) -> Iterator[Incoming]:
    """Yield the scans of a growing recording, MCAP file or folder as they appear, starting after a mark, until
    `ended()`. Files of a folder are read in the order of their names. Unusable scans, and unreadable files of a folder,
    are skipped."""
    if source.is_file() and source.suffix.lower() in GROWING:
        yield from _of_growing(source, corrections, lambda: not ended() and source.exists(), after)
    else:
        yield from _of_folder(source, corrections, ended, after)


def final_path(path: Path) -> Path:
    """The path of a recording that may have been renamed when it was finished."""
    return path if path.exists() else path.with_name(_final_name(path))


def _of_folder(folder: Path, corrections: Corrections, ended: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    stamp = float("-inf")  # last stamp; scans of files without times continue it in steps of 1
    passed, missing = "", 0  # name of the last finished file, and number of shots missing in finished files
    sizes: dict[str, tuple[int, int] | None] = {}
    unreadable: tuple[int, int] | None = None  # size at which the last file could not be read
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
                for item in scans:
                    after, here = item.behind, item.missing
                    if not is_recording:
                        stamp = item.scan.stamp if item.scan.stamp > stamp else stamp + 1
                        item = replace(item, scan=replace(item.scan, stamp=stamp))
                    yield replace(item, missing=missing + here)
            except InputError:
                if is_recording and path.exists():
                    raise
                if is_recording or is_last:  # the file was renamed, or its writer pauses
                    unreadable = size
                    break
            passed, missing, unreadable = name, missing + here, None
            if ended():
                return
        time.sleep(_FOLDER_INTERVAL)


def replayed(
    inputs: Sequence[str], corrections: Corrections, factor: float, ended: Callable[[], bool], after: Mark = Mark()
) -> Iterator[Incoming]:
    """Yield the scans of finished files at `factor` times their recorded rate, or at once for a factor of 0."""
    scans = _read(inputs, corrections)
    start, begun = scans[min(after.count, len(scans) - 1)].stamp, time.monotonic()
    for number, scan in enumerate(scans[after.count :], after.count + 1):
        due = begun + (scan.stamp - start) / factor if factor > 0 else begun
        while (remaining := due - time.monotonic()) > 0 and not ended():
            time.sleep(min(remaining, _FOLDER_INTERVAL))
        if ended():
            return
        yield Incoming(scan, Mark("", number))


def _of_growing(path: Path, corrections: Corrections, grows: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    """Scans of a growing file, including those that are written before it stops growing."""
    is_last = False

    def more() -> bool:
        nonlocal is_last
        if is_last:
            return False
        time.sleep(_POLL_INTERVAL)
        is_last = not grows()  # if it has stopped growing, read what was written meanwhile, then end
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
        if question := corrections.question(cloud):
            raise InputError(f"{path}: {question}")
        try:
            scan, _ = corrections.scan(cloud, f"{path.stem}#{number}")
        except InputError:  # an unusable message
            continue
        stamp = float(number) if cloud.stamp is None else cloud.stamp
        yield Incoming(replace(scan, stamp=stamp), Mark(after.file, number + 1))


def _has_clouds(path: Path) -> bool:
    """Whether an MCAP file holds a cloud yet."""
    try:
        return bool(open_recording(path).of_kinds(CLOUD_KINDS))
    except InputError:
        return False


def _of_recording(path: Path, corrections: Corrections, more: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    recording, latest = Recording(), -1
    name = Path(_final_name(path)).stem
    for number, shot in enumerate(recording.read(path, 0, more, after.count), after.shots):
        if shot.place <= latest:  # out of order
            continue
        latest = shot.place
        try:
            scan, _ = corrections.scan(recording.cloud(shot), f"{name}#{number}")
        except InputError:  # without an echo
            continue
        stamp = float(number) if shot.frame.stamp is None else shot.frame.stamp
        behind = Mark(after.file, recording.read_until, number + 1)
        yield Incoming(replace(scan, stamp=stamp), behind, recording.queue.numbers.missing)


def _of_file(path: Path, corrections: Corrections, after: Mark) -> Iterator[Incoming]:
    scans = _read([path], corrections)[after.count :]
    yield from (Incoming(scan, Mark(path.name, number)) for number, scan in enumerate(scans, after.count + 1))


def _read(inputs: Sequence[str | Path], corrections: Corrections) -> Sequence[Scan]:
    """The scans of finished files, with points' times as they are. Raises InputError: no scan can be read."""
    read = read_survey(inputs, corrections=corrections, correct_times=False)
    if not read.scans:
        raise InputError(f"no scan can be read: {read.unread[0].reason}")
    return read.scans


def _files(folder: Path) -> dict[str, Path]:
    """The files with scans in a folder, in natural order, by their final names."""
    try:
        # a ROS 2 bag that was finished meanwhile
        inputs = sorted(folder.glob(f"*{MCAP}")) if is_bag_folder(folder) else [folder]
        paths = [selected.path for selected in select_files(inputs, FORMATS).files]
    except InputError:  # none yet
        return {}
    named: dict[str, Path] = {}
    for path in sorted(paths, key=lambda path: (natural_key(_final_name(path)), _number(path))):
        name = first = _final_name(path)
        while name in named:  # an interrupted recording and its successor
            name = f"{first}~{name.count('~') + 2}"
        named[name] = path
    return named


def _final_name(path: Path) -> str:
    return _PART.sub("", path.name)


def _number(path: Path) -> float:
    """Part number of a recording among those with one final name; the one that has this name is the last."""
    part = _PART.search(path.name)
    return math.inf if part is None else int(part[1] or 1)


def _follows(name: str, passed: str, begin: str) -> bool:
    """Whether a file comes after the file `passed`, and not before the file `begin`."""
    key, last, first = ((natural_key(each), each) for each in (name, passed, begin))
    return key >= first and (not passed or key > last)


def _size(path: Path) -> tuple[int, int] | None:
    """Size and modification time [ns] of a file, to detect changes; None if it is gone."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def _is_last(folder: Path, name: str, ended: Callable[[], bool]) -> bool:
    return not ended() and next(reversed(_files(folder)), name) == name
