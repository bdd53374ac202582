"""The scenes that can be simulated: what each shows, how large it is, what builds it. A new scene is a file beside
this one and a row here; the path of a survey through it is laid in paths/routes.py.

Nothing heavy is imported here: the command line's help reads the table.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from sonarmap.tools.lab.simulate.shapes.solids import Mesh

FULL_EDGE = 256.0  # side of the paper's grid, and of the scenes that fill it [m]


@dataclass(frozen=True, slots=True)
class SceneKind:
    """A scene that has not been built.

    Attributes:
        builder: the function that builds it, as "module:function".
        summary: what stands there, in a few words.
        sensor: the sensor that suits its size, a key of SENSORS.
        size: of the box around the origin that holds everything there is to see, along x and y [m].
        lowest, highest: corners of the box in which the sensors of a random pair may be [m, scene].
        inward: whether a random pair looks at the scene's middle rather than anywhere.
    """

    builder: str
    summary: str
    sensor: str
    size: tuple[float, float]
    lowest: tuple[float, float, float]
    highest: tuple[float, float, float]
    inward: bool = False

    @property
    def scale(self) -> float:
        """Its longer side divided by 256 m: lengths chosen for the scenes of 256 m are multiplied by it."""
        return max(self.size) / FULL_EDGE

    def build(self, seed: int) -> "Mesh":
        """Its surface, East-North-Up [m]: the same seed, the same surface."""
        module, _, function = self.builder.partition(":")
        build: Callable[[int], Mesh] = getattr(import_module(module), function)
        return build(seed)


def _full(builder: str, summary: str) -> SceneKind:
    """A scene of 256 m by 256 m whose random pairs may also look from above the water."""
    edge, reach, far = FULL_EDGE, FULL_EDGE * 35 / 128, float("inf")
    return SceneKind(builder, summary, "eclipse", (edge, edge), (-reach, -reach, -far), (reach, reach, far))


def _bed(name: str, summary: str, edge: float) -> SceneKind:
    """An open bed, square, its water as deep as 22 m at 256 m; pairs are seen from the water above it."""
    scale = edge / FULL_EDGE
    sensor = "eclipse" if scale == 1.0 else "sonar3d15"
    low, high = ((-80.0, -80.0, -20.0), (80.0, 80.0, -1.0))
    lowest, highest = ((scale * x, scale * y, scale * z) for x, y, z in (low, high))
    return SceneKind(
        f"sonarmap.tools.lab.simulate.scenes.open_bed:{name}", summary, sensor, (edge, edge), lowest, highest
    )


SCENE_KINDS: MappingProxyType[str, SceneKind] = MappingProxyType(
    {
        "floodgate": _full(
            "sonarmap.tools.lab.simulate.scenes.floodgate:floodgate",
            "a flood gate with piers, gates, a lock and shores",
        ),
        "harbor": _full(
            "sonarmap.tools.lab.simulate.scenes.harbor:harbor", "a harbor basin with quays, a jetty and a moored ship"
        ),
        "clutter": _full("sonarmap.tools.lab.simulate.scenes.clutter:clutter", "solids strewn over a bed"),
        "ship": SceneKind(
            "sonarmap.tools.lab.simulate.scenes.ship:ship",
            "the underside of a ship over a bed",
            "eclipse",
            (FULL_EDGE, FULL_EDGE),
            (-80.0, -80.0, -22.0),
            (80.0, 80.0, -3.0),
            inward=True,
        ),
        "pool": SceneKind(
            "sonarmap.tools.lab.simulate.scenes.pool:pool",
            "a swimming pool of 25 m by 12.5 m",
            "sonar3d15",
            (25.0, 12.5),
            (-11.5, -5.2, -3.0),
            (11.5, 5.2, -0.4),
        ),
        "manifold": SceneKind(
            "sonarmap.tools.lab.simulate.scenes.manifold:manifold",
            "a pipe manifold on the sea bed",
            "sonar3d15",
            (48.0, 48.0),
            (-14.0, -14.0, -39.2),
            (14.0, 14.0, -32.0),
            inward=True,
        ),
        "bridge": _full(
            "sonarmap.tools.lab.simulate.scenes.bridge:bridge",
            "a road bridge over a river, its plan drawn from the seed",
        ),
        "wreck": SceneKind(
            "sonarmap.tools.lab.simulate.scenes.wreck:wreck",
            "a broken wreck among rock ledges, its plan drawn from the seed",
            "eclipse",
            (FULL_EDGE, FULL_EDGE),
            (-80.0, -80.0, -27.0),
            (80.0, 80.0, -3.0),
            inward=True,
        ),
        "flatbed": _bed("flatbed", "a bed of sand, flat to a few centimeters", FULL_EDGE),
        "sandflat": _bed("sandflat", "the same, 40 m on a side", 40.0),
        "seabed": _bed("seabed", "a bed with dunes, scours and a few rocks, 0.5 to 2 m high", FULL_EDGE),
        "shallow": _bed("shallow", "the same made smaller, 40 m on a side", 40.0),
        "rubble": SceneKind(
            "sonarmap.tools.lab.simulate.scenes.clutter:rubble",
            "the clutter made smaller, 40 m on a side",
            "sonar3d15",
            (40.0, 40.0),
            (-12.5, -12.5, -9.0),
            (12.5, 12.5, -0.3),
        ),
    }
)


def scene_kind(name: str) -> SceneKind:
    """The scene called `name`, not built.

    Raises:
        InputError: there is none.
    """
    if name not in SCENE_KINDS:
        raise InputError(f"no scene is called {name!r}; there are {', '.join(SCENE_KINDS)}")
    return SCENE_KINDS[name]
