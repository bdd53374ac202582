"""What counts when a verb runs: the command line before the file, the file before the defaults."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from sonarmap.tools.command.failures import MISUSE
from sonarmap.tools.command.help import Verb
from sonarmap.tools.command.method import idle_options
from sonarmap.tools.command.navigation import NAVIGATION_READING
from sonarmap.tools.command.settings.file import DEFAULT_FILE, SettingsFile, read_settings
from sonarmap.tools.command.settings.setting import Setting, in_words, settings_of
from sonarmap.tools.command.terminal import say, shortened, warn

ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Take settings from a TOML file; 'sonarmap config --toml' prints one.",
        show_default="sonarmap.toml in this folder",
    ),
]
_KEY = "sonarmap.settings"  # in the context's meta
_LONGEST = 80  # characters of a value that is said
_ALL = "config"  # the verb that looks at the settings of all
# What says where to write, what to discard, and whom to connect or listen to: only a file that the user names may set
# it, as the one that is found in a folder may have come with somebody's scans.
_WRITES = ("out", "to", "write", "picture", "page", "plot", "track")
_DISCARDS = ("fresh", "overwrite")
_CONNECTS = ("scheduler", "multicast", "unicast", "interface", "sonar", "nmea", "bind", "port")
NAMED_ONLY = frozenset((*_WRITES, *_DISCARDS, *_CONNECTS))
# What a setting of a file needs, so as to say anything: one of these.
NEEDS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(NAVIGATION_READING, ("priors", "odometry")),
    "prior_sigmas": ("priors",),
    "odometry_drift": ("odometry",),
    "crs": ("export",),
    "control_crs": ("control",),
    "origin_heading": ("origin",),
    "vertical": ("origin",),
}
# What takes the place of a setting of a file, where the command line has it.
REPLACED: Mapping[str, str] = {
    "workers": "scheduler",
    "scheduler": "workers",
    "multicast": "unicast",
    "unicast": "multicast",
    **dict.fromkeys(("scene", "trajectory", "sensor", "seed"), "like"),
    **dict.fromkeys(("grid", "survey", "device"), "from_"),
}


def use_settings(context: typer.Context, given: Path | None) -> None:
    """Have the verb that is about to run take its defaults from the file of settings, --config, if there is one.

    Raises InputError: the file cannot be used.
    """
    path = given or Path(DEFAULT_FILE)
    if given is None and not path.is_file():
        return
    verb = context.invoked_subcommand
    verbs: Any = context.command
    file = read_settings(path, verbs.commands, None if verb == _ALL else verb)
    if given is None:
        file = _as_found(file, settings_of(verbs.commands), verb)
    context.default_map = {name: dict(values) for name, values in file.values.items()}
    context.meta[_KEY] = file


def _as_found(file: SettingsFile, settings: Sequence[Setting], verb: str | None) -> SettingsFile:
    """What a file sets that nobody has named; what it may not set is said, as far as it concerns the verb."""
    left = [setting for setting in settings if setting.key in NAMED_ONLY and setting.name in file.values[setting.verb]]
    if keys := sorted({setting.key for setting in left if verb in (_ALL, setting.verb)}):
        warn(
            f"{file.path} sets {', '.join(keys)}, which is left out: a file that nobody named may not say where to "
            f"write, what to discard or whom to connect to; if it is yours, name it: --config {file.path}"
        )
    return file.without(left)


def settings_file(context: typer.Context) -> SettingsFile | None:
    """The file that is in use."""
    return context.meta.get(_KEY)


class VerbWithSettings(Verb):
    """A verb that says which of its settings came from a file, and sets aside those that have no effect."""

    def invoke(self, ctx: Any) -> Any:
        """Run it."""
        if (file := settings_file(ctx)) is None:
            return super().invoke(ctx)
        words = _settled(ctx, file, {setting.name: setting for setting in settings_of({ctx.info_name: self})})
        # a file that nobody named is never used without a word
        quiet = ctx.parent.params["config"] and ctx.params.get("quiet") and _source(ctx, "quiet") == "COMMANDLINE"
        silent = not words or quiet
        if not silent:
            say(words)
        try:
            return super().invoke(ctx)
        except typer.Exit as end:
            if silent and words and end.exit_code == MISUSE:  # the error may be the file's
                say(words)
            raise


def _settled(context: Any, file: SettingsFile, settings: Mapping[str, Setting]) -> str:
    """Set aside what has no effect: what is written once for all runs must not stop the one that has no use for it.

    Returns:
        What came from the file, in words; "" for nothing.
    """
    used = [name for name in settings if _source(context, name) == "DEFAULT_MAP"]
    idle: list[str] = []
    # again, as what is set aside may be what another setting needs
    while more := [name for name in used if name not in idle and _is_idle(context, name)]:
        for name in more:
            parameter = settings[name].parameter
            context.params[name] = parameter.process_value(context, parameter.default)
            context.set_parameter_source(name, type(context.get_parameter_source(name)).DEFAULT)
        idle += more
    if not used:
        return ""
    in_force = [
        f"{settings[name].key} {shortened(in_words(context.params[name]), _LONGEST)}"
        for name in used
        if name not in idle
    ]
    without = [settings[name].key for name in used if name in idle]
    words = f"settings from {file.path}: {', '.join(in_force) or 'none'}"
    return words + (f"; without effect here: {', '.join(without)}" if without else "")


def _is_idle(context: Any, name: str) -> bool:
    params = context.params
    if (other := REPLACED.get(name)) and other in params and _source(context, other) == "COMMANDLINE":
        return True
    if "method" not in params:
        return False
    given = {name} if params.get("voxel") is None else {name, "voxel"}
    if name in idle_options(params["method"], given):
        return True
    needs = [other for other in NEEDS.get(name, ()) if other in params]
    return bool(needs) and not any(params[other] for other in needs)


def _source(context: Any, name: str) -> str:
    return getattr(context.get_parameter_source(name), "name", "")
