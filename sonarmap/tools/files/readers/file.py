"""Reading the clouds of one file of any format. A new format is a file in clouds/ and a row of FORMATS."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.bags.clouds import stream_recording
from sonarmap.tools.files.readers.clouds.cloud import POINT_BYTES, Cloud
from sonarmap.tools.files.readers.clouds.las import read_las
from sonarmap.tools.files.readers.clouds.npy import read_npy, read_npz
from sonarmap.tools.files.readers.clouds.pcd import read_pcd
from sonarmap.tools.files.readers.clouds.ply import read_ply
from sonarmap.tools.files.readers.clouds.rows import read_text, require_believable
from sonarmap.tools.files.readers.pings.line_file import AS_LINES, LineReading, line_clouds
from sonarmap.tools.files.readers.pings.line_file import FORMATS as LINES
from sonarmap.tools.files.readers.selection import SelectedFile
from sonarmap.tools.files.user_file import Kind, naming, require_kind, unreadable

_LISTED = 3  # scans without points that a note names


@dataclass(frozen=True, slots=True)
class Format(Kind):
    """A format of point clouds."""

    # reads the clouds from a file's content; None if `stream` reads the format
    read: Callable[[bytes], list[Cloud]] | None = None
    # reads the clouds one by one from a path and a topic, for files larger than memory. It appends notes about the file
    # as a whole to the list, and skips damaged parts where it can.
    stream: Callable[[Path, str | None, list[str]], Iterator[Cloud]] | None = None
    has_sound_speed: bool = False  # whether clouds have the speed of sound with which ranges were computed
    has_axes: bool = False  # whether the format defines the axes and the unit of points
    has_topics: bool = False
    is_line: bool = False  # whether it is a survey line of pings, which `pings.patches` cuts into clouds


def _stream_sonar(path: Path, _: str | None, notes: list[str]) -> Iterator[Cloud]:
    # imported late: wlsonar imports an HTTP client, which takes a third of a second
    from sonarmap.tools.files.readers.sonar.recording import stream_sonar

    return stream_sonar(path, notes)


def _recording(kind: str, start: bytes) -> Format:
    return Format(kind, start, stream=stream_recording, has_topics=True)


_BAG_FOLDER = _recording("a ROS 2 bag", b"")
_TEXT = Format("text", rb"[^\x00-\x08\x0e-\x1f\x7f]*\Z", read_text)

_OF_POSES = (".tum", ".kitti", ".g2o")
# Suffix -> format. Text is last because the start of a PLY or PCD file matches it too.
FORMATS = {
    ".ply": Format("a PLY file", rb"ply[ \t]*[\r\n]", read_ply),
    ".pcd": Format("a PCD file", rb"# ?\.PCD|(?:\s*#[^\n]*\n)*\s*VERSION\s+0?\.\d", read_pcd),
    ".npy": Format("a NumPy .npy array", rb"\x93NUMPY", read_npy),
    ".npz": Format("a zip archive, as NumPy's .npz is", rb"PK(\x03\x04|\x05\x06)", read_npz),
    **dict.fromkeys((".las", ".laz"), Format("a LAS or LAZ file", rb"LASF", read_las)),
    ".sonar": Format("a Sonar 3D-15 recording", rb"RIP[12]", stream=_stream_sonar, has_sound_speed=True, has_axes=True),
    ".bag": _recording("a ROS 1 bag", rb"#ROSBAG V"),
    ".mcap": _recording("an MCAP file", rb"\x89MCAP0\r\n"),
    ".db3": _recording("an SQLite database, as ROS 2 bags have", rb"SQLite format 3\x00"),
    **{suffix: Format(each.kind, each.start, is_line=True, has_axes=True) for suffix, each in LINES.items()},
    **dict.fromkeys((".xyz", ".txt", ".csv", ".pts", ".asc"), _TEXT),
}


@dataclass(frozen=True, slots=True)
class NamedCloud:
    """A cloud with its file or ROS 2 bag, its place in that file (for messages), and the name of its scan."""

    path: Path
    where: str
    name: str
    cloud: Cloud


def clouds_of(selected: SelectedFile, notes: list[str], lines: LineReading = AS_LINES) -> Iterator[NamedCloud]:
    """Yield the clouds of one file that have points; notes about the file are appended to `notes`."""
    with naming(selected.path):
        try:
            yield from _named(selected, _clouds_in(selected, notes, lines), notes)
        except MemoryError as error:
            raise InputError("too large for this machine's memory; thin its points out first") from error


def format_of(path: Path) -> Format | None:
    """The format of a file by its suffix; a folder is a ROS 2 bag. None for an unknown suffix."""
    return _BAG_FOLDER if path.is_dir() else FORMATS.get(path.suffix.lower())


def _clouds_in(selected: SelectedFile, notes: list[str], lines: LineReading) -> Iterator[Cloud]:
    path = selected.path
    if (file_format := format_of(path)) is None:
        poses = "these are poses, not scans; " if path.suffix.lower() in _OF_POSES else ""
        suffix = path.suffix or "(no suffix)"
        raise InputError(f"{poses}unknown format {suffix!r}; known formats are {', '.join(FORMATS)}")
    if file_format is not _BAG_FOLDER:
        require_kind(path, FORMATS)
    if selected.topic is not None and not file_format.has_topics:
        raise InputError(f"::{selected.topic} names a topic, but {file_format.kind} has none; leave it out")
    if file_format.is_line:
        clouds = line_clouds(path, notes, lines)
    elif file_format.stream is not None:
        clouds = file_format.stream(path, selected.topic, notes)
    else:
        assert file_format.read is not None, "a format is read at once or streamed"
        with unreadable():
            require_memory("the file", path.stat().st_size, "thin its points out first")
            content = path.read_bytes()
        clouds = iter(file_format.read(content))
    return _checked(clouds, path)


def _checked(clouds: Iterator[Cloud], path: Path) -> Iterator[Cloud]:
    """The clouds, checked so that their points as float64 take memory in proportion to the file's size."""
    size = sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]) if file.is_file())
    for cloud in clouds:
        require_believable(f"a cloud of {len(cloud.points):,} points", size, len(cloud.points) * POINT_BYTES)
        yield cloud


def _named(selected: SelectedFile, clouds: Iterator[Cloud], notes: list[str]) -> Iterator[NamedCloud]:
    """The selected clouds that have points; their names have a number if the file holds several."""
    count, empty, first = 0, list[str](), list(islice(clouds, 2))
    stem = selected.path.resolve().name if selected.path.is_dir() else selected.path.stem
    for k, cloud in enumerate(chain(first, clouds)):
        count, label = count + 1, f"#{k}" if len(first) > 1 else ""
        named = NamedCloud(selected.path, f"{selected.place}{label}", f"{stem}{label}", cloud)
        if selected.index is not None:
            if k == selected.index:
                yield named
                return
        elif len(cloud.points):
            yield named
        else:
            empty.append(label)
    if selected.index is not None:
        raise InputError(f"the file holds scans #0 to #{count - 1}, not #{selected.index}; choose one of them")
    if len(empty) == count:
        raise InputError("no points in it; give a scan with at least one finite point")
    if empty:
        which = f"{', '.join(empty[:_LISTED])}{', ...' if len(empty) > _LISTED else ''}"
        name = selected.path.name
        notes.append(f"{name}: {len(empty):,} of {count:,} scans were skipped, as they have no points: {which}")
