"""What a check has to say."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Verdict = Literal["ok", "warning", "wrong"]
VERDICTS: tuple[Verdict, ...] = ("ok", "warning", "wrong")  # the worst last


@dataclass(frozen=True, slots=True)
class Remedy:
    """What to do."""

    words: str  # a sentence, or the beginning of the command's
    command: str = ""  # to be pasted into a shell; "" where there is none


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    verdict: Verdict  # "wrong" where something that is needed does not work, "warning" where part of it may not
    seen: str  # what was seen, in words; parts that stand for themselves are separated by line breaks
    remedies: tuple[Remedy, ...] = ()  # what to do, the best first; none where all is well
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])  # the same for programs, of JSON's types
    check: str = ""  # what was looked at, in a word or two


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The worst of several verdicts; "ok" of none."""
    return max((VERDICTS[0], *verdicts), key=VERDICTS.index)


def size(count: float) -> str:
    """Bytes in words, three digits."""
    for unit, scale in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if count >= scale:
            number = count / scale
            return f"{number:,.0f} {unit}" if number >= 10 else f"{number:.1f} {unit}"
    return f"{count:.0f} bytes"
