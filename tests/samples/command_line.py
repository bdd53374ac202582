"""The command line as a subprocess, and the output of programs on a terminal."""

import io
import os
import pty
import subprocess
import sys

from tests.samples.places import ROOT

SONARMAP = [sys.executable, "-c", "from sonarmap.tools.command.main import run; run()"]


def sonarmap(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*SONARMAP, *arguments], cwd=ROOT, capture_output=True, text=True, env=os.environ | environment
    )


def on_a_terminal(program: str, columns: int = 100) -> str:
    """Output of a program on stderr, which is a terminal."""
    master, terminal = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "CI", "TERM")}
    environment |= {"TERM": "xterm", "COLUMNS": str(columns)}
    with os.fdopen(terminal, "wb") as stderr:
        subprocess.run([sys.executable, "-c", program], cwd=ROOT, stderr=stderr, check=True, env=environment)
    shown = io.BytesIO()
    try:
        while chunk := os.read(master, 4096):
            shown.write(chunk)
    except OSError:  # Linux raises EIO once a terminal's other side is closed
        pass
    finally:
        os.close(master)
    return shown.getvalue().decode()
