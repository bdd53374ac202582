"""Optional packages, which the extras of sonarmap install: import on use, and an error that names a missing one."""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from sonarmap.kernels.errors import InputError

# Optional module -> the extra that installs it.
EXTRA_OF = {
    "rasterio": "gis",
    "pyogrio": "gis",
    "gsfpy3_09": "multibeam",
    "pyxtf": "multibeam",
    "rosbags": "ros",
    "mcap": "ros",
    "lz4": "ros",
    "zstandard": "ros",
    "websockets": "live",
    "trimesh": "mesh",
    "pye57": "e57",
    "open3d": "lab",
    "pandas": "lab",
}


def load_package(module: str, package: str, purpose: str, extra: str) -> ModuleType:
    """Import the module of an optional package.

    Args:
        module: name of the module.
        package: name of the package for pip.
        purpose: what needs it, for the error message.
        extra: the extra of sonarmap that installs it.

    Raises:
        InputError: the package is not installed, or does not load.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"{purpose} needs the package {package}, which does not load ({error}). {how_to_install(extra)}"
        ) from error


def require(module: str) -> None:
    """Raise InputError if a module of `EXTRA_OF` is not installed: before long work that needs it only at its end."""
    if find_spec(module) is None:
        raise InputError(f"this needs {module}, which is not installed. {how_to_install(EXTRA_OF[module])}")


def how_to_install(extra: str) -> str:
    """How to install an extra, as a sentence without its final period."""
    return f"Install it with pip install 'sonarmap[{extra}]'"
