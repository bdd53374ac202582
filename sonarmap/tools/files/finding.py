"""What is wrong with the sonar or the navigation, and options that correct it."""

from typing import NamedTuple


class Remedy(NamedTuple):
    """An option of `sonarmap map` that corrects a fault of the data."""

    option: str  # name with underscores, such as range_scale
    values: tuple[str, ...]  # as typed; the option is given once for each

    def __str__(self) -> str:
        return " ".join(f"--{self.option.replace('_', '-')} {value}" for value in self.values)


class Finding(NamedTuple):
    """A fault in one sentence, with the remedies that can be tried, best first."""

    words: str
    remedies: tuple[Remedy, ...] = ()
