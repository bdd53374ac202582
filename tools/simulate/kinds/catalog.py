"""The kinds of scans that can be simulated in pairs; a new kind is a file beside this one and a row here.

Nothing heavy is imported here: the command line's help reads the table.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from kernels.errors import InputError

if TYPE_CHECKING:
    from tools.simulate.kinds.kind import KindPair


@dataclass(frozen=True, slots=True)
class ScanKind:
    """A kind of scan.

    Attributes:
        summary: in a few words.
        builder: the function that makes pair `number` of the set `seed`, as "module:function"; it takes
            (number, seed, scene, overlaps) and returns a KindPair.
        scenes: keys of SCENE_KINDS, in turns; every relief is among them.
    """

    summary: str
    builder: str
    scenes: tuple[str, ...]


SCAN_KINDS: MappingProxyType[str, ScanKind] = MappingProxyType({})


def scan_kind(name: str) -> ScanKind:
    """The kind called `name`.

    Raises:
        InputError: there is none.
    """
    if name not in SCAN_KINDS:
        raise InputError(f"no kind of scan is called {name!r}; there are {', '.join(SCAN_KINDS)}")
    return SCAN_KINDS[name]


def kind_pair(name: str, number: int, seed: int, overlaps: tuple[float, float] | None = None) -> "KindPair":
    """Pair `number`, 0, 1, 2, ..., of the set `seed` of one kind: scenes and overlaps take turns.

    Args:
        name: a key of SCAN_KINDS.
        number, seed: >= 0; the same numbers, the same pair, bit for bit.
        overlaps: least and greatest share of the points in common; in turns those of OVERLAPS if left out.

    Raises:
        InputError: there is no such kind, or its scene has no such pair.
    """
    from tools.simulate.kinds.kind import OVERLAPS, KindPair

    kind = scan_kind(name)
    if number < 0 or seed < 0:
        raise InputError(f"pair {number} of the set {seed}; wanted two numbers >= 0")
    scene = kind.scenes[number % len(kind.scenes)]
    wanted = OVERLAPS[number // len(kind.scenes) % len(OVERLAPS)] if overlaps is None else overlaps
    module, _, function = kind.builder.partition(":")
    build: Callable[[int, int, str, tuple[float, float]], KindPair] = getattr(import_module(module), function)
    return build(number, seed, scene, wanted)
