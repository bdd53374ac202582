"""A check that input is refused."""

from collections.abc import Callable
from typing import Any

import pytest

from sonarmap.kernels.errors import InputError


def refuses(message: str, function: Callable[..., Any], *given: Any, **options: Any) -> None:
    """Check that a function refuses these arguments with an InputError whose message matches."""
    with pytest.raises(InputError, match=message):
        function(*given, **options)
