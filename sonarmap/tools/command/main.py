"""The `sonarmap` command and its verbs, and settings from a file: `sonarmap --config FILE VERB ...`.

The file is TOML with a section per verb and an option per line, as `grid = 96` under [map]. Its values replace the
verb's defaults; options on the command line override them.
"""

import inspect
import os
import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from importlib import import_module, metadata
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import UsageError, discard, failed, guarded, output_lost, print_failure
from sonarmap.tools.command.option import spread
from sonarmap.tools.command.terminal import print_result, say, shortened, show_messages
from sonarmap.tools.files.user_file import require_file

# A verb is the function `command` in verbs/<verb>.py, or, if _BESIDE has it, the function of its name in another verb's
# file. Its docstring is the help, which lists the verbs in these groups and this order.
GROUPS = {
    "Survey": ("record", "live", "inspect", "map"),
    "Finished map": ("view", "export", "locate", "section", "volume", "compare", "accept"),
    "Pair and graph": ("register", "optimize"),
    "Machine": ("doctor", "devices"),
    "Laboratory": ("simulate", "evaluate", "reproduce", "bench"),
}
_BESIDE = {"doctor": "devices", "view": "export", "volume": "section"}  # the file of each
VERBS = [verb for verbs in GROUPS.values() for verb in verbs]
_ALL = "--help-all"


ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Take options from a TOML file: a section per verb, as grid = 96 under \\[map].",
        show_default=False,
    ),
]
_MOST_BYTES = 1 << 20  # read from a file, which may be a pipe or a device without an end
_LONGEST_VALUE = 80  # characters of a value that is printed


def use_settings(context: typer.Context, path: Path | None) -> None:
    """Replace the verbs' defaults by the values in a file, if there is one."""
    if path is not None:
        verbs: Any = context.command
        context.default_map = read_settings(path, verbs.commands)


def say_settings(context: Any) -> None:
    """Print which options of the verb were taken from the settings file."""
    values = [
        f"{_key(parameter)} {shortened(str(context.params[parameter.name]), _LONGEST_VALUE)}"
        for parameter in context.command.params
        if getattr(context.get_parameter_source(parameter.name), "name", "") == "DEFAULT_MAP"
    ]
    if values and not context.params.get("quiet"):
        say(f"settings from {context.parent.params['config']}: {', '.join(values)}")


def read_settings(path: Path, verbs: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Values in a settings file, by verb and parameter. Only those of the verb that runs are checked, by typer."""
    require_file(path, pipe=True)
    try:
        with path.open("rb") as file:
            content = tomllib.loads(file.read(_MOST_BYTES).decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"cannot read the settings {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:  # invalid TOML or UTF-8
        raise InputError(f"{path} is no TOML file: {error}. Fix that line") from error
    values: dict[str, dict[str, Any]] = {}
    for section, lines in content.items():
        if not isinstance(lines, dict):
            raise InputError(f"{path}: {section} stands outside of a section; put it under a verb's, as [map]")
        if section not in verbs:
            raise InputError(f"{path}: [{section}] is not a verb{_nearest(section, verbs)}")
        names = {_key(each): each.name for each in verbs[section].params if each.param_type_name == "option"}
        if unknown := [key for key in lines if key.replace("_", "-") not in names]:
            raise InputError(f"{path}: {unknown[0]} is not an option of {section}{_nearest(unknown[0], names)}")
        values[section] = {names[key.replace("_", "-")]: value for key, value in lines.items()}
    return values


def _key(parameter: Any) -> str:
    """An option's name in a settings file: its long name without dashes."""
    # pyrefly: ignore[missing-attribute]
    return max(parameter.opts, key=len).lstrip("-")


def _nearest(name: str, names: Iterable[str]) -> str:
    near = get_close_matches(name, list(names), n=1)
    return f"; perhaps {near[0]}?" if near else f"; choose from {', '.join(names)}"


class Verb(TyperCommand):
    """A verb whose rare options are shown only by --help-all."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse --help-all as --help with the rare options."""
        if _ALL in args:
            self._show_rare_options()
            args = ["--help"]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help, and the number of rare options that it omits."""
        # pyrefly: ignore[missing-attribute]
        rare = sum(parameter.hidden for parameter in self.params)
        self.epilog = f"{rare} more options: {ctx.command_path} {_ALL}" if rare else None
        super().format_help(ctx, formatter)

    def invoke(self, ctx: Any) -> Any:
        """Print the options from the settings file, and run the verb."""
        say_settings(ctx)
        return super().invoke(ctx)

    def _show_rare_options(self) -> None:
        for parameter in self.params:
            setattr(parameter, "hidden", False)  # noqa: B010 - of arguments and options alike


class VerbGroup(TyperGroup):
    """The `sonarmap` command, which contains the verbs."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Accept --config after the verb too: it is moved to the front, as no verb has an option of this name."""
        for k, word in enumerate(args[: args.index("--")] if "--" in args else args):
            after = k + (1 if "=" in word else 2)
            if word.partition("=")[0] == "--config" and after <= len(args):
                args = [*args[k:after], *args[:k], *args[after:]]
                break
        return super().parse_args(ctx, args)

    def main(
        self, args: Any = None, prog_name: str | None = None, *others: Any, standalone_mode: bool = True, **extra: Any
    ) -> Any:
        """Run a verb; an error that typer finds is printed in one line, like any other."""
        try:
            code = super().main(args, prog_name or "sonarmap", *others, standalone_mode=False, **extra)
        except UsageError as error:
            if not standalone_mode:
                raise
            if message := error.format_message().strip():  # empty if no argument was given and the help was printed
                refused = getattr(error.__cause__, "errors", list)()  # pydantic's message lacks the value
                message += f", not {refused[0]['input']!r}" if refused else ""
                call = error.ctx.command_path if error.ctx is not None else "sonarmap"
                message += f"{'' if message[-1] in '.?' else '.'} `{call} --help` shows how it is called."
                say(message, "error: ", "bold red")
                print_failure(message, error.exit_code, "--json" in (sys.argv[1:] if args is None else args))
            sys.exit(error.exit_code)
        if standalone_mode:
            sys.exit(code if isinstance(code, int) else 0)
        return code


app = typer.Typer(
    name="sonarmap",
    no_args_is_help=True,
    cls=VerbGroup,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def run() -> None:
    """Entry point. Exit codes: 0 success, 1 a defect of sonarmap, 2 an error that the user can fix, 3 an incomplete or
    unreliable result, 130 interrupted, 141 broken pipe."""
    _open_missing_streams()
    show_messages()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # here, where a broken pipe is still caught
    except (KeyboardInterrupt, BrokenPipeError, ImportError) as error:
        sys.exit(failed(error, "--json" in sys.argv[1:]))
    except OSError as error:
        sys.exit(output_lost(error))
    finally:
        try:
            sys.stderr.flush()
        except OSError:  # stderr itself cannot be written
            discard(sys.stderr)


def _open_missing_streams() -> None:
    """Open /dev/null for each of stdin, stdout and stderr that the caller closed: otherwise the next opened file
    would take its number, and messages would be printed into that file."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def _version(print_it: bool) -> None:
    if print_it:
        print_result(f"sonarmap {metadata.version('sonarmap')}")
        raise typer.Exit


def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
    config: ConfigOption = None,
) -> None:
    """Noisy 3D sonar scans in, a consistent map out."""
    use_settings(context, config)


app.callback()(guarded(_options))


def _flowing(docstring: str) -> str:
    """The docstring without line breaks inside paragraphs, which the help would keep."""
    return re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(docstring))


for _group, _verbs in GROUPS.items():
    for _verb in _verbs:
        _module = import_module(f"sonarmap.tools.command.verbs.{_BESIDE.get(_verb, _verb)}")
        _command = getattr(_module, _verb if _verb in _BESIDE else "command")
        app.command(_verb, cls=Verb, help=_flowing(_command.__doc__), rich_help_panel=_group)(guarded(spread(_command)))
