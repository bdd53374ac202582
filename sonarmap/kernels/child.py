"""A question to a process of its own: a library that crashes, hangs or takes all memory ends that process alone.

The module that is run calls `answer` with what it sees, step by step, so that what came before the end is known.
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
    """What a process said, step by step in JSON's types, and why it ended before its time, or ""."""

    steps: tuple[dict[str, Any], ...]
    end: str

    def named(self, name: str) -> list[Any]:
        """The values of all steps that have this name."""
        return [step[name] for step in self.steps if name in step]


def ask(module: str, *arguments: str, seconds: float) -> Answers:
    """Run the `main` of a module of this project in another process for so long at most, and gather its answers."""
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
    """In the other process: run the `main` of the module named first, and say that it came to its end."""
    import_module(arguments[0]).main(arguments[1:])
    answer(**_DONE)


def command_of(module: str, *arguments: str) -> list[str]:
    """What runs a module's `main` in another process; the program that calls is not imported there once more."""
    return [sys.executable, "-P", "-c", _PROGRAM.format(module), *arguments]


def environment() -> dict[str, str]:
    """In which `command_of` finds this package."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(_ROOT)]))}


def answer(**step: Any) -> None:
    """Say something to the process that asked; whatever else is printed goes to stderr from the first answer on."""
    global _answers
    if _answers < 0:
        sys.stdout.flush()
        _answers = os.dup(1)
        os.dup2(2, 1)
    os.write(_answers, json.dumps(step).encode() + b"\n")


_answers = -1  # the descriptor that answers are written to


def _steps(output: bytes) -> tuple[dict[str, Any], ...]:
    steps: list[Any] = []
    for line in output.splitlines():
        with suppress(ValueError):  # printed by a library, or cut off
            steps.append(json.loads(line))
    return tuple(step for step in steps if isinstance(step, dict))


def _end(code: int, errors: str) -> str:
    return f"it ended with {end_in_words(code)}: {last_words(errors)}".removesuffix(": ")


def last_words(errors: str) -> str:
    """What of stderr says most: an error's own line, else the last."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower() or "memory" in line.lower()]
    return (telling or lines or [""])[-1][:200]


def end_in_words(code: int) -> str:
    """A process's exit code, or the signal that ended it."""
    try:
        return f"exit code {code}" if code >= 0 else signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
