"""The `sonarmap` command and its verbs."""

import inspect
import os
import re
import sys
from importlib import import_module, metadata
from typing import Annotated

import typer

from sonarmap.tools.command.failures import discard, failed, guarded, output_lost
from sonarmap.tools.command.help import HelpAllOption, VerbGroup
from sonarmap.tools.command.options.option import spread
from sonarmap.tools.command.settings import ConfigOption, VerbWithSettings, use_settings
from sonarmap.tools.command.terminal import print_result, show_messages

# A verb is the function `command` in tools/command/verbs/<verb>.py; its docstring is the help.
# A new verb is a new line here; the help lists them in this order. Those of a finished map are in verbs/finished.
VERBS = [
    "register",
    "map",
    "live",
    "record",
    "inspect",
    "template",
    "view",
    "export",
    "locate",
    "section",
    "volume",
    "compare",
    "optimize",
    "simulate",
    "evaluate",
    "reproduce",
    "bench",
    "devices",
    "doctor",
]

FINISHED = ("view", "export", "locate", "section", "volume", "compare")

app = typer.Typer(
    name="sonarmap",
    no_args_is_help=True,
    cls=VerbGroup,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def run() -> None:
    """The entry point.

    Exit codes: 0 done, 1 a defect of the program, 2 something that the user can fix, 3 a result that is incomplete or
    not to be trusted, 130 interrupted, 141 nobody reads the output any more.
    """
    _open_missing_streams()
    show_messages()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # here, where a closed pipe can still be told apart from a defect
    except (KeyboardInterrupt, BrokenPipeError, ImportError) as error:
        sys.exit(failed(error, "--json" in sys.argv[1:], ()))
    except OSError as error:
        sys.exit(output_lost(error))
    finally:
        try:
            sys.stderr.flush()
        except OSError:  # nobody can be told
            discard(sys.stderr)


def _open_missing_streams() -> None:
    """Open /dev/null for each of stdin, stdout and stderr that the caller closed: otherwise the next opened file
    would take its number, and what is printed would land in that file."""
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
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks, as with SONARMAP_DEBUG=1.")] = False,
    config: ConfigOption = None,
) -> None:
    """Noisy 3D sonar scans in, a consistent map out."""
    if debug:
        os.environ["SONARMAP_DEBUG"] = "1"
    use_settings(context, config)


app.callback()(guarded(_options))


def _flowing(docstring: str) -> str:
    """The docstring without line breaks within its paragraphs, which the help would keep."""
    return re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(docstring))


_COMMON = {"help_all": (HelpAllOption, False)}

for _verb in VERBS:
    _module = f"finished.{_verb}" if _verb in FINISHED else _verb
    _command = import_module(f"sonarmap.tools.command.verbs.{_module}").command
    app.command(_verb, cls=VerbWithSettings, help=_flowing(_command.__doc__))(guarded(spread(_command, _COMMON)))
