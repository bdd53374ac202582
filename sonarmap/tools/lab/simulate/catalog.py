"""The trajectories and the sensors that can be simulated, in words; the scenes are in scenes/catalog.py.

Nothing heavy is imported here: the command line's help reads these tables.
"""

from types import MappingProxyType

TRAJECTORY_KINDS: MappingProxyType[str, str] = MappingProxyType(
    {
        "survey": "round and round a closed path",
        "loop": "once around the closed path, so that the last scan sees what the first one saw",
        "lawnmower": "parallel lanes and tie lines across them, repeated",
        "paper18": "up to 18 scans of the floodgate with 90 to 50 percent overlap, as in the paper's Sect. 4",
        "table1": "the paper's reference scan and S0 to S9",
    }
)

SENSOR_NAMES = ("eclipse", "paper", "sonar3d15")
