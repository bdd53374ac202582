"""LAS and LAZ files, versions 1.1 to 1.4, read with laspy and lazrs: one file is one scan.

Format: https://www.asprs.org/divisions-committees/lidar-division/laser-las-file-format-exchange-activities
"""

from __future__ import annotations

import io
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.clouds.cloud import (
    COORDINATE_LIMIT,
    DEGREES,
    POINT_BYTES,
    VIEWPOINT_NAMES,
    Cloud,
    cloud_of_columns,
)
from sonarmap.tools.files.readers.clouds.rows import require_believable, require_bytes, surplus_note
from sonarmap.tools.files.time_scales import utc_of_gps

if TYPE_CHECKING:
    from laspy import LasHeader, LasReader
    from pyproj import CRS

import atexit
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from threading import Lock
from time import process_time
from typing import IO, Any, cast

from sonarmap.kernels.child import command_of, end_in_words, environment

_PIECE = 1 << 19  # points that are unpacked at a time
_LEAST_HEADER, _RECORD_HEADER = 227, 54  # bytes of the shortest header, and of a variable length record's header
_POINT_FORMAT, _COMPRESSED = 104, 0xC0  # offset of the point format in the header, and its bits for compression
_ADJUSTED = 1_000_000_000  # GPS time minus adjusted standard GPS time [s]
_DAMAGED = "the file is cut or damaged; copy it again"
Read = Callable[[bytes], list[Cloud]]

_SECONDS, _BYTES_PER_SECOND = 30, 100_000  # processor time: 30 s + 1 s per 100 kB, ten times what slow computers need
_MEMORY, _MEMORY_PER_BYTE = 512 << 20, 200  # memory for a file, and per byte of it [bytes]
_END_TIMEOUT = 10.0  # time that a process may take to end after it closed its output [s]

_lock = Lock()
_reader: tuple[int, subprocess.Popen[bytes]] | None = None  # id of the parent process (forks differ), and the reader


def read_las(content: bytes) -> list[Cloud]:
    """Read the points of a LAS or LAZ file, with intensity as strength, and GPS times not converted. The stamp is the
    first time in UTC if the header declares adjusted standard GPS time."""
    (cloud,) = read_map_las(content)
    _refuse_map_coordinates(cloud.points, content)
    return [cloud]


def read_map_las(content: bytes) -> list[Cloud]:
    """Like `read_las`, but allows map coordinates. Compressed points are read in another process, as damaged files can
    crash lazrs or make it allocate all memory."""
    _require_sound_header(content)
    return read_apart(_read, content) if content[_POINT_FORMAT] & _COMPRESSED else _read(content)


def _read(content: bytes) -> list[Cloud]:
    import laspy

    try:
        with laspy.LasReader(io.BytesIO(content), laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
            _require_sound_points(content, reader.header)
            columns = _columns(reader)
            header = reader.header
    except (InputError, MemoryError):
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":  # a panic in lazrs
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"it cannot be read ({reason[:200]}): {_DAMAGED}") from error
    times = columns.get("gps_time")
    roles = {"strength": columns["intensity"], **({} if times is None else {"time": times})}
    cloud = cloud_of_columns(columns | roles, _surplus(content, header))
    return [replace(cloud, stamp=_stamp_of(times, header))]


def _require_sound_header(content: bytes) -> None:
    """Raise InputError for a header that would keep laspy searching for records that are not there."""
    if len(content) < _LEAST_HEADER:
        raise InputError(f"it has {len(content)} bytes, less than a LAS header: the file is cut; copy it again")
    points_start, records = (int.from_bytes(content[place : place + 4], "little") for place in (96, 100))
    require_bytes("a header", points_start, len(content))
    require_bytes(f"{records:,} variable length records", records * _RECORD_HEADER, points_start)


def _require_sound_points(content: bytes, header: LasHeader) -> None:
    """Raise InputError if the header promises more points than the file or this machine's memory can hold."""
    count, size, start = header.point_count, header.point_format.size, header.offset_to_point_data
    require_believable(f"a cloud of {count:,} points", len(content), count * POINT_BYTES)
    if not header.are_points_compressed:
        require_bytes(f"{count:,} points of {size} bytes", count * size, len(content) - start)
    require_memory(f"a cloud of {count:,} points", count * (2 * size + 8 * 8), "thin its points out first")


def _surplus(content: bytes, header: LasHeader) -> list[str]:
    """A note about bytes after the last point, if no other records may follow the points."""
    if header.are_points_compressed or header.number_of_evlrs or header.start_of_waveform_data_packet_record:
        return []
    end = header.offset_to_point_data + header.point_count * header.point_format.size
    return surplus_note(len(content) - end, "bytes", "point")


def _columns(reader: LasReader) -> dict[str, np.ndarray]:
    """Columns (N,) x, y, z, intensity and, if the file has them, gps_time and vp_x, vp_y, vp_z."""
    names = ["x", "y", "z", "intensity"]
    present = set(reader.header.point_format.dimension_names)
    names += [name for group in (("gps_time",), VIEWPOINT_NAMES) if present.issuperset(group) for name in group]
    pieces: dict[str, list[np.ndarray]] = {name: [np.empty(0, "u2" if name == "intensity" else "f8")] for name in names}
    for points in reader.chunk_iterator(_PIECE):
        for name in names:
            pieces[name].append(np.array(points[name]))
    columns = {name: np.concatenate(arrays) for name, arrays in pieces.items()}
    if len(columns["x"]) != reader.header.point_count:
        raise InputError(f"{reader.header.point_count:,} points are promised, {len(columns['x']):,} follow: {_DAMAGED}")
    return columns


def _stamp_of(times: np.ndarray | None, header: LasHeader) -> float | None:
    """The first time [s, UTC]; None if there are no times, or only times of a GPS week."""
    from laspy.header import GpsTimeType

    if times is None or header.global_encoding.gps_time_type != GpsTimeType.STANDARD:
        return None
    known = times[np.isfinite(times) & (np.abs(times) < _ADJUSTED * 10)]
    return float(utc_of_gps(known.min() + _ADJUSTED)) if known.any() else None


def _refuse_map_coordinates(points: np.ndarray, content: bytes) -> None:
    """Raise InputError for points in degrees or in map coordinates, with the name of their system."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return
    crs, largest = crs_of(content), np.abs(finite).max(axis=0)
    in_degrees = crs is not None and crs.is_geographic and (largest[:2] <= 180).all()
    if not in_degrees and largest.max() <= COORDINATE_LIMIT:
        return
    authority = None if crs is None else crs.to_authority()
    system = (
        "an unnamed system" if crs is None else str(crs.name)[:100] + (f" ({':'.join(authority)})" if authority else "")
    )
    ranges = ", ".join(
        f"{axis} {low:.10g} to {high:.10g}" for axis, low, high in zip("xyz", finite.min(0), finite.max(0), strict=True)
    )
    if in_degrees:
        raise InputError(f"its points are in {system}: {ranges}; {DEGREES}")
    raise InputError(
        f"its points are map coordinates in {system}: {ranges} m; subtract the sensor's position, in meters"
    )


def crs_of(content: bytes) -> CRS | None:
    """The coordinate reference system of a readable file; None if it has none that pyproj knows."""
    from laspy import LasHeader

    with suppress(Exception):  # pyproj and laspy answer damage with errors of any kind
        return LasHeader.read_from(io.BytesIO(content)).parse_crs()
    return None


def read_apart(read: Read, content: bytes) -> list[Cloud]:
    """Run `read(content)`, a module-level function, in a separate process, so that a crash cannot end this one."""
    with _lock:
        process = _process()
        seconds, room = _SECONDS + len(content) // _BYTES_PER_SECOND, _MEMORY + _MEMORY_PER_BYTE * len(content)
        try:
            _send(process.stdin, (read.__module__, read.__name__, seconds, room, content))
            answer = _receive(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError):
            end = _end(_END_TIMEOUT)
            raise InputError(f"its library ended with {end}: the file is cut or damaged; copy it again") from None
        except BaseException:  # after Ctrl-C an answer may remain in the pipe
            _end()
            raise
    if isinstance(answer, str):
        raise InputError(answer)
    return answer


def main(_: Sequence[str]) -> None:
    """Main function of the separate process: read one file after another until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles Ctrl-C
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # keep what libraries print out of the answers
    with suppress(EOFError):
        while True:
            module, name, seconds, room, content = _receive(sys.stdin.buffer)
            _bound(seconds, room)
            _send(answers, _answer(getattr(import_module(module), name), content))


def _answer(read: Read, content: bytes) -> list[Cloud] | str:
    """The clouds, or why they cannot be read."""
    try:
        return read(content)
    except InputError as error:
        return str(error)
    except MemoryError:
        return "it takes more memory than is available; thin its points out first"


def _bound(seconds: int, room: int) -> None:
    """Limit the processor time [s] and the additional memory [bytes] for the next file, and disable core dumps."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError):  # not Linux
        return
    bounds = {resource.RLIMIT_CPU: int(process_time()) + seconds, resource.RLIMIT_AS: used + room}
    for kind, wanted in bounds.items():
        most = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))


def _send(stream: IO[bytes] | None, message: object) -> None:
    out = cast(IO[bytes], stream)
    pickle.dump(message, out, pickle.HIGHEST_PROTOCOL)
    out.flush()


def _receive(stream: IO[bytes] | None) -> Any:
    return pickle.load(cast(IO[bytes], stream))


def _process() -> subprocess.Popen[bytes]:
    """The running reader process; a new one if there is none or it has ended."""
    global _reader
    if _reader is None or _reader[0] != os.getpid() or _reader[1].poll() is not None:
        try:
            process = subprocess.Popen(
                command_of(__name__),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**environment(), "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            raise InputError(f"cannot start a process to read it ({error.strerror or error}); end others") from error
        _reader = os.getpid(), process
    return _reader[1]


def _end(patience: float = 0.0) -> str:
    """End the reader process, by force after `patience` seconds; return in words how it ended."""
    global _reader
    if _reader is None or _reader[0] != os.getpid():
        return "nothing"
    process, _reader = _reader[1], None
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # data that can no longer be sent
            cast(IO[bytes], stream).close()
    try:
        return end_in_words(process.wait(patience))
    except subprocess.TimeoutExpired:
        process.kill()
        return end_in_words(process.wait())


atexit.register(_end)
