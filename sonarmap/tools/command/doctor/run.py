"""`sonarmap doctor` itself, with nothing but the standard library: it runs where the command line cannot start."""

import json
import shutil
import sys
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from sonarmap.tools.command.doctor.examine import examine
from sonarmap.tools.command.doctor.finding import Finding, Remedy
from sonarmap.tools.command.doctor.libraries import pip_command
from sonarmap.tools.command.doctor.words import as_json, lines_of, summary, verdict_of

WRONG = 2
_NARROWEST, _WIDEST = 60, 100


def run(folder: Path, quick: bool, in_json: bool, known: Sequence[Finding] = ()) -> int:
    """Examine, and print each finding as soon as it is known, after those `known` before, or all at the end as JSON.

    The exit code: 0 where all that is needed works, else 2.
    """
    width = min(max(shutil.get_terminal_size().columns, _NARROWEST), _WIDEST)
    findings: list[Finding] = []
    for finding in chain(known, examine(folder, quick)):
        findings.append(finding)
        if not in_json:
            _print("\n".join(lines_of(finding, width)))
    verdict = verdict_of(findings)
    if in_json:
        _print(json.dumps(as_json(findings), indent=2))
    else:
        _print(f"\n{summary(findings)}")
    return WRONG if verdict == "wrong" else 0


def run_from(arguments: Sequence[str], error: Exception) -> int:
    """The same from the words after `sonarmap doctor`, where the command line cannot start, by `error`, and so read
    them."""
    folders = [word for word in arguments if not word.startswith("-")]
    missing = (getattr(error, "name", None) or "").partition(".")[0]
    again = Remedy("install what it is made of again:", pip_command("--force-reinstall", missing))
    seen = f"the other verbs cannot start: {type(error).__name__}: {error}"
    start = Finding("command", "wrong", seen, (again,) if missing else ())
    return run(Path(folders[0] if folders else "."), "--quick" in arguments, "--json" in arguments, [start])


def _print(text: str) -> None:
    """Also where stdout cannot hold all letters."""
    coding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(text.encode(coding, errors="replace").decode(coding), flush=True)
