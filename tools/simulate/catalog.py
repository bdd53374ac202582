"""The trajectories and the sensors that can be simulated, in words; the scenes are in scenes/catalog.py.

Nothing heavy is imported here: the command line's help reads these tables.
"""

from types import MappingProxyType

TRAJECTORY_KINDS: MappingProxyType[str, str] = MappingProxyType(
    {
        "survey": "a closed path, gone round again and again",
        "loop": "the closed path once, evenly, so that the last scan sees again what the first saw",
        "lawnmower": "lanes to and fro and tie lines across them, again and again",
        "paper18": "up to 18 scans of the floodgate with 90 to 50 percent overlap, as in the paper's Sect. 4",
        "table1": "the paper's reference scan and S0 to S9",
    }
)

SENSOR_NAMES = ("eclipse", "paper", "sonar3d15")
