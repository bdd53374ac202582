"""The GSF library in a process of its own, which may crash or never end on a damaged file: a program, not a module.

It prints its pings as it reads them, so that those before the damage are not lost: to whoever started it, as records
of a letter, a count (uint32) and so many bytes (J, JSON) or soundings (P: HEAD, then x forward, y port, z up [m] and
whether it is rejected, all float64). It imports nothing of sonarmap, to start fast.
"""

import contextlib
import ctypes
import json
import os
import struct
import sys
from typing import BinaryIO

import numpy as np

HEAD = 16  # numbers of a ping before its soundings, as `_head` has them; unknown ones are NaN
RECORD = struct.Struct("<cI")
_END = -23  # GSF_READ_TO_END_OF_FILE
_PING, _PARAMETERS = 2, 4  # kinds of records
_MEMORY = 4 << 30  # addresses that a damaged file may take [bytes]
_OUTPUT = 64  # bytes that one of the file may become: three of a sounding in the file are 32 here
_FAULTS = 50  # records in a row that cannot be decoded
_IGNORE = 1  # GSF_IGNORE_BEAM and GSF_IGNORE_PING, bit 0 of either flags
_KONGSBERG, _R2SONIC = (133, 134, 135, 149), (151, 152, 153)  # EM710, 302, 122, 2040; 2022, 2024, 2020
_WANTED = ("APPLIED_TRANSDUCER_OFFSET", "APPLIED_DRAFT")
# what the format writes where a number is unknown
_NULLS = {"latitude": 91, "longitude": 181, "heading": 361, "roll": 99, "pitch": 99, "heave": 99, "tide": 99.99}


def main(path: str) -> None:
    """Print the pings of a file."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # the library may print, too
        _limit_memory()
        _print_pings(path, out)


def _limit_memory() -> None:
    with contextlib.suppress(ImportError, OSError, ValueError):  # Windows has no such limit
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _print_pings(path: str, out: BinaryIO) -> None:
    from gsfpy3_09 import bindings
    from gsfpy3_09.enums import FileMode, RecordType
    from gsfpy3_09.gsfDataID import c_gsfDataID
    from gsfpy3_09.gsfRecords import c_gsfRecords

    opened, identity, record = ctypes.c_int(), c_gsfDataID(), c_gsfRecords()
    if bindings.gsfOpen(os.fsencode(path), FileMode.GSF_READONLY, ctypes.byref(opened)) < 0:
        _say(out, {"fault": _fault(bindings)})
        return
    left, faults, said = _OUTPUT * os.path.getsize(path) + (1 << 20), 0, ""  # noqa: PTH202
    anything = RecordType.GSF_NEXT_RECORD
    while left > 0 and faults < _FAULTS:
        if bindings.gsfRead(opened, anything, ctypes.byref(identity), ctypes.byref(record)) < 0:
            if bindings.gsfIntError() == _END:
                break
            faults += 1
            left -= 1024  # a file that never ends
            _say(out, {"fault": _fault(bindings)})
            continue
        faults = 0
        left -= 8
        if identity.recordID == _PARAMETERS:
            _say(out, {"parameters": _parameters(record.process_parameters)})
        elif identity.recordID == _PING:
            name = (bindings.gsfGetSonarTextName(ctypes.byref(record.mb_ping)) or "").replace("Unknown", "")
            if name != said:
                _say(out, {"echo_sounder": name})
                said = name
            left -= _print_ping(record.mb_ping, out)
    else:
        _say(out, {"fault": "records that do not end"})


def _fault(bindings) -> str:
    return (bindings.gsfStringError() or b"").decode("ascii", "replace").removeprefix("GSF Error:").strip()


def _say(out: BinaryIO, words: dict) -> None:
    content = json.dumps(words).encode()
    out.write(RECORD.pack(b"J", len(content)) + content)
    out.flush()


def _parameters(record) -> dict[str, list[float]]:
    """Numbers of the processing parameters that are wanted; those that are unknown are left out."""
    found = {}
    for k in range(min(max(record.number_parameters, 0), len(record.param))):
        if not record.param[k]:
            continue
        text = ctypes.string_at(record.param[k], max(record.param_size[k], 0)).decode("ascii", "replace")
        key, _, value = text.strip("\0 ").partition("=")
        with contextlib.suppress(ValueError):  # UNKNWN
            if key in _WANTED:
                found[key] = [float(number) for number in value.split(",")]
    return found


def _print_ping(ping, out: BinaryIO) -> int:
    """How many bytes it takes; none if it has no soundings."""
    count, depths = ping.number_beams, ping.depth or ping.nominal_depth
    if count <= 0 or not depths or not ping.across_track:
        return 0
    rows = np.zeros((count, 4))
    rows[:, 1] = -np.ctypeslib.as_array(ping.across_track, (count,))
    rows[:, 2] = -np.ctypeslib.as_array(depths, (count,))
    if ping.along_track:
        rows[:, 0] = np.ctypeslib.as_array(ping.along_track, (count,))
    rows[:, 3] = rows[:, 2] == 0  # as where the echo sounder detected no bottom
    if ping.beam_flags:
        rows[:, 3] += np.ctypeslib.as_array(ping.beam_flags, (count,)) & _IGNORE
    rows[:, 3] += ping.ping_flags & _IGNORE
    content = _head(ping).tobytes() + rows.tobytes()
    out.write(RECORD.pack(b"P", count) + content)
    out.flush()
    return len(content)


def _head(ping) -> np.ndarray:
    """(HEAD,) float64: stamp [s], latitude, longitude, roll, pitch, heading [deg], heave, tide [m], speed of sound
    [m/s], whether depths are nominal."""
    # gsfpy has the first two fields of a ping the wrong way round: in the C structure (gsf.h) latitude comes first, so
    # what it calls longitude is the latitude. In the file longitude comes first; a test compares with its bytes.
    latitude, longitude = ping.longitude, ping.latitude
    values = {
        "stamp": ping.ping_time.tv_sec + ping.ping_time.tv_nsec * 1e-9,
        "latitude": latitude,
        "longitude": longitude,
        "roll": ping.roll,
        "pitch": ping.pitch,
        "heading": ping.heading,
        "heave": ping.heave,
        "tide": ping.tide_corrector,
        "sound_speed": _sound_speed(ping),
        "is_nominal": float(not ping.depth),
    }
    head = np.full(HEAD, np.nan)
    head[: len(values)] = [np.nan if value == _NULLS.get(key) else value for key, value in values.items()]
    return head


def _sound_speed(ping) -> float:
    """At the transducer [m/s]; NaN where the echo sounder's own part of the ping has none."""
    if ping.sensor_id in _KONGSBERG:
        return ping.sensor_data.gsfEM4Specific.surface_velocity
    return ping.sensor_data.gsfR2SonicSpecific.sound_speed if ping.sensor_id in _R2SONIC else np.nan


if __name__ == "__main__":
    main(sys.argv[1])
