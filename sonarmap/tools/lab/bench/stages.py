"""Where a pair's time goes: each stage's wall time, and what it asks of the device.

A stage is a function or method, named below where it stands. While a block runs it is called through a clock; the code
of the stages knows nothing of it.
"""

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import wraps
from threading import get_ident
from time import perf_counter
from typing import Any

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.trace import Counts, everywhere, tracing

# "module:name" or "module:Class.name" -> the stage's name, the same where work is queued first and read later.
PAIR_STAGES: Mapping[str, str] = {
    "sonarmap.spectral.registration:SpectralRegistrar.prepare": "prepare",
    "sonarmap.spectral.prepare.prepared:Preparer.prepare": "prepare: voxels, spectrum",
    "sonarmap.spectral.so3:So3.analyze": "prepare: sphere, harmonics",
    "sonarmap.spectral.so3:So3._equalize": "prepare: sphere, harmonics",
    "sonarmap.spectral.prepare.range_image:scan_view": "prepare: range image",
    "sonarmap.spectral.prepare.surface:smooth_surface": "prepare: surface",
    "sonarmap.spectral.prepare.surface:_surface": "prepare: surface",
    "sonarmap.spectral.registration:SpectralRegistrar._coarsen": "prepare: coarse grid",
    "sonarmap.spectral.registration:SpectralRegistrar._register": "register",
    "sonarmap.spectral.so3:So3.candidates": "rotations",
    "sonarmap.spectral.verify.hypothesis_testing:HypothesisTest.find_candidates": "candidates: coarse correlations",
    "sonarmap.spectral.verify.hypothesis_testing:HypothesisTest.refine_candidates": "candidates: best refined",
    "sonarmap.spectral.verify.hypothesis_testing:HypothesisTest.find_missed": "candidates: whole grid",
    "sonarmap.spectral.verify.hypothesis_testing:HypothesisTest.conclude": "compare",
    "sonarmap.spectral.verify.hypothesis_testing:HypothesisTest.finish": "finish",
    "sonarmap.spectral.prepare.range_image:visibility": "views",
    "sonarmap.spectral.verify.verifier:shared_surfaces": "shared surfaces",
    "sonarmap.spectral.verify.icp:refine": "refinement",
    "sonarmap.spectral.verify.verifier:_observation": "refinement, views, shared surfaces: waiting",
    "sonarmap.spectral.verify.verifier:_measured": "measured: waiting",
    "sonarmap.spectral.registration:SpectralRegistrar._conclude": "covariance, probability",
}

# Drivers compile when a program is built, and some when it is first launched.
BUILDS: Mapping[str, str] = {"sonarmap.kernels.device.device:Device.build": "build"}

SURVEY_STAGES: Mapping[str, str] = {
    "sonarmap.tools.files.readers.scans:read_survey": "reading",
    "sonarmap.spectral.registration:SpectralRegistrar.prepare": "preparing scans",
    "sonarmap.spectral.registration:SpectralRegistrar._register": "registering pairs",
    "sonarmap.slam.execute.journal:Journal.add": "keeping the journal",
    "sonarmap.slam.pair_search:PairSearch.loops": "choosing loops",
    "sonarmap.slam.decide.decision:decide": "deciding, optimizing",
    "sonarmap.slam.map.component_maps:component_maps": "fusing maps",
    "sonarmap.slam.graph.pose_covariance:pose_covariances": "covariances",
    "sonarmap.tools.products.report.pictures:draw_map": "picture",
    "sonarmap.tools.products.output.folder:write_survey": "writing files",
}


@dataclass(slots=True)
class Stage:
    """One stage, summed over its calls."""

    name: str  # what it is called
    calls: int = 0  # how often it ran
    seconds: float = 0.0  # wall time with the stages within it [s]
    own_seconds: float = 0.0  # wall time without these [s]
    counts: Counts = field(default_factory=Counts)  # what it asked of the device itself, without these


class StageClock:
    """Times the stages, each called within the one before it on its thread."""

    def __init__(self) -> None:
        self.stages: dict[str, Stage] = {}  # by name, in the order in which they began first; "" is what ran in none
        self._open: dict[int, list[tuple[Stage, float, list[float]]]] = {}

    def counts(self) -> Counts:
        """Of the stage that runs on this thread."""
        stack = self._open.get(get_ident())
        return (stack[-1][0] if stack else self._stage("")).counts

    def timed(self, name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its calls timed."""

        @wraps(original)
        def call(*given: Any, **options: Any) -> Any:
            stack = self._open.setdefault(get_ident(), [])
            stage, inner = self._stage(name), [0.0]
            stack.append((stage, perf_counter(), inner))
            try:
                return original(*given, **options)
            finally:
                _, start, _ = stack.pop()
                took = perf_counter() - start
                stage.calls += 1
                stage.seconds += took
                stage.own_seconds += took - inner[0]
                if stack:
                    stack[-1][2][0] += took

        return call

    def _stage(self, name: str) -> Stage:
        return self.stages.setdefault(name, Stage(name))


@contextmanager
def clocked(stages: Mapping[str, str], device: Device | None = None) -> Iterator[StageClock]:
    """Time stages, as of PAIR_STAGES, while the block runs, and count what they ask of a device, if one is given."""
    clock = StageClock()
    with ExitStack() as stack:
        for place, name in stages.items():
            for owner, attribute, original in places(place):
                setattr(owner, attribute, clock.timed(name, original))
                stack.callback(setattr, owner, attribute, original)
        stack.enter_context(tracing(device, clock.counts) if device else nullcontext())
        yield clock


def build_seconds(clock: StageClock) -> float:
    """What building programs took, of BUILDS [s]."""
    return clock.stages["build"].seconds if "build" in clock.stages else 0.0


def places(place: str) -> list[tuple[Any, str, Callable[..., Any]]]:
    """Where a function of "module:name" or "module:Class.name" stands: owner, attribute, function.

    A function stands in its module and in every module that has imported it. Raises AttributeError: there is none.
    """
    module, _, path = place.partition(":")
    owner: Any = importlib.import_module(module)
    *classes, name = path.split(".")
    for each in classes:
        owner = getattr(owner, each)
    function = getattr(owner, name)
    return [(owner, name, function)] if classes else [(*known, function) for known in everywhere(function)]
