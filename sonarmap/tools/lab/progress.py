"""How long work tells of its progress without knowing who listens."""

from collections.abc import Callable
from contextlib import AbstractContextManager

# Follows work: label and number of pieces to a context that gives a function to call after each.
Follow = Callable[[str, int], AbstractContextManager[Callable[[str], None]]]
