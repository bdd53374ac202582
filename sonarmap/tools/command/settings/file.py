"""A TOML file of settings: a section per verb, and [common] for what means the same for several."""

import reprlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.settings.setting import COMMON, Setting, common_settings, settings_of
from sonarmap.tools.files.user_file import require_file

DEFAULT_FILE = "sonarmap.toml"
_MOST_BYTES = 1 << 16
_LONGEST_LINE = 1000  # a key of n parts takes a time and a memory of n squared, and a number's digits are limited


@dataclass(frozen=True, slots=True)
class SettingsFile:
    """What a file sets."""

    path: Path  # the file
    # of each verb, by its parameters' names; what [common] sets is in those that it means
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    # where each of these stands, likewise: the verb's own section, or [common]
    sections: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, dict[str, str]])

    def without(self, settings: Sequence[Setting]) -> "SettingsFile":
        """The same without some of what it sets."""
        left = {(setting.verb, setting.name) for setting in settings}
        values, sections = (
            {verb: {name: of[name] for name in of if (verb, name) not in left} for verb, of in every.items()}
            for every in (self.values, self.sections)
        )
        return SettingsFile(self.path, values, sections)


def read_settings(path: Path, verbs: Mapping[str, Any], verb: str | None) -> SettingsFile:
    """Read a file, and check it: all its keys and their types, and the values of one verb, or with None of all.

    `verbs` are Typer's commands. Raises InputError: naming the file and the key, with what was wanted.
    """
    settings = settings_of(verbs)
    content = _content(path)
    values: dict[str, dict[str, Any]] = {name: {} for name in verbs}
    sections: dict[str, dict[str, str]] = {name: {} for name in verbs}
    named = sorted(content, key=lambda name: name != COMMON)  # a verb's own section counts for more
    for section in named:
        for key, value in _table(path, section, content[section], settings).items():
            for setting in _meant(path, section, key, settings):
                values[setting.verb][setting.name] = _typed(path, section, key, value, setting)
                sections[setting.verb][setting.name] = section
    result = SettingsFile(path, values, sections)
    for setting in settings:
        if setting.name in values[setting.verb] and verb in (None, setting.verb):
            _check(result, setting, verbs[setting.verb])
    return result


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
        raise InputError(
            f"{path} is no TOML file: {error}. Fix that line; 'sonarmap config --toml' prints a file to begin with"
        ) from error


def _table(path: Path, section: str, content: Any, settings: Sequence[Setting]) -> dict[str, Any]:
    """A section's content; what stands above all sections is refused with the section that it could be in."""
    verbs = list(dict.fromkeys(setting.verb for setting in settings))
    if section not in (COMMON, *verbs):
        known = {setting.key for setting in settings}
        if _as_key(section) in known:
            raise InputError(
                f"{path}: {section} stands outside of a section; put it under [{COMMON}] or under a verb's"
            )
        raise InputError(f"{path}: [{section}] is not a section{_nearest(section, [COMMON, *verbs])}")
    if not isinstance(content, dict):
        raise InputError(
            f"{path}: {section} is {reprlib.repr(content)}; wanted a section, [{section}], with lines of its own"
        )
    return content


def _meant(path: Path, section: str, key: str, settings: Sequence[Setting]) -> list[Setting]:
    """The verbs' settings that a line sets; a name of none, or that does not mean the same for several, is refused."""
    name = _as_key(key)
    if section != COMMON:
        own = [setting for setting in settings if setting.verb == section]
        if meant := [setting for setting in own if setting.key == name]:
            return meant
        nearest = _nearest(name, [setting.key for setting in own])
        raise InputError(f"{path}: [{section}] {key} is not a setting{nearest}")
    common = common_settings(list(settings))
    if name in common:
        return common[name]
    if owners := [setting.verb for setting in settings if setting.key == name]:
        where = " or ".join(f"[{verb}]" for verb in owners)
        raise InputError(f"{path}: [{COMMON}] {key} does not mean the same for several verbs; put it under {where}")
    raise InputError(f"{path}: [{COMMON}] {key} is not a setting{_nearest(name, list(common))}")


def _typed(path: Path, section: str, key: str, value: Any, setting: Setting) -> Any:
    """The value, if it has the setting's type; a number may be written without a decimal point."""
    values = value if isinstance(value, list) and setting.many else [value]
    for entry in values:
        if not _fits(entry, setting.kind):
            raise InputError(f"{path}: [{section}] {key} is {reprlib.repr(value)}; wanted {setting.wanted}")
    return values if setting.many else value


def _fits(value: Any, kind: type) -> bool:
    if kind is bool or isinstance(value, bool):
        return kind is bool and isinstance(value, bool)
    if kind is float:
        return isinstance(value, int | float)
    return isinstance(value, str if kind is Path else kind)


def _check(file: SettingsFile, setting: Setting, verb: Any) -> None:
    """The check of the command line's option."""
    value, section = file.values[setting.verb][setting.name], file.sections[setting.verb][setting.name]
    context = typer.Context(verb, info_name=setting.verb)
    try:
        setting.parameter.process_value(context, value)
    except (typer.BadParameter, InputError) as error:
        said = getattr(error, "message", None) or str(error)
        raise InputError(f"{file.path}: [{section}] {setting.key} is {value!r}: {said}") from error


def _as_key(name: str) -> str:
    """max_tilt is max-tilt."""
    return name.replace("_", "-")


def _nearest(name: str, known: Sequence[str]) -> str:
    near = get_close_matches(_as_key(name), known, n=1)
    return f"; perhaps {near[0]}?" if near else "; 'sonarmap config' lists all"
