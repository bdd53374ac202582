"""The versions of what a result depends on."""

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("sonarmap", "numpy", "scipy", "pyopencl", "gtsam", "open3d")


def package_versions(*also: str) -> dict[str, str | None]:
    """The versions of Python and of what the numbers depend on; None for a package that is not installed."""
    versions: dict[str, str | None] = {"python": platform.python_version(), "system": platform.platform()}
    for package in (*PACKAGES, *also):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    return versions
