"""The `sonarmap` command and its verbs."""

import inspect
import os
import re
import sys
from importlib import import_module, metadata
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from sonarmap.tools.command.failures import UsageError, discard, failed, guarded, output_lost, print_failure
from sonarmap.tools.command.options.option import spread
from sonarmap.tools.command.settings import ConfigOption, say_settings, use_settings
from sonarmap.tools.command.terminal import print_result, say, show_messages

# A verb is the function `command` in tools/command/verbs/<verb>.py; its docstring is the help. A new verb is a new name
# here; the help lists them in these groups, in this order.
GROUPS = {
    "Survey": ("record", "live", "inspect", "template", "map"),
    "Finished map": ("view", "export", "locate", "section", "volume", "compare"),
    "Pair and graph": ("register", "optimize"),
    "Machine": ("doctor", "devices"),
    "Laboratory": ("simulate", "evaluate", "reproduce", "bench"),
}
VERBS = [verb for verbs in GROUPS.values() for verb in verbs]
_ALL = "--help-all"


class Verb(TyperCommand):
    """A verb whose rare options only --help-all and the shell's completion show."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take --help-all for --help with all options."""
        if _ALL in args:
            self._show_rare_options()
            args = ["--help"]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help, and how many options are not in it."""
        # pyrefly: ignore[missing-attribute]
        rare = sum(parameter.hidden for parameter in self.params)
        self.epilog = f"{rare} more options: {ctx.command_path} {_ALL}" if rare else None
        super().format_help(ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """What can follow on the command line."""
        self._show_rare_options()
        return super().shell_complete(ctx, incomplete)

    def invoke(self, ctx: Any) -> Any:
        """Run it."""
        say_settings(ctx)
        return super().invoke(ctx)

    def _show_rare_options(self) -> None:
        for parameter in self.params:
            setattr(parameter, "hidden", False)  # noqa: B010 - of arguments and options alike


class VerbGroup(TyperGroup):
    """The command without a verb."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take --config wherever it stands: it is the command's, and no verb has an option of this name."""
        for k, word in enumerate(args[: args.index("--")] if "--" in args else args):
            after = k + (1 if "=" in word else 2)
            if word.partition("=")[0] == "--config" and after <= len(args):
                args = [*args[k:after], *args[:k], *args[after:]]
                break
        return super().parse_args(ctx, args)

    def main(
        self, args: Any = None, prog_name: str | None = None, *others: Any, standalone_mode: bool = True, **extra: Any
    ) -> Any:
        """Run a verb; what typer refuses is an error like any other, in one line."""
        try:
            code = super().main(args, prog_name or "sonarmap", *others, standalone_mode=False, **extra)
        except UsageError as error:
            if not standalone_mode:
                raise
            if message := error.format_message().strip():  # none where the help was asked for by giving nothing
                refused = getattr(error.__cause__, "errors", list)()  # by pydantic, which does not say what was given
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


for _group, _verbs in GROUPS.items():
    for _verb in _verbs:
        _command = import_module(f"sonarmap.tools.command.verbs.{_verb}").command
        app.command(_verb, cls=Verb, help=_flowing(_command.__doc__), rich_help_panel=_group)(guarded(spread(_command)))
