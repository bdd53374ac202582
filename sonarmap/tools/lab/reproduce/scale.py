"""Surveys of thousands of scans, each mapped in a process of its own: what it takes by stage, and what comes of it."""

import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sonarmap.slam.execute.processes import spawned
from sonarmap.slam.execute.runner import Execution, Timings
from sonarmap.slam.execute.worker import Worker
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.lab.evaluate.trajectory import evaluate, pair_error
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Settings, Value, all_seeds
from sonarmap.tools.lab.reproduce.experiments import Request, as_asked
from sonarmap.tools.lab.reproduce.made_up import MadeUpRegistrar, MadeUpSurvey, make_up

# Numbers of scans, ascending; points of each scan; surveys of each number; edge of the survey's voxels [m]
_USUAL = {"counts": (1000, 3000, 10_000), "points": 25_000, "seeds": 1, "first_seed": 7, "voxel": 0.5}
SOURCES = (
    *("slam", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("experiment", "scale", "made_up")),
)
WHOLE = "all"  # the stages
_PREPARED = 8  # scans that the worker keeps; of these there is nothing to prepare
_SAMPLED = 0.05  # how often memory is looked at [s]
_OFF_VOXELS = 3.0  # a kept pair that is farther off is wrong


def create(request: Request) -> Experiment:
    """A job is one survey in a new process, as in 7/1000; `quick` is 100 and 200 scans of fewer points."""
    settings = as_asked(request, _USUAL, {"counts": (100, 200), "points": 4000})

    def run(job: str) -> Outcome:
        seed, count = map(int, job.split("/"))
        with spawned(1) as pool:
            return pool.submit(_measure, count, seed, settings).result()

    jobs = [f"{seed}/{count}" for seed in all_seeds(settings) for count in settings.counts]
    return Experiment("scale", settings, jobs, run, SOURCES)


@dataclass(slots=True)
class _Stages(Timings):
    """Timings with the processor time of each stage, and the most memory that was taken meanwhile."""

    processor: dict[str, float] = field(default_factory=dict[str, float])  # by stage [s]
    memory: dict[str, int] = field(default_factory=dict[str, int])  # by stage [bytes]
    most: int = 0
    _begun: float = field(default_factory=time.process_time)

    def end_stage(self, name: str) -> None:
        """As `Timings` does it."""
        now = time.process_time()
        self.processor[name] = self.processor.get(name, 0.0) + now - self._begun
        self.memory[name] = max(self.memory.get(name, 0), self.most)
        self._begun, self.most = now, 0
        Timings.end_stage(self, name)


def _measure(count: int, seed: int, settings: Settings) -> Outcome:
    """What comes of one survey, the same on every run; and processor time and memory of every stage and of all."""
    with tempfile.TemporaryDirectory(prefix="sonarmap.") as folder:
        survey = make_up(Path(folder), count, settings.points, seed)
        registrar = MadeUpRegistrar(survey.T_world_sensor, seed)
        stages = _Stages()
        with _memory_watched(stages):
            execution = Execution(Worker(registrar, _PREPARED), timings=stages)
            result = Mapper(registrar, settings.voxel, execution=execution).run(survey.scans)
        begin = {"scans": count, "seed": seed}
        took = [(name, seconds, stages.memory[name]) for name, seconds in stages.processor.items()]
        took.append((WHOLE, sum(stages.processor.values()), max(stages.memory.values())))
        rows = [
            begin | {"stage": name, "processor_s": seconds, "memory_mib": memory / 2**20}
            for name, seconds, memory in took
        ]
        return Outcome((begin | _outcome(survey, result, settings.voxel),), tuple(rows))


@contextmanager
def _memory_watched(stages: _Stages) -> Iterator[None]:
    """Notes the most memory that is taken, beside what the system holds of files."""
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
    """What this process holds that is no part of a file [bytes]; where the system does not tell, the most so far."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    line = next((line for line in lines if line.startswith("RssAnon")), None)
    return peak_memory() if line is None else int(line.split()[1]) * 1024


def _outcome(survey: MadeUpSurvey, result: SurveyResult, voxel: float) -> dict[str, Value]:
    """How far off poses are, and what became of the pairs."""
    largest = max(result.components, key=len)
    truth = Trajectory(result.trajectory.stamps, survey.T_world_sensor)
    T, off = survey.T_world_sensor, _OFF_VOXELS * voxel
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
        "map_points": int(np.sum([len(each.points) for each in result.maps])),
    }
