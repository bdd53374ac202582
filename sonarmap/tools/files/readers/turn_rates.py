"""Turn rates that recordings have of the sensor whose scans they hold, as sensor_msgs/Imu or a .sonar's IMU."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.bags.frames import Frames, stamp_of
from sonarmap.tools.files.readers.bags.open import is_recording, open_recording
from sonarmap.tools.files.readers.bags.recording import IMU, decode
from sonarmap.tools.files.readers.selection import is_bag_folder
from sonarmap.tools.files.user_file import naming


def turn_rates_of(files: Sequence[Path], scans: Sequence[Scan]) -> TurnRates | None:
    """What the IMUs of all recordings among files of any format measured; None where no file has one, or no scan has
    points with times, which alone need them."""
    if all(scan.times is None for scan in scans):
        return None
    measured: list[tuple[np.ndarray, np.ndarray]] = []
    for path in dict.fromkeys(path.parent if is_bag_folder(path.parent) else path for path in files):
        with suppress(InputError):  # without an IMU
            if path.suffix.lower() == ".sonar":
                from sonarmap.tools.files.readers.sonar.imu import turn_rates

                measured.append(turn_rates(path))
            elif is_recording(path):
                measured.append(recorded_turn_rates(path))
    if not measured:
        return None
    times, rates = (np.concatenate(columns) for columns in zip(*measured, strict=True))
    times, first = np.unique(times, return_index=True)
    return TurnRates(times, rates[first]) if len(times) > 1 else None


def recorded_turn_rates(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s, UTC], ascending, and turn rates (n, 3) [rad/s] of the topic of sensor_msgs/Imu with most messages,
    by their headers, about the axes of base_link where tf_static has the IMU's mounting, else about those of its own
    frame, x forward, y left, z up. Raises InputError: naming the file: it has no such message that can be read."""
    with naming(path):
        recording = open_recording(path, [])
        topics = recording.of_kinds((IMU,))
        if not topics:
            raise InputError(f"it has no messages of type {IMU}")
        frames, rows = Frames(recording), list[tuple[float, float, float, float]]()
        frame = ""
        for message in recording.messages([max(topics, key=lambda topic: topic.count).name], []):
            with suppress(InputError):  # damage is told where the scans are read
                content = decode(message)
                rate, frame = content.angular_velocity, content.header.frame_id.lstrip("/")
                rows.append(((stamp_of(content.header) or message.time) / 10**9, rate.x, rate.y, rate.z))
        table = np.array(rows, np.float64).reshape(-1, 4)
        table = table[np.isfinite(table).all(axis=1)]
        if not len(table):
            raise InputError(f"none of its messages of type {IMU} can be read")
        times, first = np.unique(table[:, 0], return_index=True)
        return times, frames.T_base(frame).rotation.apply(table[first, 1:])
