"""Settings from a file: `sonarmap --config FILE VERB ...`.

The file is TOML with a section per verb and an option per line, as `grid = 96` under [map]. Its values take the place
of the verb's defaults; the command line counts for more.
"""

import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

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
_MOST_BYTES = 1 << 20  # of a pipe or a device that does not end
_LONGEST_VALUE = 80  # characters of a value that is printed


def use_settings(context: typer.Context, path: Path | None) -> None:
    """Have the verb that is about to run take its defaults from a file. Raises InputError: the file cannot be used."""
    if path is not None:
        verbs: Any = context.command
        context.default_map = read_settings(path, verbs.commands)


def say_settings(context: Any) -> None:
    """Say which options of the verb that is about to run came from the file."""
    values = [
        f"{_key(parameter)} {shortened(str(context.params[parameter.name]), _LONGEST_VALUE)}"
        for parameter in context.command.params
        if getattr(context.get_parameter_source(parameter.name), "name", "") == "DEFAULT_MAP"
    ]
    if values and not context.params.get("quiet"):
        say(f"settings from {context.parent.params['config']}: {', '.join(values)}")


def read_settings(path: Path, verbs: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The values in a file, by the verb and by the name of its parameter; typer checks those of the verb that runs.

    Raises InputError: the file cannot be read, or holds an unknown section or key.
    """
    require_file(path, pipe=True)
    try:
        with path.open("rb") as file:
            content = tomllib.loads(file.read(_MOST_BYTES).decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read the settings {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:  # TOML's, and of bytes that are no UTF-8
        raise InputError(f"{path} is no TOML file: {error}. Fix that line") from error
    values: dict[str, dict[str, Any]] = {}
    for section, lines in content.items():
        if not isinstance(lines, dict):
            raise InputError(f"{path}: {section} stands outside of a section; put it under a verb's, as [map]")
        if section not in verbs:
            raise InputError(f"{path}: [{section}] is not a verb{_nearest(section, verbs)}")
        names = {_key(each): each.name for each in verbs[section].params if each.param_type_name == "option"}
        if unknown := [key for key in lines if key.replace("_", "-") not in names]:
            raise InputError(
                f"{path}: [{section}] {unknown[0]} is not an option of {section}{_nearest(unknown[0], names)}"
            )
        values[section] = {names[key.replace("_", "-")]: value for key, value in lines.items()}
    return values


def _key(parameter: Any) -> str:
    """What an option is called in a file: as on the command line, without the dashes before it."""
    # pyrefly: ignore[missing-attribute]
    return max(parameter.opts, key=len).lstrip("-")


def _nearest(name: str, known: Iterable[str]) -> str:
    near = get_close_matches(name, list(known), n=1)
    return f"; perhaps {near[0]}?" if near else f"; choose from {', '.join(known)}"
