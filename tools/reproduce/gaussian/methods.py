"""The methods that the experiments compare. A new one is a row of METHODS."""

from dataclasses import dataclass
from types import MappingProxyType

from spectral.hemisphere.registration import HemisphereConfig


@dataclass(frozen=True, slots=True)
class Method:
    """One way to register.

    Attributes:
        title: what it does, in words.
        config: of the spectral registration.
    """

    title: str
    config: HemisphereConfig


# Name in tables and files -> method
METHODS: MappingProxyType[str, Method] = MappingProxyType(
    {
        "paper": Method(
            "the paper's chain: the steps of Sect. 2.11 once, with its windows, along the highest yaw peak",
            HemisphereConfig.paper(),
        ),
        "one peak": Method("one yaw peak, the rotation refined", HemisphereConfig(yaw_peaks=1)),
        "six peaks": Method("six yaw peaks, the rotation refined", HemisphereConfig(yaw_peaks=6)),
    }
)
