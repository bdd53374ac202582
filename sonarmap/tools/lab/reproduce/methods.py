"""The methods that the evaluations compare, and how each is built for a pair."""

from dataclasses import dataclass

from sonarmap.spectral.grid import Grid
from sonarmap.spectral.result import Registrar
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.methods.registry import Setup, find_method, is_installed

OURS = "spectral"
EVALUATED = (OURS, "hemisphere", "kiss", "fpfh-ransac", "fpfh-fgr", "icp", "icp-plane", "planes")
# The code that decides the rows of an experiment on simulated pairs, beside the methods'
METHOD_SOURCES = (
    *("tools/lab/simulate", "tools/lab/evaluate", "spectral/grid.py"),
    *("tools/lab/reproduce/methods.py", "tools/lab/reproduce/answer.py"),
)


@dataclass(frozen=True, slots=True)
class ComparedMethods:
    """The methods of an experiment."""

    methods: tuple[str, ...] = EVALUATED  # keys of METHODS, in the order in which they are shown
    left_out: tuple[str, ...] = ()  # methods whose packages are not installed


def compared_methods(request: Request) -> ComparedMethods:
    """The methods that were asked for, or all that are installed.

    Raises:
        InputError: a method that was asked for is unknown or not installed.
    """
    if request.method:
        for name in request.method:
            if not is_installed(name):
                registrar(name, Grid(16, 1.0), None)  # its error says what to install
        return ComparedMethods(request.method)
    left_out = tuple(name for name in EVALUATED if not is_installed(name))
    return ComparedMethods(tuple(name for name in EVALUATED if name not in left_out), left_out)


def registrar(name: str, grid: Grid, device: str | None, max_tilt: float | None = None) -> Registrar:
    """A method, a key of METHODS, with its defaults, the same whatever pair it is built for.

    A method that bounds roll and pitch does so at `max_tilt` [rad], if given. `device` is as `choose_device` takes it.

    Raises:
        InputError, DeviceError: there is no such method, its package is not installed, or the device is too small.
    """
    method = find_method(name)
    changes = {} if max_tilt is None or "max_tilt" not in method.options else {"max_tilt": max_tilt}
    return method.make(Setup(grid, device, changes=changes))
