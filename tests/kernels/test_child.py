"""Answers of another process, however it ends."""

from pathlib import Path

import pytest

from sonarmap.kernels.child import ask


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path / "probe_of_test.py"


def test_output_of_libraries_is_no_answer(module: Path) -> None:
    module.write_text(
        "import os\nfrom sonarmap.kernels.child import answer\n"
        "def main(arguments):\n    print('hello'); answer(a=1); print('{}')\n"
        "    os.system('echo 7'); answer(b=arguments)\n"
    )
    answers = ask("probe_of_test", "x", "y z", seconds=200)
    assert (answers.steps, answers.end) == (({"a": 1}, {"b": ["x", "y z"]}), "")


@pytest.mark.parametrize(
    ("program", "seconds", "end"),
    [
        ("os.kill(os.getpid(), 6)", 200, "it ended with SIGABRT: LLVM ERROR: out of memory"),
        ("raise ValueError('no')", 200, "it ended with exit code 1: ValueError: no"),
        ("os._exit(0)", 200, "it ended with exit code 0"),
        pytest.param("time.sleep(600)", 6, "it did not answer within 6 s", marks=pytest.mark.slow),
    ],
)
def test_answers_before_a_crash_are_kept(module: Path, program: str, seconds: float, end: str) -> None:
    first = "sys.stderr.write('LLVM ERROR: out of memory\\nAllocation failed\\n')" if "kill" in program else "pass"
    module.write_text(
        "import os, sys, time\nfrom sonarmap.kernels.child import answer\n"
        f"def main(arguments):\n    answer(a=1); {first}; {program}\n"
    )
    answers = ask("probe_of_test", seconds=seconds)
    assert (answers.steps, answers.end) == (({"a": 1},), end)
