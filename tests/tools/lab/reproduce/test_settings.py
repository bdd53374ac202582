"""What the command line asks of experiments: which of them, with which settings, and so which jobs; and refusals."""

import math
from typing import Any

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce import methods
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, Request, chosen
from sonarmap.tools.lab.reproduce.floodgate.run import FloodgateSettings
from sonarmap.tools.lab.reproduce.gaussian.run import GaussianSettings
from sonarmap.tools.lab.reproduce.kinds.settings import KindsSettings
from sonarmap.tools.lab.reproduce.methods import EVALUATED, ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.structures.settings import LimitsSettings, TranslationSettings
from sonarmap.tools.lab.reproduce.survey.simulated import SurveySettings
from tests.samples.refusals import refuses

EVALUATION = ("steps", "pairs", "unrelated")


class TestChosen:
    @pytest.mark.parametrize(
        ("name", "options", "names"),
        [
            ("all", {}, ("translation", "rotation", "limits", "gaussian", "floodgate")),
            ("evaluation", {"method": ("kiss",), "grid": 64}, EVALUATION),
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
            ("real", {}, "reproduce real needs a folder"),
            ("judge", {}, "DIR holds what sonarmap reproduce evidence -o DIR wrote"),
            ("pairs", {"folder": "DIR"}, "reproduce pairs simulates its scans, so the folder DIR"),
        ],
    )
    def test_what_has_no_effect_is_refused(self, name: str, options: dict, words: str) -> None:
        refuses(words, chosen, name, Request(**options))

    def test_the_command_that_asks_for_the_same_names_no_folder(self) -> None:
        options = {"quick": True, "seed": 0, "sigma2": (1.0, 2.5), "method": ("kiss",), "folder": "/where/it/lies"}
        asked = Request(**options)  # pyright: ignore[reportArgumentType]
        wanted = "sonarmap reproduce x DIR --quick --sigma2 1 --sigma2 2.5 --seed 0 --method kiss"
        assert sorted(asked.command("x").split()) == sorted(wanted.split())


@pytest.mark.parametrize(
    ("settings", "words", "changes"),
    [
        (FloodgateSettings, "no method is called alchemy", {"methods": ("alchemy",)}),
        (FloodgateSettings, "2 to 18", {"scans": 1}),
        (GaussianSettings, "no scene is called 'moon'", {"scene": "moon"}),
        (GaussianSettings, "--sigma2: nan", {"sigma2": (math.nan,)}),
        (TranslationSettings, "farther than the one before", {"steps": (4, 2)}),
        (TranslationSettings, "0 seeds", {"seeds": 0}),
        (LimitsSettings, "tilts_deg", {"tilts_deg": (0, 5)}),
        (SurveySettings, "2 scans", {"counts": (1,)}),
        (KindsSettings, "sonogram", {"kinds": ("sonogram",)}),
    ],
)
def test_settings_that_are_refused(settings: Any, words: str, changes: dict) -> None:
    refuses(words, settings, **changes)


class TestAsked:
    def test_methods_that_are_not_installed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def missing(*_: object) -> None:
            raise InputError("the method kiss needs the package kiss-matcher")

        monkeypatch.setattr(methods, "is_installed", lambda name: name != "kiss")
        monkeypatch.setattr(methods, "registrar", missing)
        compared = compared_methods(Request())
        assert compared == ComparedMethods(tuple(name for name in EVALUATED if name != "kiss"), ("kiss",))
        refuses("kiss-matcher", compared_methods, Request(method=("kiss",)))
