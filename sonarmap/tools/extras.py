"""Packages that an extra of sonarmap brings: imported where they are used, and named where they are missing."""

from importlib import import_module
from types import ModuleType

from sonarmap.kernels.errors import InputError

EXTRA_OF = {"open3d": "lab"}  # a module that code imports by itself, and the extra that brings it


def load_package(module: str, package: str, purpose: str, extra: str) -> ModuleType:
    """The module of an optional package.

    Args:
        module: what to import.
        package: what pip calls it.
        purpose: what it is wanted for, in words.
        extra: of sonarmap, that brings it.

    Raises:
        InputError: it is not installed, or does not load.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"{purpose} needs the package {package}, which does not load here ({error}). {how_to_install(extra)}, or "
            f"pip install {package} alone."
        ) from error


def how_to_install(extra: str) -> str:
    """The line that brings an extra, as a sentence without its end."""
    return f"Install it with pip install 'sonarmap[{extra}]'"
