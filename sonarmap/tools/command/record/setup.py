"""Set-up of a Sonar 3D-15 by wlsonar, the manufacturer's client of its HTTP interface."""

from collections import deque
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from threading import Thread
from typing import Any

from wlsonar import NTPConfiguration, Sonar3D, VersionException

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.record.words import CLOCK_OFF, clock_words

_PORT = 80  # of the HTTP interface
_SLOW = 30.0  # time that the sonar may take to change a setting, or to reach an NTP server [s]
_RIGHT = "right"  # a clock that differs from this computer's by `CLOCK_OFF` at most


def _read_clock(sonar: Sonar3D) -> str:
    status = sonar.get_time_status()
    offset = (status.system_time - datetime.now(UTC)).total_seconds()
    by = f", set by {status.ntp_synced_to}" if status.ntp_synced else ""
    return _RIGHT if abs(offset) <= CLOCK_OFF else f"{clock_words(offset)} this computer's{by}"


def _set_clock(sonar: Sonar3D, _: str) -> None:
    if not sonar.force_sync_ntp(_SLOW).success:
        sonar.set_time_manual(datetime.now(UTC))


_get_speed, _set_speed = Sonar3D.get_speed_of_sound, Sonar3D.set_speed_of_sound
_get_imu, _set_imu = Sonar3D.get_output_imu_batch_enabled, Sonar3D.set_output_imu_batch_enabled
_SETTINGS: dict[str, Any] = {  # functions that read it, write it, and put its value in words
    "NTP server": (lambda s: s.get_time_ntp().ntp_address, lambda s, ntp: s.set_time_ntp(NTPConfiguration(ntp)), str),
    "water": (Sonar3D.get_salinity, Sonar3D.set_salinity, str),
    "speed of sound": (_get_speed, _set_speed, lambda speed: f"{speed:g} m/s" if speed else "automatic"),
    "range": (Sonar3D.get_range, lambda s, r: s.set_range(*r), lambda r: f"{r[0]:g} to {r[1]:g} m"),
    "IMU batches": (_get_imu, _set_imu, lambda is_on: "on" if is_on else "off"),
    "clock": (_read_clock, _set_clock, str),
}
_ALWAYS = {"IMU batches": True, "clock": _RIGHT}  # wanted of every sonar whose firmware has them


def configure(address: str, wanted: Mapping[str, Any]) -> list[str]:
    """Change the settings of a sonar to the `wanted` ones by name, switch on its IMU batches and set its clock. Returns
    the changes, as "range: 0 to 15 m -> 1 to 12 m". Raises InputError."""
    changes = list[str]()
    try:
        sonar = Sonar3D(address, _PORT)
        sonar.timeout = _SLOW
        for name, before, value in list(_differing(sonar, wanted)):  # all are read before the first is changed
            read, write, words = _SETTINGS[name]
            write(sonar, value)
            changes.append(f"{name}: {before} -> {words(read(sonar))}")
    except Exception as error:
        changed = f"Changed before that: {', '.join(changes) or 'nothing'}"
        advice = "Give its address with --sonar, other settings, or leave out --configure"
        raise InputError(f"cannot set up the sonar at {address}: {_reason(error)}. {changed}. {advice}") from error
    return changes


def _differing(sonar: Sonar3D, wanted: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Name, value in words and wanted value of each setting that differs from the wanted one."""
    for name, value in {**wanted, **_ALWAYS}.items():
        read, _, words = _SETTINGS[name]
        try:
            has = words(read(sonar))
        except VersionException:
            if name in wanted:
                raise
        else:
            if has != words(value):
                yield name, has, value


def check(wanted: Mapping[str, Any], address: str) -> deque[str]:
    """Begin to check the settings of a sonar, in a thread, as it may answer late or never. The thread adds a warning of
    each wrong setting to the deque that is returned."""
    warnings = deque[str]()

    def run() -> None:
        try:
            warnings.extend(_faults(Sonar3D(address, _PORT), wanted))
        except Exception as error:  # noqa: BLE001 - whatever answers there, the recording goes on
            warnings.append(f"the sonar's settings are not checked: {_reason(error)}")

    Thread(target=run, name="settings", daemon=True).start()
    return warnings


def _faults(sonar: Sonar3D, wanted: Mapping[str, Any]) -> Iterator[str]:
    if not sonar.get_acoustics_enabled():
        yield "the sonar's acoustics are off: switch them on, on its web page, once it is under water"
    speed = sonar.get_speed_of_sound()
    is_possible = speed == 0 or (1400 < speed < 1550 and speed != 1491)  # 0 is automatic, 1,491 that of a new sonar
    if not is_possible and "speed of sound" not in wanted:
        yield (
            f"the sonar computes ranges with {speed:,.0f} m/s; a new one has 1,491. Fresh water of 10 degrees has "
            "1,447 m/s, and sea water 1,490: give --configure with --water or --sound-speed"
        )
    for name, has, value in _differing(sonar, wanted):
        yield f"the sonar's {name}: {has}, wanted {_SETTINGS[name][2](value)}; --configure sets it"


def _reason(error: Exception) -> str:
    """Why the sonar gave no answer, or its own words; wlsonar wraps the errors of requests."""
    cause = error.__cause__ or error
    response = getattr(cause, "response", None)
    if response is not None:
        return f"its HTTP interface answers {response.status_code}: {' '.join(response.text.split())[:200]}"
    if isinstance(cause, OSError) and not isinstance(cause, ValueError):  # that is an answer, but not JSON
        return "its HTTP interface does not answer"
    return str(error) if isinstance(error, VersionException) else f"its firmware answers unexpectedly ({error!r})"
