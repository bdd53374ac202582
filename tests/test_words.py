"""Plain English: words that puzzle readers stand neither on pages nor in messages nor in the help."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.samples.places import ROOT

PACKAGES = ("kernels", "spectral", "slam", "tools")
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
WEB = sorted((ROOT / "sonarmap/tools/products/report/page/web").rglob("*.js"))
WEB += sorted((ROOT / "sonarmap/tools/products/report/page/web").rglob("*.html"))
REASONS = sorted(path for name in ("spectral", "slam/decide") for path in (ROOT / "sonarmap" / name).rglob("*.py"))
REFUSED = {  # pattern: what a colleague would say
    r"\bhears?\b|\bheard\b": "--x has no effect with y",
    r"\bparted by\b": "separated by",
    r"\bmend(s|ed|ing)?\b": "fix, correct",
    r"\btold\b": "reported, shown, distinguished",
    r"\btells? (of|nothing of)\b": "covers, describes",
    r"\bspeaks? (for|against)\b": "evidence, reasons",
    r"\bby (its|their) looks\b": "by appearance",
    r"\btaken at (its|their) word\b": "believed",
    r"\b(un)?settled?\b": "decided, stable",
    r"\bhand(s|ed) in\b": "give, pass",
    r"\bgoes on from there\b": "continues from there",
    r"\bvouch(es)?\b": "certifies",
    r"\b(crew|contest|settlement)\b": "the field's term",
    r"\bway of the sensor\b|\balong the way\b|\bway before the loops\b": "track, along the track",
    r"\bpasses (over|lie|overlap)\b|\boverlapping passes\b|\bpasses \d": "crossings of the track",
    r"(?<!there )\bis no (folder|file|array|journal|log|verb|section|setting|result|mapping)\b": "is not a ...",
    r"\bsaid behind\b": "the advice after",
    r"\bholds? nothing\b|\bcounts? as nothing\b|\bfor nothing\b": "has no effect, is disregarded, is only compared",
    r"\bso that nothing is rejected\b|\bso that there is no registration\b": "so there is nothing to",
    r"\bsaw otherwise\b": "contradict it",
    r"\bmarks it all\b": "selects it",
    r"\ball that is new\b": "new decisions",
    r"\bfiles of scans\b": "scan files",
    r"\btie far\b|\bfar parts\b": "connect distant parts of the track",
    r"\bcomes? nearer\b": "zoom",
    r"\b(of|for) nothing else\b": "that had no part in the development",
    r"\bgoes on by\b|\band the reverse\b": "can be continued with, and the other way round",
    r"\bof all \d+ pairs\b": "32 of 40 pairs",
    r"\bhand in the loops\b": "ties and control points",
}


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def refused_in(text: str) -> list[str]:
    """What is refused, each with what to say instead."""
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
    """Its texts, that is what is quoted, and what stands between tags."""
    text = " ".join(re.findall(r'"[^"\n]*"|`[^`]*`|>[^<]*<', page.read_text()))
    assert not refused_in(text)


def test_reasons_begin_with_a_plain_clause() -> None:
    """Of a pair, as pairs.csv has them: first words, then numbers."""
    found = [
        f"{named(path)}:{line}"
        for path in REASONS
        for line, text in messages_in(path)
        if re.match(r"(it is right with|the translation's peak is|\d)", text)
    ]
    assert not found


def messages_in(path: Path) -> Iterator[tuple[int, str]]:
    """The strings of a file with their lines; of docstrings those of verbs alone, which are the help."""
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
