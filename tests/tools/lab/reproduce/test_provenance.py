"""Rows of other code, settings, devices or versions are never used; the machine is told in words."""

from pathlib import Path

import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.tools.files.writers.json_text import to_json
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, Request, create
from sonarmap.tools.lab.reproduce.methods import EVALUATED
from sonarmap.tools.lab.reproduce.provenance import SHOWING, Provenance, provenance
from sonarmap.tools.methods.fingerprint import source_digest
from tests.samples.experiments.fake_experiment import Fake, origin
from tests.samples.experiments.real_folders import put


class TestKey:
    @pytest.mark.parametrize(
        "changes",
        [
            {"settings": {"seed": 2, "fast": False}},
            {"sources": "cd"},
            {"device": "another"},
            {"platform": "OpenCL 1.2"},
            {"versions": {"numpy": "3"}},
            {"name": "other"},
        ],
    )
    def test_all_that_decides_rows_counts(self, changes: dict[str, object]) -> None:
        assert origin(Fake()).key("a") != origin(Fake(), **changes).key("a")

    def test_the_host_decides_nothing(self) -> None:
        assert origin(Fake()).key("a") == origin(Fake(), processor="another", cores=64).key("a")

    def test_jobs_of_a_method_depend_on_its_fingerprint_alone(self) -> None:
        before = origin(Fake(), methods={"mine": "1", "yours": "1"})
        after = origin(Fake(), methods={"mine": "2", "yours": "1"}, device="another", settings={"seed": 2})
        assert before.key("a/mine") != after.key("a/mine")
        assert before.key("a/yours") == after.key("a/yours")
        assert before.key("a/yours") != before.key("b/yours")


def test_the_place_in_words() -> None:
    assert origin(Fake()).place == "a device (OpenCL 3.0 X; a processor, 2 cores)"


def test_it_survives_json() -> None:
    assert Provenance(**to_json(origin(Fake()))) == origin(Fake())


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_names_its_sources(name: str, device: Device, tmp_path: Path) -> None:
    folder = put(tmp_path) if EXPERIMENTS[name].on_folder else None
    experiment = create(name, Request(device=device, quick=True, folder=folder))
    origin = provenance(experiment, device)
    assert source_digest(experiment.sources)
    methods = [method for method in EVALUATED if method in origin.methods]
    assert bool(methods) is (name in ("steps", "pairs", "unrelated", "real", "kinds"))
    assert len(set(origin.methods.values())) == len(origin.methods)


def test_files_that_only_show_rows_do_not_count() -> None:
    folder = ("tools/lab/reproduce/gaussian",)
    shown = [f"{folder[0]}/{name}.py" for name in ("section", "figure", "summary")]
    decides = [f"{folder[0]}/{name}.py" for name in ("row", "run", "series", "__init__")]
    assert source_digest(folder, SHOWING) == source_digest(tuple(decides))
    assert source_digest(tuple(shown), SHOWING) == source_digest(())
