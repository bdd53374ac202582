"""What can be simulated, in words and sizes: the scenes, the trajectories and the sensors, without building any.

Nothing heavy is imported here: the command line's help reads these tables.
"""

from dataclasses import dataclass
from types import MappingProxyType

FULL_EDGE = 256.0  # side of the paper's grid, and of the scenes that fill it [m]


@dataclass(frozen=True, slots=True)
class SceneKind:
    """What there is to know of a scene before it is built.

    Attributes:
        summary: what stands there, in a few words.
        sensor: the sensor that suits its size, a key of SENSORS.
        size: of the box about the origin that holds what is to be seen, along x and y [m].
        lowest, highest: where a random pair's sensors may be, as corners of a box [m, scene].
        bed: whether rough ground lies under it, which the seed changes.
        inward: whether a random pair looks at the scene's middle rather than anywhere.
    """

    summary: str
    sensor: str
    size: tuple[float, float]
    lowest: tuple[float, float, float]
    highest: tuple[float, float, float]
    bed: bool = True
    inward: bool = False

    @property
    def scale(self) -> float:
        """Its longer side as a share of the 256 m scenes': lengths chosen for these are multiplied by it."""
        return max(self.size) / FULL_EDGE


def _full(summary: str) -> SceneKind:
    """A scene of 256 m by 256 m whose random pairs also look from above the water."""
    edge, reach, far = FULL_EDGE, FULL_EDGE * 35 / 128, float("inf")
    return SceneKind(summary, "eclipse", (edge, edge), (-reach, -reach, -far), (reach, reach, far))


SCENE_KINDS: MappingProxyType[str, SceneKind] = MappingProxyType(
    {
        "floodgate": _full("a flood gate with piers, gates, a lock and shores"),
        "harbor": _full("a harbor basin with quays, a jetty and a moored ship"),
        "clutter": _full("solids strewn over a bed"),
        "ship": SceneKind(
            "the underside of a ship over a bed",
            "eclipse",
            (FULL_EDGE, FULL_EDGE),
            (-80.0, -80.0, -22.0),
            (80.0, 80.0, -3.0),
            inward=True,
        ),
        "pool": SceneKind(
            "a swimming pool of 25 m by 12.5 m",
            "sonar3d15",
            (25.0, 12.5),
            (-11.5, -5.2, -3.0),
            (11.5, 5.2, -0.4),
            bed=False,
        ),
        "manifold": SceneKind(
            "a pipe manifold on the sea bed",
            "sonar3d15",
            (48.0, 48.0),
            (-14.0, -14.0, -39.2),
            (14.0, 14.0, -32.0),
            inward=True,
        ),
        "bridge": _full("a road bridge over a river, its plan drawn from the seed"),
        "wreck": SceneKind(
            "a broken wreck among rock ledges, its plan drawn from the seed",
            "eclipse",
            (FULL_EDGE, FULL_EDGE),
            (-80.0, -80.0, -27.0),
            (80.0, 80.0, -3.0),
            inward=True,
        ),
    }
)

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
