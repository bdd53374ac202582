"""`sonarmap doctor` itself, with nothing but the standard library: it runs where the command line cannot start."""

import json
import shutil
import sys
import textwrap
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from importlib import metadata
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonarmap.tools.command.doctor import libraries, machine, storage
from sonarmap.tools.command.doctor.finding import VERDICTS, Finding, Remedy, worst

if TYPE_CHECKING:
    from sonarmap.kernels.child import Answers

WRONG = 2
_NARROWEST, _WIDEST = 60, 100
_NAME, _VERDICT = 12, 9  # columns
_INDENT = " " * (_VERDICT + _NAME)


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
    _print(json.dumps(as_json(findings), indent=2) if in_json else f"\n{summary(findings)}")
    return WRONG if any(finding.verdict == "wrong" for finding in findings) else 0


def run_from(arguments: Sequence[str], error: Exception) -> int:
    """The same from the words after `sonarmap doctor`, where the command line cannot start and so read them."""
    folders = [word for word in arguments if not word.startswith("-")]
    missing = (getattr(error, "name", None) or "").partition(".")[0]
    again = Remedy("install what it is made of again:", libraries.pip_command("--force-reinstall", missing))
    seen = f"the other verbs cannot start: {type(error).__name__}: {error}"
    start = Finding("wrong", seen, (again,) if missing else (), check="command")
    return run(Path(folders[0] if folders else "."), "--quick" in arguments, "--json" in arguments, [start])


def examine(folder: Path, quick: bool) -> Iterator[Finding]:
    """Look at everything: the findings, each as soon as it is known.

    `folder` is where results are to go; `quick` loads no library and runs no self-test.
    """
    answers: Answers | None = None

    def check_opencl() -> Finding:
        from sonarmap.tools.command.doctor import opencl  # whose room `kernels` needs a library itself

        nonlocal answers
        finding, answers = opencl.opencl(test=not quick)
        return finding

    checks: dict[str, Callable[[], Finding]] = {
        "Python": libraries.python_version,
        "libraries": lambda: libraries.required_libraries(load=not quick),
        "optional": libraries.optional_libraries,
        "OpenCL": check_opencl,
        "memory": lambda: machine.memory(answers),
        "cores": machine.cores,
        "disk": lambda: storage.results(folder),
        "temporary": storage.temporary_folder,
        "caches": storage.caches,
    }
    for name, check in checks.items():
        yield replace(_checked(check), check=name)


def _checked(check: Callable[[], Finding]) -> Finding:
    """What a check finds; one that fails itself is a finding too."""
    try:
        return check()
    except ImportError as error:
        install = Remedy("install it:", libraries.pip_command(error.name)) if error.name else Remedy("see libraries")
        return Finding("wrong", f"cannot be checked: {error}", (install,))
    except MemoryError:
        return Finding("wrong", "cannot be checked: no memory is left", (Remedy("end other programs"),))
    except Exception as error:  # noqa: BLE001 - here of all places a broken installation must not end the program
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}, line {frame.lineno}"
        return Finding("wrong", f"cannot be checked: {type(error).__name__}: {error} ({place})")


def summary(findings: Sequence[Finding]) -> str:
    """All of it in a line."""
    counts = {verdict: sum(finding.verdict == verdict for finding in findings) for verdict in VERDICTS}
    name = f"sonarmap {_version()}" if _version() else "sonarmap (not installed)"
    warnings = f"{counts['warning']} {'warning' if counts['warning'] == 1 else 'warnings'}"
    if counts["wrong"]:
        also = f", and {warnings}" if counts["warning"] else ""
        return f"{name}: {counts['wrong']} of {len(findings)} wrong{also}; follow the advice after >"
    return f"{name}: all that is needed works" + (f"; {warnings}" if counts["warning"] else "")


def lines_of(finding: Finding, width: int = 80) -> list[str]:
    """A finding as lines: the verdict, the name, what was seen, and below it what to do.

    A command stands on a line of its own, whole, so that it can be copied.
    """
    first, *others = finding.seen.splitlines() or [""]
    lines = _wrapped(first, f"{finding.verdict:<{_VERDICT}}{finding.check:<{_NAME}}", width)
    for line in others:
        lines += _wrapped(line, _INDENT, width)
    for remedy in finding.remedies:
        lines += _wrapped(remedy.words, f"{_INDENT}> ", width)
        lines += [f"{_INDENT}  {remedy.command}"] if remedy.command else []
    return lines


def as_json(findings: Sequence[Finding]) -> dict[str, Any]:
    """All of it, of JSON's types."""
    checks = [{"check": finding.check} | asdict(finding) for finding in findings]
    return {"sonarmap": _version(), "verdict": worst(finding.verdict for finding in findings), "checks": checks}


def _version() -> str | None:
    """Of sonarmap; None where it is not installed."""
    try:
        return metadata.version("sonarmap")
    except metadata.PackageNotFoundError:
        return None


def _wrapped(text: str, head: str, width: int) -> list[str]:
    indent = " " * len(head)
    wrap = textwrap.TextWrapper(width, head, indent, break_long_words=False, break_on_hyphens=False)
    return wrap.wrap(text) or [head.rstrip()]


def _print(text: str) -> None:
    """Also where stdout cannot hold all letters."""
    coding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(text.encode(coding, errors="replace").decode(coding), flush=True)
