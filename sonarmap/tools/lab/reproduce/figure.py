"""Writing a figure of an experiment."""

from pathlib import Path
from typing import Any

from sonarmap.tools.files.writers.atomic import atomic_path


def save_figure(figure: Any, path: Path) -> None:
    """Write a matplotlib figure as PNG.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")
