"""`python -m sonarmap` is the command `sonarmap`."""

from sonarmap.tools.command.start import start

start()
