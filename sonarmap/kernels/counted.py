# pyright: strict
"""Numbers of things in words."""


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number and a noun: "1 scan", "1,200 scans"."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {plural or noun + 's'}"
