"""The kinds of scans that can be simulated in pairs; a new kind is a file beside this one and a row here."""

from collections.abc import Mapping

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.kinds.imaging import IMAGING
from sonarmap.tools.lab.simulate.kinds.kind import OVERLAPS, KindPair, ViewKind
from sonarmap.tools.lab.simulate.kinds.partners import SweepKind
from sonarmap.tools.lab.simulate.kinds.patch import PATCH
from sonarmap.tools.lab.simulate.kinds.profiler import PROFILER
from sonarmap.tools.lab.simulate.kinds.single_view import MOVING, RANGE_BIAS, SONAR3D15, SOUND_SPEED
from sonarmap.tools.lab.simulate.kinds.swath import SWATH

_KINDS = (PATCH, SONAR3D15, SOUND_SPEED, RANGE_BIAS, MOVING, SWATH, IMAGING, PROFILER)
SCAN_KINDS: Mapping[str, ViewKind | SweepKind] = {kind.name: kind for kind in _KINDS}


def kind_pair(name: str, number: int, seed: int, overlaps: tuple[float, float] | None = None) -> KindPair:
    """Simulate pair `number`, 0, 1, 2, ..., of the set `seed` of a kind of SCAN_KINDS, the same for the same arguments.

    Scenes take turns, and so do OVERLAPS unless `overlaps` gives the least and greatest overlap.
    Raises InputError: no such kind, a number below 0, or a scene that has no such pair.
    """
    if name not in SCAN_KINDS:
        raise InputError(f"no kind of scan is called {name!r}; there are {', '.join(SCAN_KINDS)}")
    if number < 0 or seed < 0:
        raise InputError(f"pair {number} of the set {seed}; wanted two numbers >= 0")
    kind = SCAN_KINDS[name]
    scene = kind.scenes[number % len(kind.scenes)]
    wanted = OVERLAPS[number // len(kind.scenes) % len(OVERLAPS)] if overlaps is None else overlaps
    return kind.pair(number, seed, scene, wanted)
