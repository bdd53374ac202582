# pyright: strict
"""Latitudes and longitudes as people write them."""

import re
from contextlib import suppress

_NUMBER = r"(\d+(?:\.\d*)?)"
_ANGLE = re.compile(rf"([+-]?){_NUMBER}\s*[°º:\s]\s*{_NUMBER}\s*(?:['′’:]|\s|$)\s*(?:{_NUMBER}\s*(?:\"|″|”|'')?)?")


def degrees_of(text: str, letters: str) -> float:
    """Degrees of 60.3913, 60°23.478'N, 60 23 28.7 N or N60:23.478; `letters` are of both directions, the positive
    first. Raises ValueError: it is none of these, minutes or seconds are not below 60, or a letter is another."""
    with suppress(ValueError):
        return float(text)
    plain = text.strip().upper()
    letter = next((each for each in letters if plain.startswith(each) or plain.endswith(each)), "")
    plain = plain.strip(letter).strip() if letter else plain
    if letter and plain[:1] in "+-":
        raise ValueError(f"{text.strip()!r} has a sign and a letter")
    if not letter and {plain[:1], plain[-1:]} & set("NSEW"):
        raise ValueError(f"{text.strip()!r} has no letter of {letters}; the latitude is first")
    sign = -1.0 if letter == letters[1] else 1.0
    match = _ANGLE.fullmatch(plain)
    if match is None:
        return sign * float(plain.rstrip("°º "))
    minus, degrees, minutes, seconds = match.groups()
    parts = float(minutes), float(seconds or 0)
    if max(parts) >= 60 or "." in degrees or (seconds and "." in minutes):
        raise ValueError(f"in {text.strip()!r} minutes and seconds have to be below 60, and only the last has decimals")
    return sign * (-1.0 if minus == "-" else 1.0) * (float(degrees) + parts[0] / 60 + parts[1] / 3600)


def place_of(text: str) -> list[float]:
    """Latitude, longitude [deg], and the numbers that follow, of "60.3913,5.3221" or "60°23.478'N, 5°19.326'E, 2.5".
    Raises ValueError: a part cannot be read."""
    parts = text.split(",")
    angles = [degrees_of(part, letters) for part, letters in zip(parts, ("NS", "EW"), strict=False)]
    return [*angles, *map(float, parts[2:])]
