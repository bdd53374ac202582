"""The wall time of each stage of a computation, and its calls of the device.

A stage is a function or method, listed below by its module. `clocked` replaces it by a timed wrapper while a block
runs; the code of the stages does not change.
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

# "module:name" or "module:Class.name" -> name of the stage; several functions may belong to one stage
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

# Drivers compile when a program is built; some compile at its first launch.
BUILDS: Mapping[str, str] = {"sonarmap.kernels.device.device:Device.build": "build"}

SURVEY_STAGES: Mapping[str, str] = {
    "sonarmap.tools.files.readers.scans:read_survey": "reading",
    "sonarmap.spectral.registration:SpectralRegistrar.prepare": "preparing scans",
    "sonarmap.spectral.registration:SpectralRegistrar._register": "registering pairs",
    "sonarmap.slam.execute.journal:Journal.add": "keeping the journal",
    "sonarmap.slam.pair_search:PairSearch.loops": "choosing loops",
    "sonarmap.slam.decide.decision:decide": "deciding, optimizing",
    "sonarmap.slam.map.doubtful_points:component_maps": "fusing maps",
    "sonarmap.slam.graph.pose_covariance:pose_covariances": "covariances",
    "sonarmap.tools.products.report.pictures:draw_map": "picture",
    "sonarmap.tools.products.output.folder:write_survey": "writing files",
}


@dataclass(slots=True)
class Stage:
    """A stage, summed over its calls."""

    name: str
    calls: int = 0
    seconds: float = 0.0  # wall time, including nested stages [s]
    own_seconds: float = 0.0  # wall time without nested stages [s]
    counts: Counts = field(default_factory=Counts)  # calls of the device, without nested stages


class StageClock:
    """Times stages, which may be nested and run on several threads."""

    def __init__(self) -> None:
        self.stages: dict[str, Stage] = {}  # by name, in order of their first call; "" is what ran outside of all
        self._open: dict[int, list[tuple[Stage, float, list[float]]]] = {}

    def counts(self) -> Counts:
        """The counts of the stage that runs on this thread."""
        stack = self._open.get(get_ident())
        return (stack[-1][0] if stack else self._stage("")).counts

    def timed(self, name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        """A wrapper of `original` that times its calls as part of a stage."""

        @wraps(original)
        def call(*arguments: Any, **options: Any) -> Any:
            stack = self._open.setdefault(get_ident(), [])
            stage, inner = self._stage(name), [0.0]
            stack.append((stage, perf_counter(), inner))
            try:
                return original(*arguments, **options)
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
    """Time stages (a mapping such as PAIR_STAGES) while the block runs, and count their calls of a device, if given."""
    clock = StageClock()
    with ExitStack() as stack:
        for place, name in stages.items():
            for owner, attribute, original in places(place):
                setattr(owner, attribute, clock.timed(name, original))
                stack.callback(setattr, owner, attribute, original)
        stack.enter_context(tracing(device, clock.counts) if device else nullcontext())
        yield clock


def build_seconds(clock: StageClock) -> float:
    """The time of building programs, from a clock of BUILDS [s]."""
    return clock.stages["build"].seconds if "build" in clock.stages else 0.0


def places(place: str) -> list[tuple[Any, str, Callable[..., Any]]]:
    """All places of the function "module:name" or "module:Class.name", each as owner, attribute and function.

    The owners of a function are its module and every module that imported it. Raises AttributeError: it does not exist.
    """
    module, _, path = place.partition(":")
    owner: Any = importlib.import_module(module)
    *classes, name = path.split(".")
    for class_name in classes:
        owner = getattr(owner, class_name)
    function = getattr(owner, name)
    return [(owner, name, function)] if classes else [(*reference, function) for reference in everywhere(function)]
