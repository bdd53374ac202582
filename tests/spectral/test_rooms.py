"""The paper's chain and the hypothesis test do not import each other."""

import ast

from tests.samples.places import ROOT

SPECTRAL = ROOT / "spectral"


def importers(module: str) -> set[str]:
    """The files of spectral/ that import it."""
    return {
        path.relative_to(SPECTRAL).as_posix()
        for path in SPECTRAL.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith(f"sonarmap.spectral.{module}.")
    }


def test_only_the_registration_tests_hypotheses_and_nothing_depends_on_the_papers_chain() -> None:
    inside = {path for path in importers("verify") if not path.startswith("verify/")}
    assert inside == {"registration.py", "covariance.py", "judgement.py"}
    assert importers("hemisphere") == set()
    assert importers("hemisphere_layers") == {"hemisphere.py"}
