"""Mistakes of instruments are found in the first minute of a dive, and none is claimed in a clean one."""

import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import cache
from multiprocessing import Pipe
from pathlib import Path
from signal import SIGINT, getsignal, signal
from threading import Thread
from typing import Any, ClassVar

import pytest

from sonarmap.slam.execute.job import Job, job_key
from sonarmap.slam.execute.worker import TimedText, Worker
from sonarmap.slam.live.growing import GrowingMap
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.tools.command.live import mapping as module
from sonarmap.tools.command.live.chosen import Reading
from sonarmap.tools.command.live.mapping import MappingSettings, run_mapping
from sonarmap.tools.command.live.navigation import Navigation
from sonarmap.tools.command.method import MethodOptions
from sonarmap.tools.command.navigation import NavigationReading, OdometryFile, PriorsFile
from sonarmap.tools.command.survey import PointReading
from sonarmap.tools.files.finding import Remedy
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.incoming import Incoming, Mark
from sonarmap.tools.products.live.messages import State
from tests.samples.mistakes import MISTAKES, SimulatedDive, simulated_dive

# A survey boat with an eclipse, an inspection at a close range, a vehicle in a tank: fixes [m], lever arm [m]
SCENES = {"harbor": (0.5, 5.0), "manifold": (0.5, 1.5), "pool": (0.1, 1.0)}
# on a circle, looking inward, ranges that are too long are like a lever arm
UNSEEN = {("manifold", "speed of sound")}
CLEAN = [
    ("harbor", 11, 0.5), ("manifold", 12, 0.5), ("pool", 13, 0.1), ("ship", 14, 3.0), ("rubble", 15, 0.5),
    ("bridge", 16, 3.0), ("floodgate", 17, None), ("wreck", 18, None), ("shallow", 19, None), ("seabed", 20, None),
]  # fmt: skip


class Remembering(Worker):
    """Registers equal pairs of all replays once."""

    known: ClassVar[dict[str, TimedText]] = {}

    def __init__(self, registrar: Any, prepared: int) -> None:
        super().__init__(registrar, prepared)
        self._voxel = str(registrar.grid.voxel)

    def run(self, jobs: Sequence[Job]) -> list[TimedText]:
        keys = [job_key(job, self._voxel) for job in jobs]
        new = [k for k, key in enumerate(keys) if key not in self.known]
        self.known.update(zip([keys[k] for k in new], super().run([jobs[k] for k in new]), strict=True))
        return [self.known[key] for key in keys]


class AtOnce:
    """Decides at once, as in a dive, in which decisions take less time than the scans between them; `ended` says when
    no more decisions are wanted."""

    def __init__(self, ended: Callable[[], bool]) -> None:
        self._ended = ended

    def submit(self, decide: Callable[[GrowingMap], None], growing: GrowingMap) -> Future[None]:
        growing.idle.set()
        done = Future[None]()
        try:
            done.set_result(None if self._ended() else decide(growing))
        except Exception as error:  # noqa: BLE001 - for who waits for the result
            done.set_exception(error)
        growing.seconds = 0.0  # the next one need not wait
        return done


def alerts(
    dive: SimulatedDive,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    until: str = "$^",
    with_log: bool = True,
    chosen: Sequence[Remedy] = (),
) -> tuple[dict[str, int], tuple[Remedy, ...]]:
    """The alerts of a replay with chosen remedies, with the number of scans placed by then, one a second; and the
    remedies that the page offers. The replay ends early when an alert matches `until`."""
    folder.mkdir(exist_ok=True)
    log = dive.write_log(folder / "log.csv") if with_log else None
    use = Reading(PriorsFile([log] if log else []), NavigationReading(), PointReading()).corrected(chosen)
    corrections = use.points.corrections()
    said, remedies = dict[str, int](), set[Remedy]()

    def ended() -> bool:
        return any(re.search(until, words) for words in said)

    def incoming(*_: object) -> Iterator[Incoming]:
        for number, scan in enumerate(dive.scans, 1):
            if not ended():
                read = corrections.scan(Cloud(scan.points), scan.name)[0] if chosen else scan
                yield Incoming(replace(read, stamp=scan.stamp), Mark("", number))

    monkeypatch.setattr(module, "replayed", incoming)
    monkeypatch.setattr(module, "_MOST", 10)  # scans read ahead
    monkeypatch.setattr(module, "ThreadPoolExecutor", lambda *_: AtOnce(ended))
    monkeypatch.setattr(module, "Worker", Remembering)
    navigation = Navigation(use.priors, OdometryFile(), use.log)
    out = folder / f"out_{len(chosen)}"
    (out / "live").mkdir(parents=True)
    settings = MappingSettings(out, ("dive",), 0.0, corrections, MethodOptions(grid=64), MapperSettings(), navigation)
    pipe, other = Pipe()

    def receive() -> None:
        message: Any = None
        while (message := pipe.recv()) is not None:
            assert not isinstance(message, Exception), message
            for words in message.alerts if isinstance(message, State) else ():
                said.setdefault(words, message.scans)
                remedies.update(message.remedies)

    reader, before = Thread(target=receive), getsignal(SIGINT)
    reader.start()
    try:
        run_mapping(settings, other)
    finally:
        signal(SIGINT, before)
    reader.join()
    return said, tuple(sorted(remedies))


@cache
def clean_dive(scene: str) -> SimulatedDive:
    return simulated_dive(scene, 5, *SCENES[scene])


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("scene", SCENES)
def test_a_mistake_is_found_in_the_first_minute(
    scene: str, mistake: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change, words = MISTAKES[mistake]
    said, _ = alerts(change(clean_dive(scene)), tmp_path, monkeypatch, words)
    found = {each: when for each, when in said.items() if re.search(words, each)}
    for each, when in said.items():
        print(f"{scene} | {mistake} | {'found' if each in found else 'also'} | {when} s | {each[:400]}")
    if not said:
        print(f"{scene} | {mistake} | nothing")
    assert found or (scene, mistake) in UNSEEN


# What the page corrects by a click. Shared errors of clocks and lever arms are estimated and corrected anyway.
CORRECTED = (
    "z down",
    "y right",
    "heading's sign",
    "heading 25 deg off",
    "depth's sign",
    "own structure",
    "speed of sound",
)


@pytest.mark.slow
@pytest.mark.parametrize("mistake", CORRECTED)
@pytest.mark.parametrize("scene", ["harbor", "pool"])
def test_a_remedy_of_the_page_corrects_the_mistake(
    scene: str, mistake: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change, words = MISTAKES[mistake]
    wrong = change(clean_dive(scene))
    _, remedies = alerts(wrong, tmp_path, monkeypatch, words)
    assert remedies
    left = [alerts(wrong, tmp_path / str(k), monkeypatch, chosen=[each])[0] for k, each in enumerate(remedies)]
    for remedy, said in zip(remedies, left, strict=True):
        print(f"{scene} | {mistake} | {remedy} | {len(said)} alerts left | {[*said][:2]}")
    assert any(all("were corrected so" in words for words in said) for said in left)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "seed", "fix_sigma"), CLEAN)
def test_nothing_is_claimed_of_a_clean_dive(
    scene: str, seed: int, fix_sigma: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dive = simulated_dive(scene, seed, fix_sigma or 1.0)
    said, _ = alerts(dive, tmp_path, monkeypatch, with_log=fix_sigma is not None)
    print(f"{scene} | clean | {'with' if fix_sigma else 'without'} a log | {len(said)} alerts | {list(said)}")
    assert not said
