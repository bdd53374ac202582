"""What `sonarmap --help`, `sonarmap VERB --help` and `--help-all` print, and what a shell completes.

An option that is `hidden` is not gone: `--help` leaves it out to fit a screen, and counts it; `--help-all` and the
shell's completion have it. `--help` also keeps to the first sentence of a text.
"""

import re
import sys
from collections.abc import Iterator
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.text import Text
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from sonarmap.tools.command.failures import UsageError, print_failure, usage_words
from sonarmap.tools.command.options.option import GROUPS, INPUT, RUNNING
from sonarmap.tools.command.terminal import PipedConsole, say

_NAMES = 26  # columns for the names of options
_NARROW = 60  # below, words stand below the names
_WIDEST = 110  # columns of a page; longer lines are hard to read
_SENTENCE = re.compile(r"(.*?\.)(?:\s|$)", re.DOTALL)
_CLAUSE = re.compile(r"(.*?)[.:](?:\s|$)", re.DOTALL)
_FEW = 13  # options, all of which the short help shows
_INDENT = 2


class Verb(TyperCommand):
    """A verb with a short help that fits a screen, and a long one."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the short help, or with --help-all everything."""
        _print_verb(self, ctx, everything=False)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """What can follow on the command line; all options, the rare ones too."""
        for parameter in self.params:
            setattr(parameter, "hidden", False)  # noqa: B010 - of arguments and options alike
        return super().shell_complete(ctx, incomplete)


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
        """Run a verb; what typer refuses is an error like any other."""
        try:
            code = super().main(args, prog_name or "sonarmap", *others, standalone_mode=False, **extra)
        except UsageError as error:
            if not standalone_mode:
                raise
            if message := usage_words(error):  # none where the help was asked for by giving nothing
                say(message, "error: ", "bold red")
                print_failure(message, error.exit_code, "--json" in (sys.argv[1:] if args is None else args))
            sys.exit(error.exit_code)
        if standalone_mode:
            sys.exit(code if isinstance(code, int) else 0)
        return code

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the verbs, a line each."""
        console = _console()
        console.print(f"Usage: [bold]{ctx.command_path}[/] VERB ...\n\n{self.help}\n\n[bold]Verbs[/]")
        for name, command in self.commands.items():
            clause = _CLAUSE.match(command.help or "")
            _print_entry(console, name, clause[1] if clause else "", names_width=9)
        console.print("\n[bold]Options[/]")
        for parameter in self.get_params(ctx):
            if isinstance(parameter, TyperOption) and not parameter.hidden:
                _print_entry(console, _names(parameter), _sentence(parameter.help or ""))
        console.print(f"\n{ctx.command_path} VERB --help shows the options of a verb.")


def _show_all(context: typer.Context, wanted: bool) -> None:
    if wanted and isinstance(context.command, Verb) and not context.resilient_parsing:
        _print_verb(context.command, context, everything=True)
        raise typer.Exit


HelpAllOption = Annotated[
    bool, typer.Option("--help-all", help="Show all options.", is_eager=True, hidden=True, callback=_show_all)
]


def _print_verb(verb: TyperCommand, context: typer.Context, everything: bool) -> None:
    """Print a verb's help: all options and sentences if `everything`, else the common options and what they are in a
    sentence."""
    console = _console()
    console.print(Text(f"Usage: {_usage(verb, context)}\n", style="bold"))
    paragraphs = (verb.help or "").split("\n\n")
    console.print(Text.from_markup("\n\n".join(paragraphs if everything else paragraphs[:1])))
    left_out, few = 0, len(_options(verb)) <= _FEW
    for group, parameters in _grouped(verb):
        shown = [each for each in parameters if everything or few or not each.hidden]
        left_out += len(parameters) - len(shown)
        if shown:
            console.print(f"\n[bold]{group}[/]")
        for parameter in shown:
            words = (parameter.help or "") if everything else _sentence(parameter.help or "")
            _print_entry(console, _names(parameter), f"{words}{_default(parameter)}")
    if not everything:
        more = f"{left_out} more options, and the details" if left_out else "The details"
        console.print(f"\n{more}: [bold]{context.command_path} --help-all[/]")


def _usage(verb: TyperCommand, context: typer.Context) -> str:
    """How it is called: "sonarmap map INPUT... -o OUT [OPTIONS]"."""
    arguments = [_names(each) if each.required else f"[{_names(each)}]" for each in _arguments(verb)]
    required = [f"{min(each.opts, key=len)} {each.metavar}" for each in _options(verb) if each.required]
    return " ".join([context.command_path, *arguments, *required, "[OPTIONS]"])


def _arguments(verb: TyperCommand) -> list[TyperArgument]:
    return [each for each in verb.params if isinstance(each, TyperArgument)]


def _options(verb: TyperCommand) -> list[TyperOption]:
    return [each for each in verb.params if isinstance(each, TyperOption) and each.name != "help_all"]


def _grouped(verb: TyperCommand) -> Iterator[tuple[str, list[TyperArgument | TyperOption]]]:
    """The groups in their order with their arguments and options; what names no group is about running."""
    groups: dict[str, list[TyperArgument | TyperOption]] = {}
    for argument in _arguments(verb):
        groups.setdefault(argument.rich_help_panel or INPUT, []).append(argument)
    for option in _options(verb):
        groups.setdefault(option.rich_help_panel or RUNNING, []).append(option)
    for group in sorted(groups, key=lambda name: GROUPS.index(name) if name in GROUPS else len(GROUPS)):
        yield group, groups[group]


def _names(parameter: TyperArgument | TyperOption) -> str:
    """As on the command line: "-o, --out OUT", "--report/--no-report"."""
    if isinstance(parameter, TyperArgument):
        return parameter.metavar or str(parameter.name).upper()
    names = ", ".join(sorted(parameter.opts, key=len))
    if parameter.is_flag:
        return "/".join([names, *parameter.secondary_opts])
    return f"{names} {parameter.metavar or str(parameter.name).upper()}"


def _default(parameter: TyperArgument | TyperOption) -> str:
    """What holds if the option is not given, as markup; "" where nothing does."""
    default = parameter.show_default if isinstance(parameter.show_default, str) else parameter.default
    if isinstance(parameter, TyperOption) and parameter.is_flag and parameter.secondary_opts:
        default = (parameter.opts if default else parameter.secondary_opts)[0]
    if default is None or default is False or default in ([], ()) or not parameter.show_default:
        return ""
    words = f"{default:g}" if isinstance(default, float) else str(default)
    return f" [dim]\\[default: {words}][/]"


def _sentence(markup: str) -> str:
    """The first sentence."""
    match = _SENTENCE.match(markup)
    return match[1] if match else markup


def _print_entry(console: Console, names: str, markup: str, names_width: int = _NAMES) -> None:
    """Print names on the left and words beside them; names that are too long have a line of their own."""
    if console.width < _NARROW:
        names_width = _INDENT
    left = _INDENT + names_width + 2
    lines = Text.from_markup(markup).wrap(console, max(console.width - left, 10)) if markup else [Text()]
    if len(names) > names_width:
        console.print(Text(" " * _INDENT + names, style="cyan"))
        names = ""
    for line in lines:
        line.rstrip()
        console.print(Text.assemble(" " * _INDENT, (names.ljust(names_width + 2), "cyan"), line), soft_wrap=True)
        names = ""


def _console() -> Console:
    console = PipedConsole(highlight=False)
    console.width = min(console.width, _WIDEST)
    return console
