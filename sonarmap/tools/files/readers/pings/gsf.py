"""Reader of GSF, the Generic Sensor Format, with its library in a separate process (`gsf_child.py`).

Soundings of a ping are across (starboard +), along (forward +) and down, corrected for attitude, refraction and, if the
file says so, tides; so they are already in the level frame. Depths count from the water surface, or, if a tide was
applied, from its datum.
"""

import json
import os
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from sonarmap.kernels.child import end_in_words
from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import R_level_vehicle_of
from sonarmap.tools.extras import require
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.pings.gsf_child import HEAD
from sonarmap.tools.files.readers.pings.recorded import SINGLE_BEAM, RecordedLine, assembled
from sonarmap.tools.files.user_file import unreadable

_CHILD = Path(__file__).with_name("gsf_child.py")
_START_TIMEOUT = 6.0  # [s], for an empty file; the start of the process takes 0.1
_MIN_RATE = 1e6  # [bytes/s] of reading, below which it times out; a tenth of the measured rate
_GROWTH = 40  # bytes of memory per byte of the file, at most: a sounding has 3 bytes there, and 8 numbers here
_DIVED = 10.0  # [m]: a larger depth corrector is not a dynamic draft but the depth of a submersible


@dataclass(slots=True)
class _Answer:
    """Output of the child process."""

    heads: list[np.ndarray] = field(default_factory=list)  # (len(HEAD),) each
    rows: list[np.ndarray] = field(default_factory=list)  # (n, 4) each: x, y, z, whether it is rejected
    words: dict[str, str] = field(default_factory=dict)  # the last values of "echo_sounder", "datum", "single_beam"
    faults: list[str] = field(default_factory=list)


def read_gsf(path: Path) -> RecordedLine:
    """The line of a GSF file."""
    _require_library()
    with unreadable():
        size = path.stat().st_size
    require_memory("the file, unpacked,", _GROWTH * size, "split it")
    answer, end = _run_child(path, _START_TIMEOUT + size / _MIN_RATE)
    notes, count = list[str](), len(answer.heads)
    if not count and "single_beam" in answer.words:
        raise InputError(SINGLE_BEAM)
    if not count and (end or answer.faults):
        raise InputError(f"the GSF library cannot read it ({end or answer.faults[0]}); write or copy it again")
    if not count:
        raise InputError("it holds no ping with soundings; give a line of a multibeam echo sounder")
    if end:
        notes.append(f"the GSF library {end} after {counted(count, 'ping')}, which are kept: the file is damaged")
    if answer.faults:
        records = counted(len(answer.faults), "record")
        notes.append(f"{records} could not be read ({answer.faults[0]}): the file is damaged or cut")
    return _line(path.stem, answer, notes)


def _require_library() -> None:
    """Refuse if the library does not load; it exists only for Linux on x86-64."""
    require("gsfpy3_09")
    try:
        import gsfpy3_09  # noqa: F401
    except Exception as error:  # gsfpy raises a bare Exception if its library does not load
        raise InputError(f"the GSF library does not load on this machine ({error}); convert it on another") from error


def _run_child(path: Path, timeout: float) -> tuple[_Answer, str]:
    """Output of the child process for a file, and how it failed, in words, or ""."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-P", str(_CHILD), str(path.absolute())]
    with tempfile.TemporaryFile() as out:
        try:
            code = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.DEVNULL,
                env=environment,
                timeout=timeout,
            ).returncode
            end = f"ended with {end_in_words(code)}" if code else ""
        except subprocess.TimeoutExpired:
            end = f"did not end within {timeout:.0f} s"
        out.seek(0)
        return _parsed(out), end


def _parsed(printed: IO[bytes]) -> _Answer:
    """Parse all whole arrays: a killed child may have printed a part of one."""
    answer, head = _Answer(), np.empty(0)
    with suppress(ValueError):
        while True:
            array = np.lib.format.read_array(printed)
            if array.ndim == 2:
                answer.heads.append(head)
                answer.rows.append(array)
            elif array.ndim == 1:
                head = array
            else:
                words = json.loads(array.item())
                answer.faults += [words.pop("fault")] if "fault" in words else []
                answer.words |= {name: word for name, word in words.items() if word}
    return answer


def _line(name: str, answer: _Answer, notes: list[str]) -> RecordedLine:
    heads = dict(zip(HEAD, np.array(answer.heads).T, strict=True))
    level = np.isnan(heads["roll"]) | np.isnan(heads["pitch"])
    if level.any():
        notes.append(f"{counted(int(level.sum()), 'ping')} without roll or pitch, taken as level")
    if heads["is_nominal"].any():
        notes.append("depths are those for a speed of sound of 1500 m/s; the file has no others")
    # one of both tides was added to the depths
    tide = np.where(np.nan_to_num(heads["tide"]) == 0, np.nan_to_num(heads["gps_tide"]), np.nan_to_num(heads["tide"]))
    if tide.any():
        datum, above = answer.words.get("datum", "a tidal datum"), np.nan_to_num(heads["separation"])
        where = f", {np.median(above):.2f} m above the ellipsoid" if above.any() else ""
        notes.append(f"depths are corrected for the tide: they count from {datum}{where}")
    attitudes = np.column_stack([np.nan_to_num(heads["roll"]), np.nan_to_num(heads["pitch"]), heads["heading"]])
    attitudes = np.radians(attitudes)
    return assembled(
        name,
        answer.words.get("echo_sounder", ""),
        stamps=heads["stamp"],
        fixes=np.column_stack([heads["latitude"], heads["longitude"], np.zeros(len(level))]),
        attitudes=attitudes,
        sensors=_sensors(attitudes, heads, tide),
        points=[rows[:, :3] for rows in answer.rows],
        flagged=[rows[:, 3] > 0 for rows in answer.rows],
        sound_speeds=heads["sound_speed"].tolist(),
        notes=notes,
    )


def _sensors(attitudes: np.ndarray, heads: dict[str, np.ndarray], tide: np.ndarray) -> np.ndarray:
    """(P, 3) positions of the transducer [m] in the level frames; 0 if unknown."""
    offsets = np.column_stack([heads["forward"], heads["starboard"], heads["down"]])
    unknown = np.isnan(offsets).all(axis=1) & np.isnan(heads["draft"])
    offsets = np.nan_to_num(offsets) * [1, -1, -1]
    draft = np.where(np.isnan(heads["draft"]), -offsets[:, 2], heads["draft"])
    sensors = R_level_vehicle_of(attitudes).apply(offsets)
    # The draft is the transducer's depth on a level vessel. Heave is positive down: with this sign the depths of
    # transducers in a Kongsberg file fit within 0.1 m, with the other they are 2 m off.
    level = -draft - offsets[:, 2] - np.nan_to_num(heads["heave"])
    dived = np.nan_to_num(heads["depth"]) > _DIVED
    sensors[:, 2] += np.where(dived, -heads["depth"], level)
    sensors[unknown & ~dived] = 0.0
    # the tide was added to depths: their datum is that far above the water surface
    sensors[:, 2] -= tide
    return sensors
