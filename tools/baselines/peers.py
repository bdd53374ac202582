"""Packages beyond sonarmap's own: imported where they are installed; where not, the error says how to get them."""

from importlib import import_module
from types import ModuleType

from kernels.errors import InputError


def peer(module: str, package: str, method: str, extra: str = "peers") -> ModuleType:
    """The module of an optional package.

    Args:
        module: what to import.
        package: what pip calls it.
        method: what it was wanted for, as `--method` takes it.
        extra: of sonarmap, that brings it.

    Raises:
        InputError: it is not installed, or does not load.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"the method {method} wants the package {package}, which does not load here ({error}). Install it with "
            f"pip install 'sonarmap[{extra}]', or pip install {package} alone."
        ) from error
