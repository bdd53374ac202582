"""Plain English: pages, messages and help contain none of the refused words."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.samples.places import ROOT
from tests.test_docs import PACKAGES, PAGES, named

WEB = sorted((ROOT / "sonarmap/tools/products/report/web").rglob("*.js"))
WEB += sorted((ROOT / "sonarmap/tools/products").rglob("*.html"))
REFUSED = {  # pattern: what a colleague would say
    r"\bhears?\b|\bheard\b": "--x has no effect with y",
    r"\bparted by\b": "separated by",
    r"\bmend(s|ed|ing)?\b": "fix, correct",
    r"\btold\b": "reported, shown, distinguished",
    r"\btells? (of|nothing of)\b": "covers, describes",
    r"\bspeaks? (for|against)\b": "evidence, reasons",
    r"\bby (its|their) looks\b": "by appearance",
    r"\b(un)?settled?\b": "decided, stable",
    r"\bhand(s|ed) in\b": "give, pass",
    r"\bvouch(es)?\b": "certifies",
    r"\b(crew|contest|settlement)\b": "the field's term",
    r"(?<!there )\bis no (folder|file|array|journal|log|verb|section|setting|result|mapping)\b": "is not a ...",
    r"\bof all \d+ pairs\b": "32 of 40 pairs",
}


def refused_in(text: str) -> list[str]:
    """Refused words of a text, each with a replacement."""
    words = " ".join(text.split())
    return [
        f"{match[0]!r}: say {instead!r}"
        for pattern, instead in REFUSED.items()
        for match in re.finditer(pattern, words, re.IGNORECASE)
    ]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_pages_are_in_plain_english(page: Path) -> None:
    assert not refused_in(page.read_text())


@pytest.mark.parametrize("package", PACKAGES)
def test_messages_are_in_plain_english(package: str) -> None:
    found = {
        f"{named(path)}:{line}": wrong
        for path in sorted((ROOT / package).rglob("*.py"))
        for line, text in messages_in(path)
        if (wrong := refused_in(text))
    }
    assert not found


@pytest.mark.parametrize("page", WEB, ids=named)
def test_the_report_is_in_plain_english(page: Path) -> None:
    """Its texts are quoted strings and text between tags."""
    text = " ".join(re.findall(r'"[^"\n]*"|`[^`]*`|>[^<]*<', page.read_text()))
    assert not refused_in(text)


def messages_in(path: Path) -> Iterator[tuple[int, str]]:
    """Lines and strings of a file; of its docstrings only those of verbs, which are the help."""
    tree = ast.parse(path.read_text())
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and isinstance(node.body[0], ast.Expr)
        and getattr(node, "name", "") != "command"
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.lineno, node.value
