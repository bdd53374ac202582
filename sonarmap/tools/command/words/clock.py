"""The times of scans, or of a log's rows, in words and as JSON."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sonarmap.tools.files.readers.checks import Clock


def clock_json(clock: "Clock") -> dict[str, Any]:
    """A clock as JSON has it."""
    from sonarmap.tools.files.readers.checks import utc

    return {
        "start": clock.start,
        "end": clock.end,
        "start_utc": utc(clock.start),
        "end_utc": utc(clock.end),
        "rate_hz": clock.rate,
        "gaps": clock.gaps,
        "longest_step_s": clock.longest,
        "not_ascending": clock.backward,
        "stands_still": clock.stands_still,
    }


def span_words(clock: "Clock") -> str:
    """From when to when."""
    from sonarmap.tools.files.readers.checks import utc

    lasts = f"{clock.end - clock.start:,.1f} s"
    if clock.is_set:
        return f"{utc(clock.start)} to {utc(clock.end)} UTC, {lasts}"
    return f"{clock.start:.10g} to {clock.end:.10g} s, {lasts}; not UTC"


def rate_words(clock: "Clock", what: str) -> str:
    """How many a second, and where there are none; `what` they are, as "scans"."""
    if clock.rate is None:
        return "not known: the stamps stand still, or do not ascend"
    gaps = "no gaps" if not clock.gaps else f"gaps: {clock.gaps:,}, the longest {clock.longest:.3g} s"
    back = f"; {clock.backward:,} stamps are not later than the one before" if clock.backward else ""
    return f"{clock.rate:.3g} {what} per second, {gaps}{back}"
