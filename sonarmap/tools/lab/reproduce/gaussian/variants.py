"""The variants of the paper's chain that the experiment compares. A new one is a row of VARIANTS."""

from dataclasses import dataclass
from types import MappingProxyType

from sonarmap.spectral.hemisphere.registration import HemisphereConfig


@dataclass(frozen=True, slots=True)
class ChainVariant:
    """A configuration of the paper's chain.

    Attributes:
        title: what it does, in words.
        config: of the spectral registration.
    """

    title: str
    config: HemisphereConfig


# Name in tables and files -> variant
VARIANTS: MappingProxyType[str, ChainVariant] = MappingProxyType(
    {
        "paper": ChainVariant(
            "the paper's chain: the steps of Sect. 2.11 once, with the paper's windows, along the highest yaw peak",
            HemisphereConfig.paper(),
        ),
        "one peak": ChainVariant(
            "the chain along the highest yaw peak, with the rotation refined", HemisphereConfig(yaw_peaks=1)
        ),
        "six peaks": ChainVariant(
            "the chain along the six highest yaw peaks, with the rotation refined; these are the defaults of the "
            "method `hemisphere`",
            HemisphereConfig(yaw_peaks=6),
        ),
    }
)
