"""Packages that an extra of sonarmap brings: imported where they are used, and named where they are missing."""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from sonarmap.kernels.errors import InputError

# The modules that code imports by itself, each with the extra that brings it.
EXTRA_OF = {
    "rasterio": "gis",
    "pyogrio": "gis",
    "gsfpy3_09": "multibeam",
    "pyxtf": "multibeam",
    "rosbags": "ros",
    "mcap": "ros",
    "lz4": "ros",
    "zstandard": "ros",
    "ruamel": "ros",
    "websockets": "live",
    "trimesh": "mesh",
    "pye57": "e57",
    "open3d": "lab",
    "pandas": "lab",
}


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


def require(module: str) -> None:
    """Raises InputError: a module of `EXTRA_OF` is not installed. For what is used at the end of long work."""
    if find_spec(module) is None:
        raise InputError(f"this needs {module}, which is not installed. {how_to_install(EXTRA_OF[module])}")


def how_to_install(extra: str) -> str:
    """The line that brings an extra, as a sentence without its end."""
    return f"Install it with pip install 'sonarmap[{extra}]'"
