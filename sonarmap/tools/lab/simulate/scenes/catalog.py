"""The scenes that can be simulated: what each shows, how large it is, and its builder. A new scene is a file beside
this one and a row here; the path of a survey through it is laid in routes.py.

Nothing heavy is imported here: the command line's help reads the table.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from sonarmap.tools.lab.simulate.scenes.solids import Mesh

FULL_EDGE = 256.0  # side of the paper's grid, and of the scenes that fill it [m]


@dataclass(frozen=True, slots=True)
class SceneKind:
    """A scene's description and builder."""

    builder: str  # the function that builds it, as "module:function" of this folder
    summary: str  # description in a few words
    sensor: str  # the sensor that suits its size, a key of SENSORS
    size: tuple[float, float]  # of the box around the origin that holds the scene, along x and y [m]
    lowest: tuple[float, float, float]  # corner of the bounds of a random pair's sensors [m, scene]
    highest: tuple[float, float, float]  # the opposite corner [m, scene]
    inward: bool = False  # whether a random pair looks at the scene's middle rather than anywhere

    @property
    def scale(self) -> float:
        """Its longer side divided by 256 m, the factor of lengths chosen for scenes of 256 m."""
        return max(self.size) / FULL_EDGE

    def build(self, seed: int) -> "Mesh":
        """Build its surface, East-North-Up [m], which is the same for the same seed."""
        module, _, function = self.builder.partition(":")
        build: Callable[[int], Mesh] = getattr(import_module(f"sonarmap.tools.lab.simulate.scenes.{module}"), function)
        return build(seed)


def _kind(
    builder: str,
    summary: str,
    size: tuple[float, float],
    reach: tuple[float, float],
    heights: tuple[float, float],
    inward: bool = False,
) -> SceneKind:
    """A scene; sensors of random pairs are within `reach` of its middle along x and y and between two heights [m]."""
    sensor, (x, y), (low, high) = "eclipse" if max(size) == FULL_EDGE else "sonar3d15", reach, heights
    return SceneKind(builder, summary, sensor, size, (-x, -y, low), (x, y, high), inward)


def _full(builder: str, summary: str) -> SceneKind:
    """A scene of 256 m by 256 m whose random pairs may also look from above the water."""
    reach, far = FULL_EDGE * 35 / 128, float("inf")
    return _kind(builder, summary, _LARGE, (reach, reach), (-far, far))


def _bed(name: str, summary: str, edge: float) -> SceneKind:
    """A square open bed under 22 m of water at 256 m; sensors of random pairs are in this water."""
    scale = edge / FULL_EDGE
    return _kind(f"bed:{name}", summary, (edge, edge), (80 * scale, 80 * scale), (-20 * scale, -scale))


_LARGE = FULL_EDGE, FULL_EDGE
_WRECK = "a broken wreck among rock ledges, its plan drawn from the seed"

SCENE_KINDS: Mapping[str, SceneKind] = {
    "floodgate": _full("floodgate:floodgate", "a flood gate with piers, gates, a lock and shores"),
    "harbor": _full("harbor:harbor", "a harbor basin with quays, a jetty and a moored ship"),
    "clutter": _full("bed:clutter", "solids strewn over a bed"),
    "ship": _kind("ship:ship", "the underside of a ship over a bed", _LARGE, (80, 80), (-22, -3), inward=True),
    "pool": _kind("pool:pool", "a swimming pool of 25 m by 12.5 m", (25, 12.5), (11.5, 5.2), (-3, -0.4)),
    "manifold": _kind(
        "manifold:manifold", "a pipe manifold on the sea bed", (48, 48), (14, 14), (-39.2, -32), inward=True
    ),
    "bridge": _full("bridge:bridge", "a road bridge over a river, its plan drawn from the seed"),
    "wreck": _kind("wreck:wreck", _WRECK, _LARGE, (80, 80), (-27, -3), inward=True),
    "flatbed": _bed("flatbed", "a bed of sand, flat to a few centimeters", FULL_EDGE),
    "sandflat": _bed("sandflat", "the same, 40 m on a side", 40.0),
    "seabed": _bed("seabed", "a bed with dunes, scours and a few rocks, 0.5 to 2 m high", FULL_EDGE),
    "shallow": _bed("shallow", "the same made smaller, 40 m on a side", 40.0),
    "rubble": _kind("bed:rubble", "the clutter made smaller, 40 m on a side", (40, 40), (12.5, 12.5), (-9, -0.3)),
}


def scene_kind(name: str) -> SceneKind:
    """The SceneKind called `name`. Raises InputError: there is none."""
    if name not in SCENE_KINDS:
        raise InputError(f"no scene is called {name!r}; there are {', '.join(SCENE_KINDS)}")
    return SCENE_KINDS[name]


TRAJECTORY_KINDS: Mapping[str, str] = {
    "survey": "round and round a closed path",
    "loop": "once around the closed path, so that the last scan sees what the first one saw",
    "lawnmower": "parallel lanes and tie lines across them, repeated",
    "paper18": "up to 18 scans of the floodgate with 90 to 50 percent overlap, as in the paper's Sect. 4",
    "table1": "the paper's reference scan and S0 to S9",
}

SENSOR_NAMES = ("eclipse", "paper", "sonar3d15")
