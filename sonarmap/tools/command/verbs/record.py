"""`sonarmap record`: record a Sonar 3D-15 from the network to a file."""

import math
import re
import signal
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path
from threading import Event, Timer
from typing import TYPE_CHECKING, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import INPUT, OUTPUT, REQUIRED, RUNNING, JsonOption, QuietOption, checked, refused_by
from sonarmap.tools.command.terminal import print_json, printable, say, status_line, warn

if TYPE_CHECKING:
    from sonarmap.tools.command.record.receiver import Source
    from sonarmap.tools.command.record.recorder import Status

NOTHING_CAME = 3
_UNITS = {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}


def _seconds(text: str) -> float:
    """Seconds of a duration such as 10m; 0 for invalid text."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", text, re.ASCII)
    return float(match[1]) * _UNITS[match[2]] if match else 0.0


def _require_address(text: str) -> None:
    try:
        IPv4Address(text)
    except AddressValueError as error:
        raise InputError(f"{text!r}; give an IPv4 address, as in --sonar 192.168.194.96.") from error


@dataclass(frozen=True, slots=True)
class Listening:
    """Options of receiving packets: addresses and duration."""

    multicast: str | None = INPUT.option("GROUP:PORT", "Multicast group to listen to.", shown="224.0.0.96:4747")
    unicast: str | None = INPUT.option(
        "ADDRESS:PORT",
        "For a sonar that sends to this computer alone: an address of this computer, or 0.0.0.0 for all, and the port "
        "in the sonar's settings.",
    )
    interface: str | None = INPUT.option(
        "NAME", "Network interface to listen on, by name or address.", rare=True, shown="all"
    )
    sonar: str | None = INPUT.option(
        "ADDRESS",
        "Address of the sonar to record.",
        callback=refused_by(_require_address),
        shown="the first that sends",
    )
    duration: str | None = RUNNING.option(
        "TIME",
        "End after this time: 90 (s), 10m, 1.5h.",
        callback=checked(
            lambda text: _seconds(text) > 0,
            "{!r}; give seconds, minutes or hours above 0, as in --duration 90, 10m or 1.5h.",
        ),
        shown="until Ctrl-C",
    )

    @property
    def source(self) -> "Source":
        """The addresses to listen at."""
        from sonarmap.tools.command.record.receiver import source_of

        return source_of(self.multicast, self.unicast, self.interface)

    @property
    def seconds(self) -> float | None:
        """Duration [s]; None to record until Ctrl-C."""
        return None if self.duration is None else _seconds(self.duration)

    def as_options(self) -> list[str]:
        """The same as words of a command line, without the duration."""
        given = {name: getattr(self, name) for name in ("multicast", "unicast", "interface", "sonar")}
        return [word for name, value in given.items() if value is not None for word in (f"--{name}", value)]


@dataclass(frozen=True, slots=True)
class SetupOptions:
    """Options of the sonar's settings."""

    configure: bool = INPUT.flag(
        "--configure", "Set the sonar's IMU, its clock and the options below, for good; without it they are compared."
    )
    ntp: str | None = INPUT.option("ADDRESS", "NTP server for the sonar, or auto for servers of the internet.")
    water: str | None = INPUT.option(
        "NAME",
        "Water, fresh or salt, for which the sonar computes the speed of sound.",
        callback=checked(("fresh", "salt").__contains__, "{!r}; choose fresh or salt, or leave it out"),
    )
    sound_speed: float | None = INPUT.option("M/S", "Speed of sound for the sonar \\[m/s].", min=1000, max=2000)
    range: tuple[float, float] | None = INPUT.option(
        "MIN MAX",
        "Range for the sonar \\[m].",
        callback=checked(lambda r: 0 <= r[0] < r[1] < math.inf, "{}; give two in meters, as in --range 0.5 15"),
    )

    @property
    def wanted(self) -> dict[str, Any]:
        """The wanted settings, by name."""
        speed = 0.0 if self.sound_speed is None and self.water is not None else self.sound_speed
        settings = {"NTP server": self.ntp, "water": self.water, "speed of sound": speed, "range": self.range}
        return {name: value for name, value in settings.items() if value is not None}


def command(
    listening: Listening,
    setup: SetupOptions,
    out: Path = OUTPUT.option("FILE.sonar", "The recording.", REQUIRED, "-o", "--out"),
    overwrite: bool = OUTPUT.flag("--overwrite", "Replace FILE.sonar if it is there."),
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Record what a Sonar 3D-15 sends over the network.

    It ends with Ctrl-C or --duration. It warns of wrong settings of the sonar, and changes them only with --configure.
    Each second it prints how many packets arrive and are missing, the offset of the sonar's clock, whether the IMU is
    recorded, and how long the disk lasts. Until the end the file is called FILE.part.sonar; it remains after a crash
    or on a full disk, and can be read. The exit code is 3 if no packet was received.
    """
    from wlsonar import FALLBACK_IP

    from sonarmap.tools.command.record.recorder import RecordSettings, record, require_free
    from sonarmap.tools.command.record.setup import check, configure
    from sonarmap.tools.command.record.words import Watch, end_lines, status_lines
    from sonarmap.tools.command.record.words import as_json as in_json

    source, watch, silent = listening.source, Watch(), quiet or as_json
    checked_once = cache(partial(check, setup.wanted))  # by the sonar's address
    settings = RecordSettings(source, out, listening.seconds, listening.sonar, overwrite)

    def follow(status: "Status") -> None:
        if not status.ticks and not silent:
            say(f"listening at {source.words}; until the end the recording is in {status.path}")
        sonar = listening.sonar or status.senders.sonar
        of_settings = checked_once(sonar) if sonar else deque[str]()
        warnings = [of_settings.popleft() for _ in range(len(of_settings))]
        show(status_lines(status), [*warnings, *watch.warnings(status)], "recording")

    require_free(out, overwrite)  # before anything is changed in the sonar
    changes = configure(listening.sonar or FALLBACK_IP, setup.wanted) if setup.configure else []
    for change in changes if not as_json else ():
        say(f"changed in the sonar, for good: {change}")
    with ending() as stop, status_line(silent) as show:
        status = record(settings, follow, stop)
    if as_json:
        print_json(in_json(status) | {"changed": changes})
    if not status.tally.packets:
        warn(f"no packet was received in {status.seconds:.0f} s at {source.words}; no file was written")
        raise typer.Exit(NOTHING_CAME)
    if not as_json:
        for line in end_lines(status):
            typer.echo(printable(line))
        typer.echo(f"\nnext: sonarmap inspect {printable(str(out))}")


@contextmanager
def ending(after: float | None = None) -> Iterator[Event]:
    """An event that Ctrl-C, SIGTERM and a closed terminal set, or the time `after` [s]. Signals that nohup or the shell
    ignores stay ignored."""
    stop = Event()
    timer = Timer(after or 0.0, stop.set)
    if after is not None:
        timer.daemon = True
        timer.start()
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    handled = [each for each, previous in before.items() if previous != signal.SIG_IGN]
    for each in handled:
        signal.signal(each, lambda *_: stop.set())
    try:
        yield stop
    finally:
        timer.cancel()
        for each in handled:
            signal.signal(each, before[each])
