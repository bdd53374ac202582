"""The options that say what a command tells while it runs."""

from pathlib import Path
from typing import Annotated

import typer

from sonarmap.tools.command.options.groups import RUNNING

LogFileOption = Annotated[
    Path | None,
    typer.Option(
        "--log-file",
        metavar="FILE",
        dir_okay=False,
        help="Add everything that is said, with times, to the end of FILE.",
        rich_help_panel=RUNNING,
        hidden=True,
    ),
]
VerboseOption = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        help="Print the table of pairs and all warnings too.",
        rich_help_panel=RUNNING,
    ),
]
