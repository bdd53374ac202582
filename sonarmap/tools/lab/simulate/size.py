"""How large a simulation may be: what this machine's memory holds."""

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import available_memory, in_gib

# Measured: what a beam takes while its echo is computed, and what is kept of an echo and of a scan [bytes].
_BEAM, _ECHO, _SCAN = 450, 16, 2000


def check_size(count: int, columns: int, rows: int) -> None:
    """Refuse more scans, or more beams, than this machine's memory holds.

    Args:
        count: of the scans, which are all kept until the last is done.
        columns, rows: beams of the sensor.

    Raises:
        InputError: saying how many would fit.
    """
    available, beams = available_memory(), columns * rows
    most_beams = available // (_BEAM + _ECHO)
    if beams > most_beams:
        raise InputError(
            f"a sensor of {columns:,} columns and {rows:,} rows needs {in_gib(beams * (_BEAM + _ECHO))} of memory for "
            f"one scan, and this machine has {in_gib(available)} to spare; give at most {most_beams:,} beams, columns "
            "times rows"
        )
    per_scan = beams * _ECHO + _SCAN
    most_scans = max(1, (available - beams * _BEAM) // per_scan)
    if count > most_scans:
        raise InputError(
            f"{count:,} scans of {beams:,} beams need {in_gib(beams * _BEAM + count * per_scan)} of memory, and this "
            f"machine has {in_gib(available)} to spare; give at most {most_scans:,} scans (`count`), or a sensor of "
            "fewer beams"
        )
