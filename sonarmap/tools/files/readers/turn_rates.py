"""Turn rates that recordings have of the sensor whose scans they hold."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.bags.imu import recorded_turn_rates
from sonarmap.tools.files.readers.bags.open import is_recording
from sonarmap.tools.files.readers.selection import is_bag_folder


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
