"""Messages of a recording: status lines, warnings (silence, a full disk, a wrong clock, other senders, losses), the
summary at its end, and the same as JSON."""

from collections.abc import Iterator
from datetime import timedelta
from typing import Any

from sonarmap.kernels.counted import lasting, sized
from sonarmap.tools.command.record.recorder import IMU, RANGES, SHADED, STRENGTHS, Status

_PLAIN = {
    RANGES: ("shot", "shots"),
    STRENGTHS: ("strength image", "strength images"),
    SHADED: ("shaded image", "shaded images"),
    IMU: ("IMU batch", "IMU batches"),
}
_SILENT = 5.0  # silence that is reported [s]
_DISK_SHORT = 600.0  # time until the disk is full that is reported [s]
_DISK_ENDS = 60.0  # time until the disk is full that is urgent [s]
CLOCK_OFF = 1.0  # offset of a clock that is reported [s]: a vehicle moves a meter meanwhile
_SMALL_BUFFER = 2 << 20  # reported size [bytes]; Linux counts a datagram double, and the sonar sends up to 10 Mbit/s
_SETTLED = 3.0  # time after which rates and the clock's offset are reliable [s]


def status_lines(status: Status) -> tuple[str, str]:
    """The status in two lines of about 80 columns at most."""
    tally, offset = status.tally, status.tally.clock.latest
    elapsed = timedelta(seconds=int(status.seconds))
    if not tally.packets:
        return f"recording {elapsed}: waiting for packets", f"at {status.settings.source.words}"
    lasts = "" if status.disk_lasts is None else f", for {lasting(status.disk_lasts)}"
    lost_here = status.unsaved + status.overflow
    lost = f", lost here {lost_here:,}" if lost_here else ""
    clock = "unknown" if offset is None else f"{offset:+.2f} s" if abs(offset) < 86400 else "days off"
    imu = "IMU" if tally.kinds[IMU].came else "no IMU"
    return (
        f"recording {elapsed}: {status.shot_rate:.1f} shots/s, {status.packet_rate:.0f} packets/s; "
        f"missing {tally.missing:,} ({100 * tally.missing_share:.1f} %){lost}",
        f"damaged {status.senders.damaged:,}; clock {clock}; {imu}; {sized(status.size)} written; "
        f"disk {sized(status.disk)}{lasts}",
    )


def end_lines(status: Status) -> list[str]:
    """Lines that summarize the finished recording."""
    tally, senders = status.tally, status.senders
    missing = [
        f"{counted.numbers.missing:,} {_PLAIN[kind][counted.numbers.missing != 1]}"
        for kind, counted in tally.kinds.items()
        if counted.came
    ]
    share = f"{100 * tally.missing_share:.2f} % of the packets"
    offset = tally.clock.latest
    clock = "its packets have no time" if offset is None else f"its clock is {clock_words(offset)} this computer's"
    imu = "IMU recorded" if tally.kinds[IMU].came else "no IMU batches: enable them in its settings"
    return [
        f"{status.path}: {tally.shots:,} shots in {timedelta(seconds=int(status.seconds))}, {sized(status.size)}",
        f"missing by their numbers: {', '.join(missing)}, {share}",
        f"lost in this computer: {status.unsaved + status.overflow:,}; damaged: {senders.damaged:,}",
        f"sonar {senders.sonar}; {clock}; {imu}",
    ]


def as_json(status: Status) -> dict[str, Any]:
    """The status in JSON's types; None for unknown values."""
    tally, senders = status.tally, status.senders
    return {
        "file": str(status.path) if tally.packets else None,
        "bytes": status.size,
        "seconds": round(status.seconds, 3),
        "source": status.settings.source.words,
        "sonar": senders.sonar,
        "packets": tally.packets,
        "kinds": {
            kind: {
                "came": counted.came,
                "missing": counted.numbers.missing,
                "late": counted.numbers.late,
                "doubled": counted.doubled,
                "restarts": counted.numbers.restarts,
            }
            for kind, counted in tally.kinds.items()
        },
        "undocumented": tally.undocumented,
        "unreadable": tally.unreadable,
        "damaged": senders.damaged,
        "foreign": senders.foreign,
        "other_sonars": {"packets": senders.others, "addresses": senders.addresses},
        "lost_here": {"receive_buffer": status.overflow, "disk": status.unsaved},
        "clock_offset_s": tally.clock.latest,
        "disk_left_bytes": status.disk,
        "receive_buffer_bytes": status.buffer,
    }


def clock_words(offset: float) -> str:
    """Offset of the sonar's clock from this computer's [s] in words, such as "0.21 s behind"."""
    amount = f"{abs(offset):,.2f} s" if abs(offset) < 86400 else f"{abs(offset) / 86400:,.0f} days"
    return f"{amount} {'ahead of' if offset > 0 else 'behind'}"


class Watch:
    """Warnings of a recording: each fault once, but silence whenever it begins."""

    def __init__(self) -> None:
        self._warned = set[str]()
        self._is_silent = False

    def warnings(self, status: Status) -> Iterator[str]:
        """The new warnings."""
        was_silent, self._is_silent = self._is_silent, status.silence > _SILENT
        if self._is_silent and not was_silent:
            yield _silence_words(status)
        for name, words in _faults(status):
            if name not in self._warned:
                self._warned.add(name)
                yield words


def _silence_words(status: Status) -> str:
    silent = f"for {status.silence:.0f} s"
    if status.tally.packets:
        return f"nothing has come {silent}. Look at the sonar's power and its cable; the recording continues."
    source = status.settings.source
    wanted = f" of a sonar at {status.settings.sonar}" if status.settings.sonar else ""
    sends = "multicast" if source.address.is_multicast else f"unicast to this computer's address, port {source.port}"
    return (
        f"no packet{wanted} has come {silent} at {source.words}. Check that the sonar is on, its acoustics are enabled "
        f"and its settings say UDP {sends}; that this computer has an address in the sonar's network, 192.168.194.90 "
        f"say; and that no firewall blocks UDP port {source.port}. The recording waits."
    )


def _faults(status: Status) -> Iterator[tuple[str, str]]:
    """The present faults: the name under which a fault is reported once, and its warning."""
    yield from _computer_faults(status)
    yield from _disk_faults(status)
    yield from _sender_faults(status)
    offset = status.tally.clock.latest
    if offset is not None and abs(offset) > CLOCK_OFF and status.seconds > _SETTLED:
        words = (
            f"the sonar's clock is {clock_words(offset)} this computer's: set both clocks by NTP. Logs with this "
            f"computer's times fit by --nav-offset={offset:.2f}."
        )
        yield "clock", words


def _sender_faults(status: Status) -> Iterator[tuple[str, str]]:
    senders = status.senders
    if senders.others:
        recorded = senders.sonar or status.settings.sonar
        words = f"another sonar sends too ({', '.join(senders.addresses)}); only packets of {recorded} are recorded"
        yield "others", f"{words}. Give --sonar ADDRESS to choose."
    if senders.moves:
        yield f"moves {senders.moves}", f"the sonar's packets now come from {senders.sonar}; they are recorded too"
    if senders.foreign:
        yield "foreign", f"datagrams that are not of a Sonar 3D-15 are left out; the first {senders.first_foreign}"
    if senders.damaged:
        yield "damaged", f"damaged packets are left out; the first {senders.first_damage}"


def _computer_faults(status: Status) -> Iterator[tuple[str, str]]:
    if status.buffer < _SMALL_BUFFER:
        words = (
            f"the system's receive buffer holds {sized(status.buffer)} only, and packets may be lost while this "
            "computer is busy; on Linux `sudo sysctl -w net.core.rmem_max=16777216` allows more"
        )
        yield "buffer", words
    if status.overflow:
        yield "overflow", "this computer is too busy: packets were lost in the system's receive buffer"
    if status.unsaved:
        yield "unsaved", f"the disk of {status.path.parent} is too slow: packets were lost meanwhile"


def _disk_faults(status: Status) -> Iterator[tuple[str, str]]:
    lasts, duration = status.disk_lasts, status.settings.duration
    if lasts is None or status.seconds < _SETTLED:
        return
    left = None if duration is None else duration - status.seconds
    words = f"the disk of {status.path.parent} is full in {lasting(lasts)} ({sized(status.disk)} left)"
    if lasts < (_DISK_SHORT if left is None else left):
        yield "disk", words if left is None else f"{words}, and the recording is to go on for {lasting(left)}"
        if lasts < _DISK_ENDS:
            yield "disk ends", f"{words}: make room now, or end the recording"
