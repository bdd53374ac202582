"""A recording in words: the lines that are shown while it goes on, what is said at its end, and the same as JSON."""

from typing import Any

from sonarmap.tools.command.record.recorder import Status
from sonarmap.tools.command.record.tally import IMU, RANGES, SHADED, STRENGTHS, ClockOffset

_PLAIN = {
    RANGES: ("shot", "shots"),
    STRENGTHS: ("strength image", "strength images"),
    SHADED: ("shaded image", "shaded images"),
    IMU: ("IMU batch", "IMU batches"),
}
_DRIFTED = 0.05  # [s], by which a clock's offset changes


def status_lines(status: Status) -> tuple[str, str]:
    """How it goes, in two lines of about 80 columns at most."""
    tally, offset = status.tally, status.tally.clock.latest
    if not tally.packets:
        return f"recording {clock_time(status.seconds)}: waiting for packets", f"at {status.settings.source.words}"
    lasts = "" if status.disk_lasts is None else f", for {lasting(status.disk_lasts)}"
    lost_here = status.unsaved + status.overflow
    lost = f", lost here {lost_here:,}" if lost_here else ""
    clock = "unknown" if offset is None else _signed(offset)
    imu = "IMU" if tally.kinds[IMU].came else "no IMU"
    return (
        f"recording {clock_time(status.seconds)}: {status.shot_rate:.1f} shots/s, {status.packet_rate:.0f} packets/s; "
        f"missing {tally.missing:,} ({100 * tally.missing_share:.1f} %){lost}",
        f"damaged {status.senders.damaged:,}; clock {clock}; {imu}; {sized(status.size)} written; "
        f"disk {sized(status.disk)}{lasts}",
    )


def end_lines(status: Status) -> list[str]:
    """What was recorded, a line each."""
    tally, senders = status.tally, status.senders
    missing = [
        f"{counted.numbers.missing:,} {_PLAIN[kind][counted.numbers.missing != 1]}"
        for kind, counted in tally.kinds.items()
        if counted.came
    ]
    share = f"{100 * tally.missing_share:.2f} % of the packets"
    imu = "IMU recorded" if tally.kinds[IMU].came else "no IMU batches: enable them in its settings"
    return [
        f"{status.path}: {tally.shots:,} shots in {clock_time(status.seconds)}, {sized(status.size)}",
        f"missing by their numbers: {', '.join(missing)}, {share}",
        f"lost in this computer: {status.unsaved + status.overflow:,}; damaged: {senders.damaged:,}",
        f"sonar {senders.sonar}; {_clock_at_the_end(tally.clock)}; {imu}",
    ]


def _clock_at_the_end(clock: ClockOffset) -> str:
    if clock.first is None or clock.latest is None:
        return "its packets have no time"
    drifted = abs(clock.latest - clock.first) > _DRIFTED
    start = f", and was {clock_words(clock.first)} it at the start" if drifted else ""
    return f"its clock is {clock_words(clock.latest)} this computer's{start}"


def as_json(status: Status) -> dict[str, Any]:
    """All of it in JSON's types; null for what is not known."""
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
        "clock_offset_s": {"first": tally.clock.first, "last": tally.clock.latest},
        "longest_silence_s": round(status.longest_silence, 3),
        "disk_left_bytes": status.disk,
        "receive_buffer_bytes": status.buffer,
    }


def clock_words(offset: float) -> str:
    """As in "0.21 s behind"; the sonar's clock against this computer's [s]."""
    amount = f"{abs(offset):,.2f} s" if abs(offset) < 86400 else f"{abs(offset) / 86400:,.0f} days"
    return f"{amount} {'ahead of' if offset > 0 else 'behind'}"


def _signed(offset: float) -> str:
    return f"{offset:+.2f} s" if abs(offset) < 86400 else "days off"


def clock_time(seconds: float) -> str:
    """As in 0:12:34."""
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def lasting(seconds: float) -> str:
    """A time that is about right, as in 40 s, 12 min, 7 h, 3 days."""
    for most, unit, name in ((120, 1, "s"), (7200, 60, "min"), (172800, 3600, "h")):
        if seconds < most:
            return f"{seconds / unit:.0f} {name}"
    return f"{seconds / 86400:,.0f} days"


def sized(size: float) -> str:
    """As in 3.2 MB or 47 GB."""
    for most, unit, name in ((1e6, 1e3, "kB"), (1e9, 1e6, "MB")):
        if size < most:
            return f"{size / unit:.1f} {name}"
    return f"{size / 1e9:.1f} GB" if size < 1e11 else f"{size / 1e9:,.0f} GB"
