"""The rooms of spectral/: the paper's chain and the tested hypotheses do not know of each other."""

import ast
from pathlib import Path

import pytest

from tests.samples.places import ROOT

SPECTRAL = ROOT / "spectral"
FILES = sorted(SPECTRAL.rglob("*.py"))


def imported(path: Path) -> set[str]:
    """The modules that a file imports from."""
    nodes = ast.walk(ast.parse(path.read_text()))
    return {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(SPECTRAL)))
def test_only_the_registration_tests_hypotheses_and_nothing_depends_on_the_papers_chain(path: Path) -> None:
    if (
        path.parent.name not in ("verify", "judge") and path.name != "registration.py"
    ) or path.parent.name == "hemisphere":
        assert not any(module.startswith("sonarmap.spectral.verify") for module in imported(path))
    if path.parent.name != "hemisphere":
        assert not any(module.startswith("sonarmap.spectral.hemisphere") for module in imported(path))
