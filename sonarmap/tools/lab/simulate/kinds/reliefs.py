"""What every scene gives a registration to hold on to, so that each kind of scan is tried over all of it."""

from types import MappingProxyType

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.kinds.kind import Relief

RELIEF_OF: MappingProxyType[str, Relief] = MappingProxyType(
    {
        "flatbed": "flat",
        "sandflat": "flat",
        "seabed": "weak",
        "shallow": "weak",
        "floodgate": "rich",
        "harbor": "rich",
        "wreck": "rich",
        "bridge": "rich",
        "clutter": "rich",
        "rubble": "rich",
        "ship": "twins",
        "manifold": "twins",
        "pool": "twins",
    }
)


def relief_of(scene: str) -> Relief:
    """The relief of a scene of SCENE_KINDS.

    Raises:
        InputError: a scene that has no row here.
    """
    if scene not in RELIEF_OF:
        raise InputError(f"no relief is known of the scene {scene!r}; give it a row in `RELIEF_OF`")
    return RELIEF_OF[scene]
