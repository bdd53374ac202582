"""The commands of README and docs, page by page, in their order.

Comments in a page, which readers do not see, name its inputs, and the commands that are not run:

    <!-- commands: scans nav.csv -->                                     inputs, keys of INPUTS in inputs.py
    <!-- not run: sonarmap record: needs a sonar on the network -->      the start of commands, and the reason
"""

import re
import shlex
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import typer
from typer.core import TyperCommand, TyperGroup

from sonarmap.tools.command.main import app
from tests.samples.places import ROOT

UsageError: type[Exception] = typer.BadParameter.__bases__[0]  # click's, which typer bundles without a public name
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(r"^```(sh|console|python)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_FENCED = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_INLINE = re.compile(r"(?<!`)`(sonarmap [^`]+)`(?!`)")
_OPTION = re.compile(r"(?<![`\w])`(--?[a-z][\w-]*)[^`]*`")
_STARTS = re.compile(r"<!-- commands: (.*?) -->")
_NOT_RUN = re.compile(r"<!-- not run: (.*?): (.*?) -->")
_PLACEHOLDER = re.compile(r"\.\.\.|\b(VERB|OUT|SCANS|TARGET|SOURCE|IN\.g2o|DIR|FILE|NAME|HOST)\b")


@dataclass(frozen=True, slots=True)
class Example:
    """A shell command or a Python program of a page."""

    text: str
    language: Literal["sh", "python"]
    inline: bool  # it stands in a sentence or a table
    not_run: str  # the reason; empty if it is run


SHELL = ("|", "&&", ">", ">>")


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def starts(page: Path) -> list[str]:
    """Names of the inputs of the page's commands."""
    return [name for names in _STARTS.findall(page.read_text()) for name in names.split()]


@cache
def examples(page: Path) -> tuple[Example, ...]:
    """All commands of the page in its order; those within sentences only if they are complete."""
    text, reasons = page.read_text(), _NOT_RUN.findall(page.read_text())
    found: list[tuple[int, Example]] = []
    for block in _BLOCK.finditer(text):
        if block[1] == "python":
            found.append((block.start(), _example(block[2], "python", False, reasons)))
        else:
            found += [(block.start(), _example(line, "sh", False, reasons)) for line in _commands(block[2])]
    for span in _INLINE.finditer(_FENCED.sub(lambda fenced: " " * len(fenced[0]), text)):
        example = _example(" ".join(span[1].split()), "sh", True, reasons)
        if is_complete(example.text):
            found.append((span.start(), example))
    ordered = [example for _, example in sorted(found, key=lambda item: item[0])]
    return tuple(dict.fromkeys(ordered))  # without repetitions


def mentions(page: Path) -> list[str]:
    """Commands within sentences, complete or not: `sonarmap map ... --export laz`."""
    return [" ".join(span.split()) for span in _INLINE.findall(_FENCED.sub("", page.read_text()))]


def options(page: Path) -> set[str]:
    """Options that sentences name by themselves: `--grid N`."""
    return set(_OPTION.findall(_FENCED.sub("", page.read_text())))


def _example(text: str, language: Literal["sh", "python"], inline: bool, reasons: list[tuple[str, str]]) -> Example:
    reason = next((why for start, why in reasons if text.startswith(start)), "")
    return Example(text, language, inline, reason)


def _commands(block: str) -> list[str]:
    """The lines of a shell's block, with those joined that a backslash continues, without comments."""
    lines = block.replace("\\\n", " ").splitlines()
    return [line for line in (line.partition(" #")[0].strip() for line in lines) if line and not line.startswith("#")]


@cache
def command() -> TyperGroup:
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    return group


def verbs() -> dict[str, TyperCommand]:
    return {name: verb for name, verb in command().commands.items() if isinstance(verb, TyperCommand)}


def all_options() -> set[str]:
    """Options of sonarmap itself and of all verbs, long and short."""
    return options_of().union(*(options_of(verb) for verb in verbs()))


def options_of(verb: str | None = None) -> set[str]:
    """Options of a verb, or of sonarmap itself."""
    params = command().params if verb is None else verbs()[verb].params
    return {"--help", "-h"}.union(*({*option.opts, *option.secondary_opts} for option in params))


def words_of(text: str) -> list[str]:
    """The words of a sonarmap command from its verb on, without variables and options before it, and without pipes and
    redirections after it."""
    words = shlex.split(text)
    words = words[words.index("sonarmap") + 1 :] if "sonarmap" in words else []
    words = words[2:] if words[:1] == ["--config"] else words
    end = next((k for k, word in enumerate(words) if word in SHELL), len(words))
    return words[:end]


def parse(text: str) -> None:
    """Parse the command with the real command line, which raises UsageError; nothing is run."""
    verb, *arguments = words_of(text)
    if verb not in verbs():
        raise UsageError(f"there is no verb {verb!r}")
    verbs()[verb].make_context(verb, arguments)


def is_complete(text: str) -> bool:
    try:
        parse(text)
    except UsageError:
        return False
    return not _PLACEHOLDER.search(text)
