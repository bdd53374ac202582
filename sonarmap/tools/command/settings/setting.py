"""An option as a setting, all from the option itself: name, kind, unit, default."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

COMMON = "common"  # the section of what means the same for several verbs
_METAVARS = {"M", "DEG", "M/S", "DEG/S"}  # that are units
_UNITS = {"m", "m^2", "m/s", "deg", "deg/s", "deg/h", "s", "Hz", "%"}
_BRACKETS = re.compile(r"\\?\[([^\[\]\\]+)\]")
_KINDS = {  # as TOML calls them, and in words
    bool: ("boolean", "true or false"),
    int: ("integer", "a whole number"),
    float: ("float", "a number"),
    str: ("string", "a text in quotes"),
    Path: ("string", "a path in quotes"),
}


@dataclass(frozen=True, slots=True)
class Setting:
    """An option of a verb."""

    verb: str  # whose
    parameter: Any  # Typer's, which has no public type
    kind: type  # bool, int, float, str or Path
    name: str  # of the verb's parameter
    key: str  # what it is called in a file: as on the command line, without the dashes before it
    many: bool  # whether it can be given several times; then its value is a list
    help: str  # what it does, as the verb's help says it

    @property
    def wanted(self) -> str:
        """Its kind in words, with the unit."""
        words = _KINDS[self.kind][1] + (f" [{self.unit}]" if self.unit else "")
        return f"{words}, or a list of such" if self.many else words

    @property
    def type(self) -> str:
        """What TOML calls its kind; of a list that of its entries."""
        return _KINDS[self.kind][0]

    @property
    def unit(self) -> str:
        """Its unit, or its parts' units; "" where it has none."""
        metavar = self.parameter.metavar or ""
        if metavar in _METAVARS:
            return metavar.lower()
        units = [text for text in _BRACKETS.findall(self.help) if text in _UNITS]
        return ", ".join(dict.fromkeys(units))

    @property
    def default(self) -> str:
        """What counts where nobody sets it, in words."""
        if self.parameter.required:
            return "to be given"
        value = self.parameter.default
        if value is not None and value not in ([], ()):
            return in_words(value)
        said = self.parameter.show_default  # in words, where nothing given means something
        return said if isinstance(said, str) else "none"

    @property
    def about(self) -> str:
        """The help in one line."""
        return self.help.replace("\\[", "[").strip()

    def same_as(self, other: "Setting") -> bool:
        """Whether both mean the same, so that one value can be given to both."""
        one, two = (
            (each.key, each.kind, each.many, each.help, each.parameter.metavar, in_words(each.parameter.default))
            for each in (self, other)
        )
        return one == two


def settings_of(verbs: Mapping[str, Any]) -> list[Setting]:
    """All options of Typer's commands, in the verbs' and their own order."""
    settings: list[Setting] = []
    for verb, command in verbs.items():
        hints = get_type_hints(command.callback)
        for option in command.params:
            if option.param_type_name == "option" and option.name in hints and option.name != "help_all":
                key, kind = max(option.opts, key=len).lstrip("-"), _kind(hints[option.name])
                settings.append(Setting(verb, option, kind, option.name, key, option.multiple, option.help or ""))
    return settings


def common_settings(settings: list[Setting]) -> dict[str, list[Setting]]:
    """What can stand in [common], by its key: the largest group of verbs for which it means the same."""
    groups: dict[str, list[list[Setting]]] = {}
    for setting in settings:
        alike = next((group for group in groups.get(setting.key, []) if group[0].same_as(setting)), None)
        if alike is None:
            groups.setdefault(setting.key, []).append([setting])
        else:
            alike.append(setting)
    largest = {key: max(of_key, key=len) for key, of_key in groups.items()}
    return {key: group for key, group in largest.items() if len(group) > 1}


def in_words(value: Any) -> str:
    """A value as it is written in a list of settings."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return ",".join(map(in_words, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _kind(annotation: Any) -> type:
    """The plain type in an annotation, as int in `int | None` and str in `list[str]`."""
    if get_origin(annotation) is list:
        return _kind(get_args(annotation)[0])
    if arguments := [part for part in get_args(annotation) if part is not NoneType]:
        return _kind(arguments[0])
    return annotation
