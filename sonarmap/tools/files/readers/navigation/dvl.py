"""Dead reckoning of Water Linked DVLs: reports as JSON lines (TCP) and sentences (serial), of velocity and position.

https://docs.waterlinked.com/dvl/dvl-protocol: positions are in the axes forward, right, down in which the dead
reckoning began, roll, pitch and yaw in degrees; the figure of merit is a standard deviation.
"""

import json
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.instruments import LARGEST, LEAST_SIGMA
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.settings import OF_NMEA, OF_TABLES, NavigationSettings
from sonarmap.tools.files.user_file import reading

_SENTENCE = re.compile(r"\b(wr[pzx]),([^*\s]+)(?:\*([0-9a-fA-F]{2}))?")
_JSON = re.compile(r'[^{]*(\{.*"type"\s*:\s*"(velocity|position_local)".*\})')
_POSITION = ("ts", "x", "y", "z", "std", "roll", "pitch", "yaw", "status")
_LARGEST = np.array([1e11, *[LARGEST] * 4, *[360.0] * 3])
_WORDS = {
    "position": "positions", "velocity": "velocities", "invalid": "invalid reports", "damaged": "damaged ones"
}  # fmt: skip
_RESET = 1.0  # [m]: a longer step to a smaller figure of merit begins a new dead reckoning


def is_dvl(text: str) -> bool:
    return any(_JSON.match(line) or _SENTENCE.search(line) for line in text.splitlines())


def read_dvl(path: Path, settings: NavigationSettings, for_priors: bool, notes: list[str]) -> NavigationLog:
    """The positions of a DVL's dead reckoning, with its figure of merit; x forward, as North, and y right, as East."""
    settings.refuse_unused(path, "holds the reports of a DVL", OF_TABLES + OF_NMEA)
    rows, counts = list[list[float]](), Counter[str]()
    with reading(path), path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            kind, report = _report(line)
            counts[kind] += 1
            if kind == "position":
                rows.append([number, *report])
    counted = ", ".join(f"{counts[kind]} {what}" for kind, what in _WORDS.items() if counts[kind])
    if len(rows) < 2:
        raise InputError(
            f"{path} has {counted}; dead reckoning needs positions: record the DVL's position_local (JSON) or wrp"
        )
    if for_priors:
        raise InputError(f"{path} is the dead reckoning of a DVL, not measured positions; give it by --odometry")
    notes.append(f"{path}: {counted}; x forward at its start is taken as North")
    lines, times, x, y, z, std, roll, pitch, yaw = np.array(rows).T
    values = np.column_stack([roll, pitch, yaw % 360, y, x, z])
    steps = np.linalg.norm(np.diff(values[:, 3:], axis=0), axis=1)
    for row in (1 + np.flatnonzero((steps > _RESET) & (np.diff(std) < 0))).tolist():
        raise InputError(f"{path}: line {lines[row]:.0f}: the dead reckoning was reset; divide the file there")
    sigmas = np.full_like(values, np.nan)
    sigmas[:, 3:] = np.maximum(std, LEAST_SIGMA)[:, None]
    return NavigationLog("stamp", lines.astype(np.int64), tuple(map(str, times)), times, values, sigmas)


def _report(line: str) -> tuple[str, list[float]]:
    """What a line is: "position" with the values of _POSITION, "velocity", "invalid", "damaged", or "other"."""
    is_json, sentence = _JSON.match(line), _SENTENCE.search(line)
    if not is_json and not sentence:
        return "other", []
    with suppress(ValueError, TypeError, LookupError, RecursionError):
        if is_json:
            report = json.loads(is_json[1])
            if is_json[2] == "velocity":
                return ("velocity" if report["velocity_valid"] is True else "invalid"), []
            return _position([report[name] for name in _POSITION])
        if sentence and _crc8(f"{sentence[1]},{sentence[2]}".encode()) == int(sentence[3], 16):
            fields = sentence[2].split(",")
            if sentence[1] == "wrp":
                return _position(fields)
            return ("velocity" if fields[3 if sentence[1] == "wrz" else 6] == "y" else "invalid"), []
    return "damaged", []


def _position(fields: Sequence[Any]) -> tuple[str, list[float]]:
    """A position, whose status is 0 if it is right."""
    *values, status = (float(each) for each in fields)
    if len(values) != len(_LARGEST) or not (np.abs(values) <= _LARGEST).all():
        raise ValueError
    return ("position" if status == 0 else "invalid"), values


def _crc8(content: bytes) -> int:
    """CRC-8 with the polynomial 0x07."""
    crc = 0
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ (0x107 if crc & 0x80 else 0)
    return crc
