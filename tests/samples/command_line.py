"""The command line as a subprocess."""

import os
import subprocess
import sys

from tests.samples.places import ROOT

SONARMAP = [sys.executable, "-c", "from sonarmap.tools.command.main import run; run()"]


def sonarmap(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*SONARMAP, *arguments], cwd=ROOT, capture_output=True, text=True, env=os.environ | environment
    )
