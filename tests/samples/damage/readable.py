"""A file that can be read, whole."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Readable:
    """A file, and what has to hold of it where it is read: `check` raises InputError where it is refused."""

    name: str
    content: bytes
    check: Callable[[Path], None]
