"""Counts, sizes and durations as text."""


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number and a noun: "1 scan", "1,200 scans"."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {plural or noun + 's'}"


def sized(size: int) -> str:
    """A size in bytes, as in "488 MiB" or "2.3 GiB"."""
    for unit, scale in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if size >= scale:
            return f"{size // scale:,} {unit}" if size >= 10 * scale else f"{size / scale:.1f} {unit}"
    return f"{size:.0f} bytes"


def lasting(seconds: float) -> str:
    """A duration, as in "41 s", "12 min", "3 h 05 min" or "4 days"."""
    minutes = round(seconds / 60)
    if seconds < 100:
        return f"{seconds:.0f} s"
    if minutes >= 48 * 60:
        return f"{minutes / 1440:,.0f} days"
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
