"""What the command line asks of experiments: which of them, with which settings, and so which jobs; and refusals."""

import math
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce import experiments, methods
from sonarmap.tools.lab.reproduce.evaluation.pair_set import Pairs
from sonarmap.tools.lab.reproduce.evaluation.settings import PairsSettings, StepsSettings
from sonarmap.tools.lab.reproduce.evaluation.steps import Steps
from sonarmap.tools.lab.reproduce.experiment import Experiment
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, OPTIONS, Request, chosen, create
from sonarmap.tools.lab.reproduce.floodgate import run as floodgate
from sonarmap.tools.lab.reproduce.floodgate.chain import runs
from sonarmap.tools.lab.reproduce.floodgate.run import OTHER_METHODS, PAPER_METHODS, Floodgate, FloodgateSettings
from sonarmap.tools.lab.reproduce.gaussian.run import GaussianSettings
from sonarmap.tools.lab.reproduce.kinds.run import Kinds
from sonarmap.tools.lab.reproduce.kinds.settings import LEVELED, NAVIGATION, KindsSettings
from sonarmap.tools.lab.reproduce.methods import EVALUATED, ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.real.settings import real_settings
from sonarmap.tools.lab.reproduce.settings import paper_grid
from sonarmap.tools.lab.reproduce.structures.settings import LimitsSettings, TranslationSettings
from sonarmap.tools.lab.reproduce.survey import run as survey
from sonarmap.tools.lab.reproduce.survey.run import SurveyExperiment
from sonarmap.tools.lab.reproduce.survey.simulated import SurveySettings
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_COUNT
from tests.samples.refusals import refuses

EVALUATION = ("steps", "pairs", "unrelated")
TWO = ComparedMethods(("spectral", "kiss"))


class TestChosen:
    @pytest.mark.parametrize(
        ("name", "options", "names"),
        [
            ("all", {}, ("translation", "rotation", "limits", "gaussian", "floodgate")),
            ("evaluation", {"method": ("kiss",), "grid": 64}, EVALUATION),
            ("kinds", {"pairs": 5, "seed": 1, "grid": 64, "method": ("planes",)}, ("kinds",)),
            ("slam", {}, ("survey",)),
            ("scale", {"seeds": 2}, ("scale",)),
            ("real", {"folder": "DIR", "known": "depth"}, ("real",)),
        ],
    )
    def test_by_name_and_group(self, name: str, options: dict, names: tuple[str, ...]) -> None:
        assert chosen(name, Request(**options)) == names
        assert [each for each in EXPERIMENTS if EXPERIMENTS[each].timed] == ["survey", "scale"]

    @pytest.mark.parametrize(
        ("name", "options", "words"),
        [
            ("evaluation", {"scene": "harbor"}, "--scene has no effect"),
            ("gaussian", {"method": ("kiss",)}, "--method has no effect"),
            ("kinds", {"scene": "harbor"}, "--scene has no effect on reproduce kinds"),
            ("real", {}, "reproduce real needs a folder"),
            ("judge", {}, "DIR holds what sonarmap reproduce evidence -o DIR wrote"),
            ("pairs", {"folder": "DIR"}, "reproduce pairs simulates its scans, so the folder DIR"),
            ("all", {"folder": "DIR"}, "reproduce all simulates its scans"),
            ("real", {"folder": "DIR", "pairs": 3}, "--pairs has no effect on reproduce real"),
        ],
    )
    def test_what_has_no_effect_is_refused(self, name: str, options: dict, words: str) -> None:
        refuses(words, chosen, name, Request(**options))

    def test_options_that_not_all_of_a_group_take(self, monkeypatch: pytest.MonkeyPatch) -> None:
        options = {"none": (), "some": ("grid", "seed"), "every": OPTIONS}
        table = {name: experiments.ExperimentEntry("", "m", taken) for name, taken in options.items()}
        monkeypatch.setattr(experiments, "EXPERIMENTS", table)
        assert chosen("some", Request(grid=64, seed=0)) == ("some",)
        assert chosen("every", Request(sigma2=(1.0,), scene="x")) == ("every",)
        assert chosen("all", Request(quick=True)) == ("none", "some", "every")
        refuses(r"--sigma2 has no .* some.* takes --grid, --seed", chosen, "some", Request(grid=64, sigma2=(1.0,)))
        refuses("--seed has no effect on reproduce none; leave it out", chosen, "none", Request(seed=0))
        del table["none"]
        assert chosen("all", Request(seed=0)) == ("some", "every")
        both = Request(scene="x", sigma2=(2.0,))
        refuses("--scene and --sigma2 have no effect on reproduce all", chosen, "all", both)

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            (
                {"quick": True, "seeds": 2, "seed": 0, "grid": 64, "sigma2": (1.0, 2.5)},
                "x --quick --grid 64 --sigma2 1 --sigma2 2.5 --seeds 2 --seed 0",
            ),
            ({"method": ("kiss", "icp"), "pairs": 7}, "x --pairs 7 --method kiss --method icp"),
            (
                {
                    "folder": "/where/it/lies",
                    "voxel": 0.25,
                    "max_tilt": 20.0,
                    "known": "depth",
                    "known_sigmas": "1,2,3,4",
                },
                "x DIR --voxel 0.25 --max-tilt 20.0 --known depth --known-sigmas 1,2,3,4",
            ),
        ],
    )
    def test_the_command_that_asks_for_the_same(self, options: dict, words: str) -> None:
        assert Request(**options).command("x") == f"sonarmap reproduce {words}"


@pytest.mark.parametrize(
    ("settings", "refused"),
    [
        (
            FloodgateSettings,
            {
                "no method is called alchemy": {"methods": ("alchemy",)},
                "no method": {"methods": ()},
                "at least one": {"seeds": 0},
                "none below 0": {"first_seed": -1},
                "2 to 18": {"scans": 1},
                "`edge=103`": {"edges": (103,)},
            },
        ),
        (
            GaussianSettings,
            {
                "no scene is called 'moon'": {"scene": "moon"},
                "--sigma2: -1": {"sigma2": (-1.0,)},
                "--sigma2: nan": {"sigma2": (math.nan,)},
                "--sigma2: no value": {"sigma2": ()},
                "at least one": {"seeds": 0},
                "`edge=103`": {"edges": (128, 103)},
            },
        ),
        (
            TranslationSettings,
            {
                "there must be at least one": {"steps": ()},
                "farther than the one before": {"steps": (4, 2)},
                "no scene": {"scenes": ("moon",)},
                "D7: choose from": {"noises": ("D7",)},
                "0 seeds": {"seeds": 0},
                "none below 0": {"first_seed": -1},
            },
        ),
        (LimitsSettings, {"yaws_deg": {"yaws_deg": (90,)}, "tilts_deg": {"tilts_deg": (0, 5)}, "''": {"scenes": ()}}),
        (SurveySettings, {"moon": {"scene": "moon"}, "2 scans": {"counts": (1,)}, "103": {"edge": 103}}),
        (
            lambda **changes: KindsSettings(**changes),
            {"0 pairs": {"pairs": 0}, "-1": {"seed": -1}, "33": {"edge": 33}, "sonogram": {"kinds": ("sonogram",)}},
        ),
        (
            lambda **options: real_settings(Request(**options), {}),
            {
                "no instrument measures 'compass'": {"known": "compass"},
                "no instrument measures ''": {"known": ""},
                "--known-sigmas has no effect without --known": {"known_sigmas": "1,2,3,4"},
                "--seed has no effect without --known": {"seed": 4},
                "standard deviations are 1, 2, 3; wanted four numbers": {"known": "depth", "known_sigmas": "1,2,3"},
                "standard deviations are nan; wanted four numbers": {"known": "depth", "known_sigmas": "1,2,x,4"},
                "wanted four numbers above 0": {"known": "depth", "known_sigmas": "1,2,0,4"},
                "largest tilt is 0 degrees": {"max_tilt": 0.0},
                "voxel=-1": {"voxel": -1.0},
                "edge=33": {"grid": 33},
            },
        ),
    ],
)
def test_settings_that_are_refused(settings: Any, refused: dict[str, dict]) -> None:
    for words, changes in refused.items():
        refuses(words, settings, **changes)


class TestAsked:
    def test_gaussian(self, device: Device) -> None:
        assert {paper_grid(edge).extent for edge in (64, 128, 256)} == {256.0}
        full, quick = create("gaussian", Request(device)), create("gaussian", Request(device, quick=True))
        assert full.settings == GaussianSettings("floodgate", (1.0, 2.0), 10, 11, (128, 256))
        assert len(set(full.jobs())) == 2 * 2 * 10 * TABLE1_COUNT
        assert list(quick.jobs()) == [f"128/1.0/11/S{index}" for index in range(TABLE1_COUNT)]
        asked = Request(device, quick=True, seeds=2, seed=0, grid=64, sigma2=(4.0,), scene="harbor")
        assert create("gaussian", asked).settings == GaussianSettings("harbor", (4.0,), 2, 0, (64,))

    def test_floodgate_and_what_is_not_installed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        quick, full = (create("floodgate", Request(quick=quick)).settings for quick in (True, False))
        assert (quick.methods, quick.edges, quick.seeds) == (PAPER_METHODS, (128,), 1)
        assert set(full.methods) | set(full.left_out) == set(PAPER_METHODS) | set(OTHER_METHODS)
        assert (full.edges, full.scans) == ((128, 256), 18)
        asked = create("floodgate", Request(seeds=2, seed=0, grid=64)).settings
        assert (asked.edges, asked.all_seeds) == ((64,), range(0, 2))
        monkeypatch.setattr(floodgate, "is_installed", lambda name: name != "kiss")
        experiment = create("floodgate", Request())
        assert (experiment.settings.left_out, "kiss" in experiment.settings.methods) == (("kiss",), False)

    def test_kinds(self, device: Device) -> None:
        requests = [Request(device, quick, method=("spectral",)) for quick in (False, True)]
        usual, quick = (create("kinds", request).settings for request in requests)
        assert (usual.kinds, usual.count, usual.edge) == (tuple(SCAN_KINDS), 100, 128)
        assert (quick.kinds, quick.count, quick.edge, quick.seed) == (("patch", "swath"), 5, 64, usual.seed)
        asked = create("kinds", Request(device, pairs=7, seed=0, grid=32, method=("icp",)))
        assert asked.settings == KindsSettings(pairs=7, seed=0, edge=32, compared=ComparedMethods(("icp",)))

    def test_surveys_and_what_is_not_installed(self, device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
        quick = create("survey", Request(device, quick=True, seed=3))
        assert list(quick.jobs()) == ["floodgate-3/12/sonarmap"]
        scale = create("scale", Request(quick=True, seed=3, seeds=2))
        assert scale.jobs() == ["3/100", "3/200", "4/100", "4/200"]
        monkeypatch.setattr(survey, "installed", lambda system: system != "kiss-slam")
        settings = create("survey", Request(device)).settings
        assert (settings.systems, settings.left_out) == (("sonarmap", "multiway"), ("kiss-slam",))

    def test_real(self) -> None:
        request = Request(known="depth,attitude", known_sigmas="1,2,3,4", seeds=2, seed=7, max_tilt=180.0, grid=64)
        settings, degree = real_settings(request, {"a": "b"}), np.deg2rad(1)
        assert (settings.known, settings.max_tilt, settings.edge) == (("attitude", "depth"), 180.0, 64)
        assert settings.draws == {"attitude=1,depth=3,seed=7": 7, "attitude=1,depth=3,seed=8": 8}
        np.testing.assert_allclose(settings.instruments.sigmas, [degree, degree, np.inf, np.inf, np.inf, 3])

    def test_methods_that_are_not_installed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def missing(*_: object) -> None:
            raise InputError("the method kiss needs the package kiss-matcher")

        monkeypatch.setattr(methods, "is_installed", lambda name: name != "kiss")
        monkeypatch.setattr(methods, "registrar", missing)
        compared = compared_methods(Request())
        assert compared == ComparedMethods(tuple(name for name in EVALUATED if name != "kiss"), ("kiss",))
        refuses("kiss-matcher", compared_methods, Request(method=("kiss",)))


@pytest.mark.parametrize(
    ("experiment", "jobs"),
    [
        (
            Steps(StepsSettings(("harbor", "pool"), (1.0, 2.0), seeds=3, peers=1, first_seed=7, compared=TWO)),
            [f"harbor/7/{sigma2}/{method}" for sigma2 in ("1.0", "2.0") for method in TWO.methods]
            + [f"{place}/{sigma2}/spectral" for place in ("pool/8", "harbor/9") for sigma2 in ("1.0", "2.0")],
        ),
        (
            Pairs(PairsSettings(yaw=15, any=10, peers={"yaw": 6, "any": 40}, compared=TWO)),
            [f"{batch}/{method}" for batch in ("yaw/000", "yaw/001") for method in TWO.methods]
            + ["yaw/002/spectral"]
            + [f"{batch}/{method}" for batch in ("any/000", "any/001") for method in TWO.methods],
        ),
        (
            Floodgate(FloodgateSettings(("spectral", "icp"), edges=(64, 128), seeds=2, first_seed=5, scans=3)),
            [
                f"{seed}/{part}"
                for seed in (5, 6)
                for part in (
                    "true poses/0/map",
                    *(
                        f"{m}/{e}/{part}"
                        for m, e in runs(("icp", "spectral"), (64, 128))
                        for part in ("01", "02", "map")
                    ),
                )
            ],
        ),
        (
            Kinds(KindsSettings(6, kinds=("swath", "patch"), compared=ComparedMethods(("spectral", "planes")))),
            [
                f"{kind}/{known}/{batch}/{method}"
                for kind in ("swath", "patch")
                for batch in ("000", "001")
                for known in ("none", LEVELED, *([NAVIGATION] if kind == "swath" else []))
                for method in ("spectral", *(["planes"] if known == "none" else []))
            ],
        ),
        (
            SurveyExperiment(SurveySettings("harbor", 2, 7, (20, 30), dive=10, systems=("sonarmap", "multiway")), None),
            [
                f"harbor-{seed}/{job}"
                for seed in (7, 8)
                for job in ("20/sonarmap", "30/sonarmap", "30/multiway", "dives")
            ],
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Experiment) else "",
)
def test_jobs(experiment: Experiment, jobs: list[str]) -> None:
    assert list(experiment.jobs()) == jobs
