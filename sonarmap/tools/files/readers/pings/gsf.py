"""GSF, the Generic Sensor Format, by its library, in a process of its own (`gsf_child.py`).

Of a ping: soundings across (starboard +), along (forward +) and down, corrected for attitude, refraction and, where the
file says so, tides; so they are in the level frame already. Depths count from the water's level, or, where a tide was
applied, from its datum.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.assembly import RecordedPing, assembled, counted, matrices_of
from sonarmap.tools.files.readers.pings.gsf_child import HEAD, RECORD
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from sonarmap.tools.files.user_file import unreadable

_CHILD = Path(__file__).with_name("gsf_child.py")
_PATIENCE = 6.0  # seconds for a file of no size: the start of the process takes 0.1
_RATE = 1e6  # bytes that are read a second, a tenth of what was measured
_MOST_BEAMS = 1 << 15  # of a ping, whose count the file has in two bytes
_GROWTH = 40  # bytes of memory that a byte of the file takes at most: three of a sounding, and its four numbers twice


@dataclass(slots=True)
class _Answer:
    """What the child printed."""

    heads: list[np.ndarray] = field(default_factory=list)  # (HEAD,) each
    rows: list[np.ndarray] = field(default_factory=list)  # (n, 4) each: x, y, z, whether it is rejected
    levers: list[np.ndarray] = field(default_factory=list)  # (4,) each: the transducer forward, starboard, down; draft
    echo_sounder: str = ""
    faults: list[str] = field(default_factory=list)


def read_gsf(path: Path) -> RecordedLine:
    """The line of a GSF file. Raises InputError: the library cannot read it, or it holds no ping with soundings."""
    _require_library()
    with unreadable():
        size = path.stat().st_size
    require_memory("the file, unpacked,", _GROWTH * size, "split it")
    answer, end = _asked(path, _PATIENCE + size / _RATE)
    notes, count = list[str](), len(answer.heads)
    if not count and (end or answer.faults):
        raise InputError(f"the GSF library cannot read it ({end or answer.faults[0]}); write or copy it again")
    if end:
        notes.append(f"the GSF library {end} after {counted(count, 'ping')}, which are kept: the file is damaged")
    if answer.faults:
        records = counted(len(answer.faults), "record")
        notes.append(f"{records} could not be read ({answer.faults[0]}): the file is damaged or cut")
    return _line(path.stem, answer, notes)


def _require_library() -> None:
    """Refuse where the library is missing; it is for Linux on x86-64 alone."""
    try:
        import gsfpy3_09  # noqa: F401  # pyright: ignore[reportUnusedImport, reportMissingTypeStubs]
    except Exception as error:  # gsfpy raises just that, of no other class, where its library does not load
        raise InputError(f"the GSF library does not load on this machine ({error}); convert it on another") from error


def _asked(path: Path, patience: float) -> tuple[_Answer, str]:
    """What the child says of a file, and how it ended, in words; "" if well."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryFile() as out:
        command = [sys.executable, "-P", str(_CHILD), str(path.absolute())]
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.DEVNULL, env=environment
        )
        try:
            code = child.wait(patience)
            end = "" if code == 0 else _ending(code)
        except subprocess.TimeoutExpired:
            end = f"did not end within {patience:.0f} s"
        finally:
            child.kill()
            child.wait()
        out.seek(0)
        return _parsed(out.read()), end


def _ending(code: int) -> str:
    if code < 0:
        return f"crashed, {signal.strsignal(-code) or f'signal {-code}'}"
    return f"failed with code {code}"


def _parsed(printed: bytes) -> _Answer:
    """What is whole of it: a child that was ended may have printed half a record."""
    answer, start, lever = _Answer(), 0, np.full(4, np.nan)
    while start + RECORD.size <= len(printed):
        kind, count = RECORD.unpack_from(printed, start)
        start += RECORD.size
        size = 8 * (HEAD + 4 * count) if kind == b"P" else count
        if kind not in (b"P", b"J") or start + size > len(printed) or (kind == b"P" and count > _MOST_BEAMS):
            break
        if kind == b"P":
            numbers = np.frombuffer(printed, "<f8", HEAD + 4 * count, start)
            answer.heads.append(numbers[:HEAD])
            answer.rows.append(numbers[HEAD:].reshape(count, 4))
            answer.levers.append(lever)
        else:
            words = json.loads(printed[start : start + size])
            answer.faults += [words["fault"]] if "fault" in words else []
            answer.echo_sounder = answer.echo_sounder or words.get("echo_sounder", "")
            lever = _lever(words["parameters"]) if "parameters" in words else lever
        start += size
    return answer


def _lever(parameters: dict[str, list[float]]) -> np.ndarray:
    """(4,) the transducer forward, starboard and down of the vessel's reference point, and its draft [m]; NaN where
    the file does not say."""
    offset = parameters.get("APPLIED_TRANSDUCER_OFFSET", [])[:3]
    draft = parameters.get("APPLIED_DRAFT", [np.nan])[0]
    return np.array([*(offset if len(offset) == 3 else [np.nan] * 3), draft])


def _line(name: str, answer: _Answer, notes: list[str]) -> RecordedLine:
    if not answer.heads:
        raise InputError("it holds no ping with soundings; give a line of a multibeam echo sounder")
    heads = np.array(answer.heads)
    stamps, latitudes, longitudes, roll, pitch, heading, heave, tide, speeds, nominal = heads[:, :10].T
    level = np.isnan(roll) | np.isnan(pitch)
    if level.any():
        notes.append(f"{counted(int(level.sum()), 'ping')} without roll or pitch, taken as level")
    if nominal.any():
        notes.append("depths are those for a speed of sound of 1500 m/s; the file has no others")
    attitudes = np.column_stack([np.nan_to_num(roll), np.nan_to_num(pitch), heading])
    attitudes = np.radians(attitudes)
    sensors = _sensors(attitudes, np.array(answer.levers), heave, tide)
    pings = [
        RecordedPing(stamps[k], (latitudes[k], longitudes[k], 0.0), tuple(attitudes[k]), sensors[k],
                     rows[rows[:, 3] == 0, :3], len(rows))
        for k, rows in enumerate(answer.rows)
    ]  # fmt: skip
    return assembled(name, pings, answer.echo_sounder, speeds.tolist(), notes)


def _sensors(attitudes: np.ndarray, levers: np.ndarray, heave: np.ndarray, tide: np.ndarray) -> np.ndarray:
    """(P, 3) the transducers [m] in the level frames; 0 where the file does not say."""
    offsets = np.nan_to_num(levers[:, :3]) * [1, -1, -1]
    draft = np.where(np.isnan(levers[:, 3]), -offsets[:, 2], levers[:, 3])
    sensors = np.einsum("pij,pj->pi", matrices_of(attitudes), offsets)
    # Its depth when the vessel lies level is the draft. Heave counts down: Kongsberg's depths of the transducer in a
    # real file fit within 0.1 m so, and are 2 m off the other way round.
    sensors[:, 2] += -draft - offsets[:, 2] - np.nan_to_num(heave)
    sensors[np.isnan(levers).all(axis=1)] = 0.0
    # a corrector was added to depths: their datum lies so much above the water
    sensors[:, 2] -= np.nan_to_num(tide)
    return sensors
