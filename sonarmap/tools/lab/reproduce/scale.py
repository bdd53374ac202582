"""Surveys of thousands of scans with made-up registrations: time and memory of the mapper by stage, and its errors."""

import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.execute.processes import spawned
from sonarmap.slam.execute.runner import Execution, Timings
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.lab.evaluate.trajectory import evaluate, pair_error
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Settings, Value, all_seeds, as_asked

_STEP = 4.0  # distance between scans [m]
_LANE = 15.0  # distance between lanes [m]
_HEIGHT = 12.0  # above a rough bed [m]
_LONG = 16.0  # length of a scan's footprint on the bed, along the track [m]
_WIDE = 40.0  # width of the footprint, across the track [m]
_TURN = float(np.radians(0.1))  # standard deviation of a rotation's error at full overlap [rad]
_SHIFT = 0.05  # standard deviation of a translation's error at full overlap [m]
_STATED = 7.0  # reported variance over the true one, as of spectral registrations
_LEAST_OVERLAP = 0.25  # smallest overlap of an accepted registration
_REFUSED = 0.02  # share of the pairs with enough overlap that are refused
_WRONG = 0.002  # share of the accepted loops that are wrong


def make_up(folder: Path, count: int, points: int, seed: int) -> tuple[RigidTransform, list[Scan]]:
    """True poses along a lawnmower path, and scans of `points` points each, memory-mapped from a file in `folder`."""
    rng = np.random.default_rng(seed)
    truth = _path(count, rng)
    spooled = np.lib.format.open_memmap(folder / "points.npy", "w+", np.float32, (count, points, 3))
    for k in range(count):
        spooled[k] = _seen(truth[k], points, rng)
    spooled.flush()
    del spooled
    on_disk = np.load(folder / "points.npy", mmap_mode="r")
    return truth, [Scan(on_disk[k], stamp=float(k), name=f"scan{k}") for k in range(count)]


def _path(count: int, rng: np.random.Generator) -> RigidTransform:
    """Poses along the lanes of an about square area; the first is the identity."""
    per_lane = max(2, round(np.sqrt(count * _LANE / _STEP)))
    lane, along = np.divmod(np.arange(count), per_lane)
    back = lane % 2 == 1
    x = np.where(back, per_lane - 1 - along, along) * _STEP
    t = np.column_stack([x, lane * _LANE, np.zeros(count)]) + 0.2 * rng.normal(size=(count, 3))
    angles = np.radians([2.0, 2.0, 2.0]) * rng.normal(size=(count, 3))
    angles[:, 0] += np.where(back, np.pi, 0.0)
    T = RigidTransform.from_components(t, Rotation.from_euler("ZYX", angles))
    return T[0].inv() * T


def _seen(T: RigidTransform, points: int, rng: np.random.Generator) -> np.ndarray:
    """(points, 3) float32: random points of the bed below a pose [m, sensor frame]."""
    around = rng.uniform(-0.5, 0.5, (points, 2)) * [_LONG, _WIDE]
    R = Rotation.from_euler("Z", T.rotation.as_euler("ZYX")[0])
    xy = (R.apply(np.column_stack([around, np.zeros(points)])) + T.translation)[:, :2]
    z = _bed(*xy.T) + 0.05 * rng.normal(size=points)
    return T.inv().apply(np.column_stack([xy, z])).astype(np.float32)


def _bed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Heights of a bed that does not repeat itself within a survey [m]."""
    waves = ((0.9, 0.11, 0.05), (0.5, -0.31, 0.23), (0.25, 0.71, 0.97), (0.12, -1.9, 1.3))
    return np.sum([size * np.sin(a * x + b * y) for size, a, b in waves], axis=0) - _HEIGHT


class MadeUpRegistrar:
    """A registrar that returns the true transform with random errors, determined by seed and pair.

    It is rarely wrong, and refuses pairs with little overlap.
    """

    def __init__(self, T_world_sensor: RigidTransform, seed: int) -> None:
        self._truth, self._seed = T_world_sensor, seed

    def prepare(self, scan: Scan) -> int:
        """The number of the scan, from its name "scan0", "scan1", ..."""
        return int(scan.name.removeprefix("scan"))

    def register(self, target: int, source: int) -> Registration:
        """The made-up registration of a pair."""
        rng = np.random.default_rng([self._seed, target, source])
        T = self._truth[target].inv() * self._truth[source]
        shared = _shared(T)
        accepted = shared >= _LEAST_OVERLAP and rng.random() >= _REFUSED
        wrong = not accepted or (abs(source - target) > 1 and rng.random() < _WRONG)
        sigmas = np.repeat([_TURN, _SHIFT], 3) / max(shared, _LEAST_OVERLAP)
        error = rng.normal(size=6) * (np.repeat([0.2, 5.0], 3) if wrong else sigmas)
        return Registration(
            T_target_source=T * RigidTransform.from_exp_coords(error),
            covariance=np.diag(_STATED * sigmas**2),
            psr=float("nan"),
            overlap=shared,
            accepted=accepted,
            seconds=0.0,
            reason="made up",
            probability=0.97 if accepted else 0.02,
        )


def _shared(T_target_source: RigidTransform) -> float:
    """The overlap of the footprints of two scans, 0..1."""
    x, y, _ = np.abs(T_target_source.translation)
    return float(max(0.0, 1 - x / _LONG) * max(0.0, 1 - y / _WIDE))


# counts: numbers of scans, ascending; points: of each scan; voxel: edge [m]
_USUAL = {"counts": (1000, 3000, 10_000), "points": 25_000, "seeds": 1, "first_seed": 7, "voxel": 0.5}
SOURCES = ("slam", "tools/lab/evaluate", "tools/lab/reproduce/scale.py")
WHOLE = "all"  # name of the row for all stages
_PREPARED = 8  # number of prepared scans that the worker keeps
_SAMPLED = 0.05  # interval at which memory is measured [s]
_OFF_VOXELS = 3.0  # largest translation error of a right pair [voxels]


def create(request: Request) -> Experiment:
    """A job is one survey in a new process, as 7/1000; `quick` maps 100 and 200 scans of fewer points."""
    settings = as_asked(request, _USUAL, {"counts": (100, 200), "points": 4000})

    def run(job: str) -> Outcome:
        seed, count = map(int, job.split("/"))
        with spawned(1) as pool:
            return pool.submit(_measure, count, seed, settings).result()

    jobs = [f"{seed}/{count}" for seed in all_seeds(settings) for count in settings.counts]
    return Experiment("scale", settings, jobs, run, SOURCES)


@dataclass(slots=True)
class _Stages(Timings):
    """Timings with the processor time and the peak memory of each stage."""

    processor: dict[str, float] = field(default_factory=dict[str, float])  # by stage [s]
    memory: dict[str, int] = field(default_factory=dict[str, int])  # by stage [bytes]
    most: int = 0  # peak memory of the current stage [bytes]
    _begun: float = field(default_factory=time.process_time)

    def end_stage(self, name: str) -> None:
        """Record the end of a stage."""
        now = time.process_time()
        self.processor[name] = self.processor.get(name, 0.0) + now - self._begun
        self.memory[name] = max(self.memory.get(name, 0), self.most)
        self._begun, self.most = now, 0
        Timings.end_stage(self, name)


def _measure(count: int, seed: int, settings: Settings) -> Outcome:
    """Map one survey: a row of its errors, the same on every run, and rows of time and memory by stage and in total."""
    with tempfile.TemporaryDirectory(prefix="sonarmap.") as folder:
        truth, scans = make_up(Path(folder), count, settings.points, seed)
        registrar = MadeUpRegistrar(truth, seed)
        stages = _Stages()
        with _memory_watched(stages):
            execution = Execution(Worker(registrar, _PREPARED), timings=stages)
            result = Mapper(registrar, settings.voxel, execution=execution).run(scans)
        labels = {"scans": count, "seed": seed}
        usage = [(name, seconds, stages.memory[name]) for name, seconds in stages.processor.items()]
        usage.append((WHOLE, sum(stages.processor.values()), max(stages.memory.values())))
        rows = [
            labels | {"stage": name, "processor_s": seconds, "memory_mib": memory / 2**20}
            for name, seconds, memory in usage
        ]
        return Outcome((labels | _outcome(truth, result, settings.voxel),), tuple(rows))


@contextmanager
def _memory_watched(stages: _Stages) -> Iterator[None]:
    """Record the peak of this process's memory, without files, while the block runs."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(_SAMPLED):
            stages.most = max(stages.most, _memory())

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()


def _memory() -> int:
    """Anonymous resident memory of this process [bytes], or the peak memory if the system does not report it."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    line = next((line for line in lines if line.startswith("RssAnon")), None)
    return peak_memory() if line is None else int(line.split()[1]) * 1024


def _outcome(T: RigidTransform, result: SurveyResult, voxel: float) -> dict[str, Value]:
    """Cells of the errors of poses against the true ones, and of the kept and wrong pairs."""
    largest = max(result.components, key=len)
    truth, off = Trajectory(result.trajectory.stamps, T), _OFF_VOXELS * voxel
    loops = [pair for pair in result.pairs if pair.role == "loop"]
    wrong = sum(
        pair_error(pair.edge.registration.T_target_source, T[pair.i].inv() * T[pair.j]).translation_m > off
        for pair in result.pairs
        if pair.edge is not None
    )
    return {
        "placed": len(largest),
        "ate_m": evaluate(result.trajectory.take(largest), truth).ate_m,
        "tried_loops": len(loops),
        "kept_loops": sum(pair.kept for pair in loops),
        "wrong_kept": wrong,
        "map_points": int(np.sum([len(component_map.points) for component_map in result.maps])),
    }
