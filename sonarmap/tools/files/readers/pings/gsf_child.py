"""Program that reads a GSF file with the GSF library, which may crash or never end on a damaged file.

It prints each ping as soon as it is read, so that those before the damage are kept: arrays in NumPy's format, for each
ping (len(HEAD),) numbers and (n, 4) soundings: x forward, y port, z up [m] and whether it is rejected; and messages as
JSON in a 0-dimensional array. It imports nothing of sonarmap, to start fast.
"""

import contextlib
import ctypes
import json
import os
import sys
from typing import BinaryIO

import numpy as np

# Numbers of a ping before its soundings, NaN if unknown [s, deg, m, m/s]. `is_nominal`: depths are for 1500 m/s.
# The last four, from the parameters, are the transducer's offset from the vessel's reference point, and its draft.
HEAD = (
    *("stamp", "latitude", "longitude", "roll", "pitch", "heading", "heave", "tide", "gps_tide", "depth", "separation"),
    *("sound_speed", "is_nominal", "forward", "starboard", "down", "draft"),
)
_END = -23  # GSF_READ_TO_END_OF_FILE
_PING, _PARAMETERS, _SINGLE_BEAM = 2, 4, 10  # kinds of records
_MEMORY = 4 << 30  # [bytes], limit of the address space
_MAX_GROWTH = 64  # bytes of output per byte of the file: a sounding of 3 bytes becomes 32
_MAX_FAULTS = 50  # consecutive records that cannot be decoded
_IGNORE = 1  # GSF_IGNORE_BEAM and GSF_IGNORE_PING, bit 0 of either flags
_KONGSBERG, _R2SONIC = (133, 134, 135, 149), (151, 152, 153)  # EM710, 302, 122, 2040; 2022, 2024, 2020
# the format's values for unknown numbers
_NULLS = {"latitude": 91, "longitude": 181, "heading": 361, "roll": 99, "pitch": 99, "heave": 99, "tide": 99.99,
          "gps_tide": 99.99, "depth": 99.99, "separation": 9999.99}  # fmt: skip


def main(path: str) -> None:
    """Print the pings of a file."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # the library prints to standard output, too
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
    budget, faults, last_words, parameters = _MAX_GROWTH * os.path.getsize(path) + (1 << 20), 0, {}, {}  # noqa: PTH202
    while budget > 0 and faults < _MAX_FAULTS:
        budget -= 8
        if bindings.gsfRead(opened, RecordType.GSF_NEXT_RECORD, ctypes.byref(identity), ctypes.byref(record)) < 0:
            if bindings.gsfIntError() == _END:
                break
            faults += 1
            budget -= 1024  # a file that never ends
            _say(out, {"fault": _fault(bindings)})
            continue
        faults = 0
        if identity.recordID == _PARAMETERS:
            parameters = _parameters(record.process_parameters)
        elif identity.recordID == _PING:
            name = (bindings.gsfGetSonarTextName(ctypes.byref(record.mb_ping)) or "").replace("Unknown", "")
            words = {"echo_sounder": name, "datum": parameters.get("TIDAL_DATUM", "").replace("UNKNOWN", "")}
            if words != last_words:
                _say(out, words)
                last_words = words
            budget -= _print_ping(record.mb_ping, parameters, out)
        elif identity.recordID == _SINGLE_BEAM and not last_words:
            last_words = {"single_beam": "ping"}
            _say(out, last_words)
    else:
        _say(out, {"fault": "records that do not end"})


def _fault(bindings) -> str:
    return (bindings.gsfStringError() or b"").decode("ascii", "replace").removeprefix("GSF Error:").strip()


def _say(out: BinaryIO, words: dict[str, str]) -> None:
    _print(out, np.array(json.dumps(words)))


def _print(out: BinaryIO, array: np.ndarray) -> None:
    np.lib.format.write_array(out, array)
    out.flush()


def _parameters(record) -> dict[str, str]:
    """{name: value} of the processing parameters."""
    found = {}
    for k in range(min(max(record.number_parameters, 0), len(record.param))):
        if record.param[k]:
            text = ctypes.string_at(record.param[k], max(record.param_size[k], 0)).decode("ascii", "replace")
            key, _, value = text.strip("\0 ").partition("=")
            found[key] = value
    return found


def _print_ping(ping, parameters: dict[str, str], out: BinaryIO) -> int:
    """Print a ping; return its number of bytes, 0 if it has no soundings."""
    count, depths = ping.number_beams, ping.depth or ping.nominal_depth
    if count <= 0 or not depths or not (ping.across_track or count == 1):
        return 0
    rows = np.zeros((count, 4))
    if ping.across_track:
        rows[:, 1] = -np.ctypeslib.as_array(ping.across_track, (count,))
    rows[:, 2] = -np.ctypeslib.as_array(depths, (count,))
    if ping.along_track:
        rows[:, 0] = np.ctypeslib.as_array(ping.along_track, (count,))
    rows[rows[:, 2] == 0, 2] = np.nan  # no bottom was detected
    if ping.beam_flags:
        rows[:, 3] += np.ctypeslib.as_array(ping.beam_flags, (count,)) & _IGNORE
    rows[:, 3] += ping.ping_flags & _IGNORE
    _print(out, _head(ping, parameters))
    _print(out, rows)
    return rows.nbytes


def _head(ping, parameters: dict[str, str]) -> np.ndarray:
    """(17,) float64 numbers in the order of HEAD."""
    # gsfpy exchanges the first two fields of a ping: in the C structure (gsf.h) latitude comes first, so its longitude
    # is the latitude. In the file longitude comes first.
    latitude, longitude = ping.longitude, ping.latitude
    stamp = ping.ping_time.tv_sec + ping.ping_time.tv_nsec * 1e-9
    nominal = not ping.depth or parameters.get("DEPTH_CALCULATION") == "RELATIVE_TO_1500_MS"
    values = (
        *(stamp, latitude, longitude, ping.roll, ping.pitch, ping.heading, ping.heave),
        *(ping.tide_corrector, ping.gps_tide_corrector, ping.depth_corrector, ping.sep, _sound_speed(ping), nominal),
        *_numbers(parameters.get("APPLIED_TRANSDUCER_OFFSET", ""), 3),
        *_numbers(parameters.get("APPLIED_DRAFT", ""), 1),
    )
    return np.array([np.nan if x == _NULLS.get(name) else x for name, x in zip(HEAD, values, strict=True)], float)


def _numbers(text: str, count: int) -> list[float]:
    """The first `count` numbers of a parameter; NaN if they are not there."""
    with contextlib.suppress(ValueError):  # UNKNWN
        numbers = [float(number) for number in text.split(",")[:count]]
        if len(numbers) == count:
            return numbers
    return [np.nan] * count


def _sound_speed(ping) -> float:
    """Sound speed at the transducer [m/s]; NaN if the ping's sensor-specific part has none."""
    if ping.sensor_id in _KONGSBERG:
        return ping.sensor_data.gsfEM4Specific.surface_velocity
    return ping.sensor_data.gsfR2SonicSpecific.sound_speed if ping.sensor_id in _R2SONIC else np.nan


if __name__ == "__main__":
    main(sys.argv[1])
