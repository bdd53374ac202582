"""Settings from a file: `sonarmap --config FILE VERB ...`.

The file is TOML with a section per verb and an option per line, as `grid = 96` under [map]. Its values take the place
of the verb's defaults; the command line counts for more.
"""

import reprlib
import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_type_hints

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.terminal import say, shortened
from sonarmap.tools.files.user_file import require_file

ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Take options from a TOML file: a section per verb, as grid = 96 under \\[map].",
        show_default=False,
    ),
]
_MOST_BYTES = 1 << 16
_LONGEST_LINE = 1000  # a key of n parts takes a time and a memory of n squared, and a number's digits are limited
_LONGEST_VALUE = 80  # characters of a value that is printed


def use_settings(context: typer.Context, path: Path | None) -> None:
    """Have the verb that is about to run take its defaults from a file. Raises InputError: the file cannot be used."""
    if path is not None:
        verbs: Any = context.command
        context.default_map = read_settings(path, verbs.commands, context.invoked_subcommand)


def say_settings(context: Any) -> None:
    """Say which options of the verb that is about to run came from the file."""
    values = [
        f"{_key(parameter)} {shortened(_in_words(context.params[parameter.name]), _LONGEST_VALUE)}"
        for parameter in context.command.params
        if getattr(context.get_parameter_source(parameter.name), "name", "") == "DEFAULT_MAP"
    ]
    if values and not context.params.get("quiet"):
        say(f"settings from {context.parent.params['config']}: {', '.join(values)}")


def read_settings(path: Path, verbs: Mapping[str, Any], verb: str | None) -> dict[str, dict[str, Any]]:
    """The values in a file, by the verb and by the name of its parameter.

    Args:
        path: of the file.
        verbs: Typer's commands by their names.
        verb: whose values are checked as the command line checks them; None for all. Keys and types are always checked.

    Raises:
        InputError: the file, the key and the value, and what was wanted.
    """
    values: dict[str, dict[str, Any]] = {}
    for section, lines in _content(path).items():
        if not isinstance(lines, dict):
            raise InputError(f"{path}: {section} stands outside of a section; put it under a verb's, as [map]")
        if section not in verbs:
            raise InputError(f"{path}: [{section}] is not a verb{_nearest(section, verbs)}")
        options = {_key(each): each for each in verbs[section].params if each.param_type_name == "option"}
        values[section], hints = {}, get_type_hints(verbs[section].callback)
        for name, value in lines.items():
            key = name.replace("_", "-")
            if key not in options:
                raise InputError(f"{path}: [{section}] {name} is not an option of {section}{_nearest(key, options)}")
            where = f"{path}: [{section}] {name} is {reprlib.repr(value)}"
            typed = _typed(where, value, options[key], hints[options[key].name])
            if verb in (None, section):
                _check(where, typed, options[key], verbs[section])
            values[section][options[key].name] = typed
    return values


def _content(path: Path) -> dict[str, Any]:
    require_file(path, pipe=True)
    try:
        with path.open("rb") as file:
            raw = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"cannot read the settings {path}: {error.strerror or error}") from error
    if len(raw) > _MOST_BYTES:
        raise InputError(f"{path} has more than {_MOST_BYTES >> 10} KiB and cannot be a file of settings")
    if long := next((n for n, line in enumerate(raw.splitlines(), 1) if len(line) > _LONGEST_LINE), None):
        raise InputError(f"{path}: line {long} has more than {_LONGEST_LINE} characters; fix that line")
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # TOML's, and of bytes that are no UTF-8
        raise InputError(f"{path} is no TOML file: {error}. Fix that line") from error


def _typed(where: str, value: Any, option: Any, annotation: Any) -> Any:
    """The value, if it is of the option's type; a number may be written without a decimal point."""
    kind, wanted = _KINDS.get(_plain(annotation), (str, "a text in quotes"))
    several = isinstance(value, list) and option.multiple
    values = value if several else [value]
    if not all(isinstance(each, kind) and (isinstance(each, bool) == (kind is bool)) for each in values):
        raise InputError(f"{where}; wanted {wanted}{', or a list of such' if option.multiple else ''}")
    return values if option.multiple else value


_KINDS: Mapping[Any, tuple[Any, str]] = {
    bool: (bool, "true or false"),
    int: (int, "a whole number"),
    float: (int | float, "a number"),
}


def _plain(annotation: Any) -> Any:
    """The type of one value, as int in `int | None` and str in `list[str]`."""
    inner = [part for part in get_args(annotation) if part is not NoneType]
    return _plain(inner[0]) if inner else annotation


def _check(where: str, value: Any, option: Any, verb: Any) -> None:
    """The check of the command line."""
    try:
        option.process_value(typer.Context(verb), value)
    except (typer.BadParameter, InputError) as error:
        raise InputError(f"{where}: {getattr(error, 'message', None) or error}") from error


def _key(parameter: Any) -> str:
    """What an option is called in a file: as on the command line, without the dashes before it."""
    # pyrefly: ignore[missing-attribute]
    return max(parameter.opts, key=len).lstrip("-")


def _nearest(name: str, known: Iterable[str]) -> str:
    near = get_close_matches(name, list(known), n=1)
    return f"; perhaps {near[0]}?" if near else f"; choose from {', '.join(known)}"


def _in_words(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ",".join(map(_in_words, value))
    return str(value).lower() if isinstance(value, bool) else str(value)
