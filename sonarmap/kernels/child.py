"""Run a module's `main` in a separate process, so that a library that crashes, hangs or takes all memory does no harm.

The module reports its results by `answer`, step by step, so that those before a crash are known.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[2]
_DONE = {"done": True}
_PROGRAM = "import sys; from {} import main; main(sys.argv[1:])"


LATE = "it did not answer within"


@dataclass(frozen=True, slots=True)
class Answers:
    """The answers of a process, step by step in JSON's types, and why it failed, or ""."""

    steps: tuple[dict[str, Any], ...]
    end: str

    def named(self, name: str) -> list[Any]:
        """The values of all steps that have this name."""
        return [step[name] for step in self.steps if name in step]


def ask(module: str, *arguments: str, seconds: float) -> Answers:
    """Run the `main` of a module of this project in another process for at most `seconds`, and collect its answers."""
    try:
        run = subprocess.run(
            command_of(__name__, module, *arguments),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=seconds,
            env=environment(),
            check=False,
        )
    except subprocess.TimeoutExpired as late:
        return Answers(_steps(late.stdout or b""), f"{LATE} {seconds:.0f} s")
    except OSError as error:
        return Answers((), f"no process can be started ({error.strerror or error})")
    steps = _steps(run.stdout)
    if run.returncode == 0 and steps[-1:] == (_DONE,):
        return Answers(steps[:-1], "")
    return Answers(steps, _end(run.returncode, run.stderr.decode(errors="replace")))


def main(arguments: Sequence[str]) -> None:
    """In the other process: run the `main` of the module named first, and report that it finished."""
    import_module(arguments[0]).main(arguments[1:])
    answer(**_DONE)


def command_of(module: str, *arguments: str) -> list[str]:
    """Command that runs a module's `main` in another process without importing the calling program there."""
    return [sys.executable, "-P", "-c", _PROGRAM.format(module), *arguments]


def environment() -> dict[str, str]:
    """Environment variables with which a `command_of` finds this package."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(_ROOT)]))}


def answer(**step: Any) -> None:
    """Report results to the process that asked; from the first answer on, other output to stdout goes to stderr."""
    global _answers
    if _answers < 0:
        sys.stdout.flush()
        _answers = os.dup(1)
        os.dup2(2, 1)
    os.write(_answers, json.dumps(step).encode() + b"\n")


_answers = -1  # file descriptor that answers are written to; negative before the first


def _steps(output: bytes) -> tuple[dict[str, Any], ...]:
    steps: list[Any] = []
    for line in output.splitlines():
        with suppress(ValueError):  # printed by a library, or cut off
            steps.append(json.loads(line))
    return tuple(step for step in steps if isinstance(step, dict))


def _end(code: int, errors: str) -> str:
    return f"it ended with {end_in_words(code)}: {last_words(errors)}".removesuffix(": ")


def last_words(errors: str) -> str:
    """The most informative line of stderr: the first about an error or memory, else the last."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    informative = [line for line in lines if "error" in line.lower() or "memory" in line.lower()]
    return (informative or lines or [""])[-1][:200]


def end_in_words(code: int) -> str:
    """A process's exit code, or the signal that ended it."""
    try:
        return f"exit code {code}" if code >= 0 else signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
