# pyright: strict
"""Scans while they come: of files that grow, and of finished ones at the pace at which they were taken."""

import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.clouds.cloud import scan_of_cloud
from sonarmap.tools.files.readers.corrections import Corrections
from sonarmap.tools.files.readers.scans import FORMATS, read_survey
from sonarmap.tools.files.readers.selection import select_files
from sonarmap.tools.files.readers.sonar.recording import Recording

RECORDING = ".sonar"
_PART = re.compile(r"\.part\d*(?=\.sonar$)")  # in the name of a recording that goes on
_LOOKS = 0.02  # between looks at a file that grows [s]
_LOOKS_FOR_FILES = 0.3  # between looks at a folder; a file that did not change meanwhile is whole [s]


@dataclass(frozen=True, slots=True)
class Mark:
    """How far an input was read."""

    file: str = ""  # name of the file; "" for none
    count: int = 0  # bytes of it that were read, or scans


@dataclass(frozen=True, slots=True)
class Incoming:
    """A scan that has come."""

    scan: Scan
    behind: Mark  # from which reading can go on
    missing: int = 0  # shots that did not come, by their numbers, so far


def incoming(
    source: Path, corrections: Corrections, ended: Callable[[], bool], after: Mark = Mark()
) -> Iterator[Incoming]:
    """Scans of a recording or a folder that grows, as they come, until it has `ended`; those after a mark. Files of a
    folder follow one another by their names. Unusable scans and, of the folder, unreadable files are left out."""
    if source.suffix.lower() == RECORDING:
        yield from _of_recording(source, corrections, lambda: not ended() and source.exists(), after)
        return
    sizes: dict[str, tuple[int, int]] = {}
    passed = ""
    while not ended():
        files = _files(source)
        names = list(files)
        if passed in files:
            names = names[names.index(passed) + 1 :]
        elif after.file in files:
            names = names[names.index(after.file) :]
        if not names:
            time.sleep(_LOOKS_FOR_FILES)
            continue
        name, path = names[0], files[names[0]]
        if path.suffix.lower() == RECORDING:
            grows = partial(_is_last, source, name, ended)
            yield from _of_recording(path, corrections, grows, after if name == after.file else Mark(name))
        elif sizes.get(name) != (size := _size(path)):
            sizes[name] = size
            time.sleep(_LOOKS_FOR_FILES)
            continue
        elif name != after.file:
            yield from _of_file(path, corrections)
        passed = name


def replayed(
    inputs: Sequence[str], corrections: Corrections, factor: float, ended: Callable[[], bool], after: Mark = Mark()
) -> Iterator[Incoming]:
    """Scans of finished files, so many times faster than they were taken, or all at once for a factor of 0."""
    scans = read_survey(inputs, corrections=corrections).scans
    start, begun = scans[min(after.count, len(scans) - 1)].stamp, time.monotonic()
    for number, scan in enumerate(scans[after.count :], after.count + 1):
        due = begun + (scan.stamp - start) / factor if factor > 0 else begun
        while (left := due - time.monotonic()) > 0 and not ended():
            time.sleep(min(left, _LOOKS_FOR_FILES))
        if ended():
            return
        yield Incoming(scan, Mark("", number))


def _of_recording(path: Path, corrections: Corrections, grows: Callable[[], bool], after: Mark) -> Iterator[Incoming]:
    """What is there when it no longer grows comes too."""
    is_last = False

    def more() -> bool:
        nonlocal is_last
        if is_last:
            return False
        time.sleep(_LOOKS)
        is_last = not grows()  # what came before it ended is read once more
        return True

    recording, latest = Recording(), float("-inf")
    for number, shot in enumerate(recording.read(path, 0, more, after.count)):
        stamp = shot.frame.stamp
        try:
            scan, _ = scan_of_cloud(corrections.corrected(recording.cloud(shot)), f"{path.stem}#{number}", 0.0)
        except InputError:  # without an echo
            continue
        if stamp is not None and stamp <= latest:  # it came late
            continue
        latest = float(number) if stamp is None else stamp
        yield Incoming(
            replace(scan, stamp=latest), Mark(after.file, recording.read_until), recording.queue.numbers.missing
        )


def _of_file(path: Path, corrections: Corrections) -> Iterator[Incoming]:
    try:
        scans = read_survey([path], corrections=corrections).scans
    except InputError:
        return
    yield from (Incoming(scan, Mark(path.name, number)) for number, scan in enumerate(scans, 1))


def _files(folder: Path) -> dict[str, Path]:
    """The files with scans in a folder, in natural order, by the names that they have or will have at last."""
    try:
        paths = [selected.path for selected in select_files([folder], FORMATS).files]
    except InputError:  # none yet
        return {}
    return {_PART.sub("", path.name): path for path in paths}


def _is_last(folder: Path, name: str, ended: Callable[[], bool]) -> bool:
    """Whether a file of a folder may still grow."""
    return not ended() and next(reversed(_files(folder)), name) == name


def _size(path: Path) -> tuple[int, int]:
    """What changes with a file."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns
