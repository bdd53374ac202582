"""What the checks say, in words for a screen and as JSON for programs."""

import textwrap
from collections.abc import Sequence
from importlib import metadata
from typing import Any

from sonarmap.tools.command.doctor.finding import VERDICTS, Finding, Verdict, worst

_NAME, _VERDICT = 12, 9
_INDENT = " " * (_VERDICT + _NAME)


def verdict_of(findings: Sequence[Finding]) -> Verdict:
    """The worst of all."""
    return worst([finding.verdict for finding in findings])


def summary(findings: Sequence[Finding]) -> str:
    """All of it in a line."""
    counts = {verdict: sum(finding.verdict == verdict for finding in findings) for verdict in VERDICTS}
    name = f"sonarmap {version()}" if version() else "sonarmap (not installed)"
    warnings = f"{counts['warning']} {'warning' if counts['warning'] == 1 else 'warnings'}"
    if counts["wrong"]:
        also = f", and {warnings}" if counts["warning"] else ""
        return f"{name}: {counts['wrong']} of {len(findings)} wrong{also}; follow the advice after >"
    return f"{name}: all that is needed works" + (f"; {warnings}" if counts["warning"] else "")


def lines_of(finding: Finding, width: int = 80) -> list[str]:
    """A finding as lines: the verdict, the name, what was seen, and below it what to do.

    A command stands on a line of its own, whole, so that it can be copied.
    """
    seen = finding.seen.splitlines() or [""]
    head = f"{finding.verdict:<{_VERDICT}}{finding.check:<{_NAME}}"
    lines = _wrapped(seen[0], head, width)
    for line in seen[1:]:
        lines += _wrapped(line, _INDENT, width)
    for remedy in finding.remedies:
        lines += _wrapped(remedy.words, f"{_INDENT}> ", width)
        lines += [f"{_INDENT}  {remedy.command}"] if remedy.command else []
    return lines


def as_json(findings: Sequence[Finding]) -> dict[str, Any]:
    """All of it, of JSON's types."""
    checks = [
        {
            "check": finding.check,
            "verdict": finding.verdict,
            "seen": finding.seen,
            "remedies": [{"words": remedy.words, "command": remedy.command} for remedy in finding.remedies],
            "details": dict(finding.details),
        }
        for finding in findings
    ]
    return {"sonarmap": version(), "verdict": verdict_of(findings), "checks": checks}


def version() -> str | None:
    """Of sonarmap; None where it is not installed."""
    try:
        return metadata.version("sonarmap")
    except metadata.PackageNotFoundError:
        return None


def _wrapped(text: str, head: str, width: int) -> list[str]:
    indent = " " * len(head)
    wrapped = textwrap.wrap(
        text, width, initial_indent=head, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return wrapped or [head.rstrip()]
