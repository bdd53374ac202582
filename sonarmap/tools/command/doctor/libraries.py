"""Python and the libraries: those that sonarmap requires, those that give it more, and whether they can be loaded."""

import importlib.metadata as metadata
import platform
import re
import shlex
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sonarmap.tools.command.doctor.finding import Finding, Remedy

_PROJECT = Path(__file__).resolve().parents[4] / "pyproject.toml"
_SECONDS = 120.0  # to load all of them; on a cold disk a minute
# What the extras of pyproject.toml are good for; "dev" is for who works on sonarmap itself.
EXTRAS = {
    "gis": "export of GeoTIFF and GeoPackage",
    "multibeam": "lines of an echo sounder, GSF and XTF",
    "ros": "bags of ROS and MCAP",
    "live": "live",
    "mesh": "export of meshes",
    "e57": "export of E57",
    "lab": "simulate, reproduce, bench, evaluate --surface, and methods by Open3D",
    "all": "all of these",
    "peers": "--method kiss and gicp",
    "slam-peers": "maps by KISS-SLAM in reproduce",
    "bench": "FFTW in bench",
    "cluster": "map --scheduler",
    "docs": "the documentation as a site",
    "opencl": "an OpenCL driver for processors without root",
}
# An OpenCL driver for processors without root: the extra "opencl".
DRIVER_OF_PIP = ("intel-opencl-rt", "intel-cmplr-lib-rt")
# The Debian packages of system libraries that wheels load and do not bring; tools/setup.sh installs them.
APT_PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libX11.so.6": "libx11-6",
    "libOpenCL.so.1": "ocl-icd-libopencl1",
}
# Modules whose names their distributions do not tell.
_MODULES = {"pillow": "PIL", "protobuf": "google.protobuf", "python-neo-lzf": "lzf", "pyfftw": "pyfftw"}
_NO_MEMORY = ("failed to map segment", "MemoryError", "out of memory", "Cannot allocate memory")  # see memory
_EXTRA = re.compile(r"extra\s*==\s*[\"']([\w-]+)[\"']")
_SHARED_OBJECT = re.compile(r"(lib[\w.+-]+\.so[\w.]*): cannot open shared object file")


@dataclass(frozen=True, slots=True)
class Requirement:
    """A line of pyproject.toml."""

    text: str  # as it stands there, without its marker
    name: str  # of the distribution
    extra: str  # that asks for it; "" for what is always required
    installed: str  # its version, or ""
    fits: bool  # whether that version is one of those wanted


def python_version() -> Finding:
    """Whether this Python is new enough."""
    wanted = _project()[0]
    seen = f"{platform.python_version()}, {platform.system()} {platform.machine()}; wanted {wanted}"
    details = {"version": platform.python_version(), "wanted": wanted, "executable": sys.executable}
    least = tuple(int(part) for part in re.findall(r"\d+", wanted)[:2])
    if sys.version_info[:2] >= least:
        return Finding("ok", seen, details=details)
    newer = Remedy("make an environment of a newer Python:", "PYTHON=/path/to/python3 tools/setup.sh")
    return Finding("wrong", seen, (newer,), details)


def required_libraries(load: bool) -> Finding:
    """Whether everything that sonarmap requires is installed, in a version that fits, and can be loaded, which takes
    some seconds; without `load` that is not tried."""
    required = [requirement for requirement in _requirements() if not requirement.extra]
    bad = [requirement for requirement in required if not requirement.fits]
    faults = _load_faults([entry.name for entry in required if entry.installed]) if load else {}
    details = {
        "required": {entry.name: {"wanted": entry.text, "installed": entry.installed or None} for entry in required},
        "cannot be loaded": faults,
    }
    if not bad and not faults:
        loaded = "as required, and can be loaded" if load else "as required (not loaded: --quick)"
        return Finding("ok", f"all {len(required)} {loaded}", details=details)
    seen = [f"{entry.name} {entry.installed or 'is not installed'}, wanted {entry.text}" for entry in bad]
    seen += [
        f"{name} cannot be loaded: {fault}{'; see memory' if _lacks_memory(fault) else ''}"
        for name, fault in faults.items()
    ]
    return Finding("wrong", "\n".join(seen), tuple(_remedies(bad, faults)), details)


def optional_libraries() -> Finding:
    """Which of the libraries that give more are missing."""
    extras = [requirement for requirement in _requirements() if requirement.extra in EXTRAS]
    missing = [requirement for requirement in extras if not requirement.fits]
    details = {"missing": {entry.name: entry.extra for entry in missing}, "gives": EXTRAS}
    if not missing:
        return Finding("ok", f"all {len(extras)} are installed", details=details)
    names = {extra: [entry.name for entry in missing if entry.extra == extra] for extra in EXTRAS}
    seen = [f"{', '.join(names[extra])} ({EXTRAS[extra]}: [{extra}])" for extra in EXTRAS if names[extra]]
    return Finding("ok", "not installed: " + "; ".join(seen), details=details)


def shared_object_remedy(fault: str) -> Remedy | None:
    """How to get the system library that an error names; None where it names none."""
    library = match[1] if (match := _SHARED_OBJECT.search(fault)) else ""
    package = APT_PACKAGES.get(library)
    return Remedy(f"install {library}:", f"sudo apt-get install {package}") if package else None


def _lacks_memory(fault: str) -> bool:
    return any(words in fault for words in _NO_MEMORY)


def pip_command(*wanted: str) -> str:
    """How to install distributions where this Python looks for them."""
    return shlex.join([sys.executable, "-m", "pip", "install", *wanted])


def main(arguments: Sequence[str]) -> None:
    """In the other process: load each of the distributions."""
    from importlib import import_module

    from sonarmap.kernels.child import answer

    modules = metadata.packages_distributions()
    for name in arguments:
        module = _module_of(name, modules)
        answer(begins=name)
        try:
            import_module(module)
        except Exception as error:  # noqa: BLE001 - whatever a broken library raises is what is asked for
            answer(fault=[name, " ".join(f"{type(error).__name__}: {error}".split())[:300]])


def _load_faults(names: list[str]) -> dict[str, str]:
    """Which distributions cannot be loaded, and why; one that ends the process is blamed, and the others are tried."""
    from sonarmap.kernels.child import ask

    faults: dict[str, str] = {}
    while names:
        answers = ask("sonarmap.tools.command.doctor.libraries", *names, seconds=_SECONDS)
        faults |= dict(answers.named("fault"))
        if not answers.end:
            break
        culprit = [names[0], *answers.named("begins")][-1]
        faults[culprit] = answers.end
        names = names[names.index(culprit) + 1 :]
    return faults


def _module_of(name: str, modules: Mapping[str, Sequence[str]]) -> str:
    """The module to load for a distribution: that of its name, or the first that it brings."""
    normal = _normal(name)
    if normal in _MODULES:
        return _MODULES[normal]
    brought = [module for module, owners in modules.items() if normal in map(_normal, owners)]
    ranked = sorted(brought, key=lambda module: (_normal(module) != normal, module.startswith("_")))
    return ranked[0] if ranked else name.replace("-", "_")


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _remedies(bad: Iterable[Requirement], faults: dict[str, str]) -> Iterable[Remedy]:
    if texts := [requirement.text for requirement in bad]:
        yield Remedy("install what is missing:", pip_command(*texts))
    packages = [remedy for fault in faults.values() if (remedy := shared_object_remedy(fault)) is not None]
    yield from dict.fromkeys(packages)
    broken = [name for name, fault in faults.items() if not _lacks_memory(fault)]
    if again := [name for name in broken if shared_object_remedy(faults[name]) is None]:
        yield Remedy("install again what cannot be loaded:", pip_command("--force-reinstall", "--no-deps", *again))


def _requirements() -> list[Requirement]:
    """All of pyproject.toml, with what is installed of each."""
    from packaging.requirements import Requirement as Line

    requirements: list[Requirement] = []
    for extra, text in _project()[1]:
        line = Line(text)
        if line.name == "sonarmap" or (line.marker and not line.marker.evaluate({"extra": extra})):
            continue
        try:
            installed = metadata.version(line.name)
        except metadata.PackageNotFoundError:
            installed = ""
        fits = bool(installed) and line.specifier.contains(installed, prereleases=True)
        wanted = text.partition(";")[0].strip()
        requirements.append(Requirement(wanted, line.name, extra, installed, fits))
    return requirements


def _project() -> tuple[str, list[tuple[str, str]]]:
    """The Python that is wanted, and the required lines with their extras: of the checkout, or as it was installed.

    A checkout may have been updated after it was installed.
    """
    if _PROJECT.is_file():
        project = tomllib.loads(_PROJECT.read_text(encoding="utf-8"))["project"]
        extras = project.get("optional-dependencies", {})
        lines = [("", text) for text in project["dependencies"]]
        return project["requires-python"], lines + [(extra, text) for extra in extras for text in extras[extra]]
    about = metadata.metadata("sonarmap")
    lines = [(match[1] if (match := _EXTRA.search(text)) else "", text) for text in metadata.requires("sonarmap") or []]
    return about["Requires-Python"] or ">=3", lines
