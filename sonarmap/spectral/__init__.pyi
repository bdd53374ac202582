from .grid import Grid as Grid
from .grid import choose_grid as choose_grid
from .hemisphere import HemisphereConfig as HemisphereConfig
from .hemisphere import HemisphereRegistrar as HemisphereRegistrar
from .prior import RelativePrior as RelativePrior
from .prior import relative_prior as relative_prior
from .registration import SpectralConfig as SpectralConfig
from .registration import SpectralRegistrar as SpectralRegistrar
from .result import Registrar as Registrar
from .result import Registration as Registration
from .scan import PosePrior as PosePrior
from .scan import Scan as Scan

__all__ = [
    "Grid",
    "HemisphereConfig",
    "HemisphereRegistrar",
    "PosePrior",
    "Registrar",
    "Registration",
    "RelativePrior",
    "Scan",
    "SpectralConfig",
    "SpectralRegistrar",
    "choose_grid",
    "relative_prior",
]
