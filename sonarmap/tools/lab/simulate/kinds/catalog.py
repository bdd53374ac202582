"""The kinds of scans that can be simulated in pairs; a new kind is a file beside this one and a row here.

Nothing heavy is imported here: the command line's help reads the table.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from sonarmap.tools.lab.simulate.kinds.kind import KindPair


@dataclass(frozen=True, slots=True)
class ScanKind:
    """A kind of scan."""

    summary: str  # in a few words
    # the function that makes pair `number` of the set `seed`, as "module:function" of this folder; it takes (number,
    # seed, scene, overlaps) and returns a KindPair
    builder: str
    scenes: tuple[str, ...]  # keys of SCENE_KINDS, in turns; every relief is among them


# One flat, two weak, five rich ones, three with twins; an odd number, so that what alternates with the pairs' numbers
# does so over every scene
LARGE_AND_SMALL = (
    "flatbed",
    "floodgate",
    "seabed",
    "ship",
    "bridge",
    "shallow",
    "manifold",
    "wreck",
    "harbor",
    "pool",
    "clutter",
)

# One flat, one weak, one rich one, two with twins
SMALL = ("pool", "rubble", "shallow", "manifold", "sandflat")

# For what looks down, or about from above the bed: the pool, not a ship's underside, and rubble in its place
FROM_ABOVE = tuple({"ship": "pool", "pool": "rubble"}.get(scene, scene) for scene in LARGE_AND_SMALL)

SCAN_KINDS: MappingProxyType[str, ScanKind] = MappingProxyType(
    {
        name: ScanKind(summary, f"{module}:{name}_pair", scenes)
        for name, module, scenes, summary in (
            ("patch", "patch", LARGE_AND_SMALL, "a patch merged from 4 to 10 views along a path, placed by odometry"),
            ("sonar3d15", "single_view", SMALL, "a view with the density and the dropouts of a real Sonar 3D-15"),
            ("sound_speed", "single_view", LARGE_AND_SMALL, "a view measured with a sound speed off by up to 2 %"),
            (
                "range_bias",
                "single_view",
                LARGE_AND_SMALL,
                "a view whose ranges are all off by up to 1 % of the greatest",
            ),
            ("moving", "single_view", LARGE_AND_SMALL, "a view measured row by row by a sensor that moves meanwhile"),
            ("swath", "swath", FROM_ABOVE, "a swath of a multibeam echo sounder on a moving vessel"),
            ("imaging", "imaging", FROM_ABOVE, "a stack of an imaging sonar's images, the elevation of echoes guessed"),
            ("profiler", "profiler", LARGE_AND_SMALL, "a sweep of a rotating profiler that is panned for minutes"),
        )
    }
)


def scan_kind(name: str) -> ScanKind:
    """The kind called `name`. Raises InputError: there is none."""
    if name not in SCAN_KINDS:
        raise InputError(f"no kind of scan is called {name!r}; there are {', '.join(SCAN_KINDS)}")
    return SCAN_KINDS[name]


def kind_pair(name: str, number: int, seed: int, overlaps: tuple[float, float] | None = None) -> "KindPair":
    """Pair `number`, 0, 1, 2, ..., of the set `seed` of one kind of SCAN_KINDS: scenes take turns, and so do OVERLAPS
    unless `overlaps` gives the least and greatest share of the points in common. The same numbers, the same pair, bit
    for bit. Raises InputError: no such kind, a number below 0, or a scene that has no such pair."""
    from sonarmap.tools.lab.simulate.kinds.kind import OVERLAPS, KindPair

    kind = scan_kind(name)
    if number < 0 or seed < 0:
        raise InputError(f"pair {number} of the set {seed}; wanted two numbers >= 0")
    scene = kind.scenes[number % len(kind.scenes)]
    wanted = OVERLAPS[number // len(kind.scenes) % len(OVERLAPS)] if overlaps is None else overlaps
    module, _, function = kind.builder.partition(":")
    build: Callable[[int, int, str, tuple[float, float]], KindPair] = getattr(
        import_module(f"sonarmap.tools.lab.simulate.kinds.{module}"), function
    )
    return build(number, seed, scene, wanted)
