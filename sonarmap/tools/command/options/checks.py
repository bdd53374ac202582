"""Checks of options' values, and the options that come with one: a length, one of several names."""

import math
from collections.abc import Callable, Iterable
from typing import Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.options.option import completes, option


def checked(fits: Callable[[Any], bool], wanted: str) -> Callable[[Any], Any]:
    """A check of an option: None passes, and so does a value that `fits`; of another one `wanted` is said, {} standing
    for it."""

    def check(value: Any) -> Any:
        if value is None or fits(value):
            return value
        raise typer.BadParameter(wanted.format(value))

    return check


def refused_by(parse: Callable[[Any], object]) -> Callable[[Any], Any]:
    """A check of an option: what `parse` takes, or None; what it says of a value that it does not take is shown."""

    def check(value: Any) -> Any:
        try:
            if value is not None:
                parse(value)
        except InputError as error:
            raise typer.BadParameter(as_options(str(error))) from error
        return value

    return check


def is_positive(number: float) -> bool:
    """Whether it is finite and above 0."""
    return 0 < number < math.inf


def length(panel: str, words: str, without: str, *, shown: str | bool | None = None, **more: Any) -> Any:
    """A field that is an option with a length above 0 [m]; `without` is what counts where it is not given, which the
    help shows, unless `shown` says otherwise."""
    wanted = "{} m; give a length above 0, or leave it out" + (f" for {without}" if without else "")
    shown = without if shown is None else shown
    return option(panel, "M", words, callback=checked(is_positive, wanted), shown=shown, **more)


def choice(panel: str, words: str, names: Iterable[str], metavar: str = "NAME", **more: Any) -> Any:
    """A field that is an option with one of several names, the first of them where it is not given."""
    names = tuple(names)
    wanted = f"{{!r}}; choose one of {', '.join(names)}, or leave it out for {names[0]}"
    check = checked(names.__contains__, wanted)
    return option(panel, metavar, words, names[0], callback=check, autocompletion=completes(names), **more)
