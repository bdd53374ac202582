"""What someone who records is warned of, once each: silence, a full disk, a wrong clock, other senders, losses."""

from collections.abc import Iterator

from sonarmap.tools.command.record.recorder import Status
from sonarmap.tools.command.record.source import Source
from sonarmap.tools.command.record.words import clock_words, lasting, sized

_SILENT = 5.0  # seconds
_DISK_SHORT, _DISK_ENDS = 600.0, 60.0  # seconds that the disk lasts
_CLOCK_OFF = 1.0  # [s]; a second is a meter of a vehicle's way
_SMALL_BUFFER = 2 << 20  # bytes; Linux counts a datagram double, and the sonar sends up to 10 Mbit/s
_SETTLED = 3.0  # seconds after which rates and the clock are known


class Watch:
    """Looks at a recording each second; a warning comes once, that of silence each time that packets cease to come."""

    def __init__(self) -> None:
        self._warned = set[str]()
        self._is_silent = False

    def warnings(self, status: Status) -> Iterator[str]:
        """What is new, a sentence or some each."""
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
    return (
        f"no packet{wanted} has come {silent} at {source.words}. Check that the sonar is on and its acoustics are "
        f"enabled; {_sends_words(source)}; that this computer's network interface is up and has an address in the "
        "sonar's network (192.168.194.90, say, for a sonar at its fallback address 192.168.194.96); and that no "
        f"firewall blocks UDP port {source.port}. The recording waits."
    )


def _sends_words(source: Source) -> str:
    if source.address.is_multicast:
        return (
            "that its settings say UDP multicast (where they say unicast, give --unicast 0.0.0.0:PORT with their port)"
        )
    return f"that its settings say UDP unicast to this computer's address, port {source.port}"


def _faults(status: Status) -> Iterator[tuple[str, str]]:
    """What is wrong now, by a name under which it is said once."""
    yield from _computer_faults(status)
    yield from _disk_faults(status)
    yield from _sender_faults(status)
    offset = status.tally.clock.latest
    if offset is not None and abs(offset) > _CLOCK_OFF and status.seconds > _SETTLED:
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
        yield "unsaved", f"the disk of {status.path.parent} is too slow: packets were lost while it was waited for"


def _disk_faults(status: Status) -> Iterator[tuple[str, str]]:
    lasts, duration = status.disk_lasts, status.settings.duration
    if lasts is None or status.seconds < _SETTLED:
        return
    left = None if duration is None else duration - status.seconds
    words = f"the disk of {status.path.parent} is full in {lasting(lasts)} ({sized(status.disk)} left)"
    if left is not None and lasts < left:
        yield "disk", f"{words}, and the recording is to go on for {lasting(left)}"
    elif left is None and lasts < _DISK_SHORT:
        yield "disk", words
    if lasts < _DISK_ENDS and (left is None or lasts < left):
        yield "disk ends", f"{words}: make room now, or end the recording"
