"""What the registration measures of a few pairs: where that changes, what was fitted before is out of date."""

from typing import Any

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.simulate.kinds.catalog import kind_pair

_KIND, _NUMBERS, _SEED, _EDGE = "patch", (1, 3, 4), 880_302, 64
# What is measured alone: the table itself has a part in the others
_MEASURED = ("psr", "view", "surface", "sharpness", "firmness", "overlap", "slide_0", "slide_1", "slide_2", "turn_0")


def reference(device: Device) -> dict[str, Any]:
    """The clues of some pairs that are measured alone, by the pairs' numbers."""
    found = {}
    for number in _NUMBERS:
        pair = kind_pair(_KIND, number, _SEED)
        registrar = SpectralRegistrar(device, choose_grid((pair.target, pair.source), _EDGE))
        registration = registrar.register(registrar.prepare(pair.target), registrar.prepare(pair.source))
        evidence = dict(registration.evidence)
        found[str(number)] = {name: round(evidence[f"p_{name}"], 3) for name in _MEASURED}
    return found
