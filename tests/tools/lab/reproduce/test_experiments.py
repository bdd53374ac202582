"""Choice of experiments and of their settings by the command line, and refused options."""

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce import registrations
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, Request, as_asked, chosen
from sonarmap.tools.lab.reproduce.registrations import EVALUATED, compared_methods
from tests.samples.refusals import refuses


@pytest.mark.parametrize(
    ("name", "options", "names"),
    [
        ("all", {}, ("translation", "rotation", "limits", "gaussian", "floodgate")),
        ("pairs", {"method": ("kiss",), "seeds": 2}, ("pairs",)),
        ("pairs", {"set": ("paths", "overlap"), "seeds": 2, "pairs": 5}, ("pairs",)),
        ("real", {"folder": "DIR", "known": "depth"}, ("real",)),
    ],
)
def test_experiments_are_chosen_by_name_or_all_of_the_paper(name: str, options: dict, names: tuple[str, ...]) -> None:
    assert chosen(name, Request(**options)) == names
    assert [each for each in EXPERIMENTS if EXPERIMENTS[each].timed] == ["survey", "scale"]


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("kinds", {"scene": "harbor"}, "--scene has no effect"),
        ("pairs", {"set": ("unrelated",), "sigma2": (1.0,)}, "--sigma2 has no effect"),
        ("pairs", {"set": ("paths",), "pairs": 5}, "--pairs has no effect"),
        ("real", {}, "reproduce real needs a folder"),
        ("pairs", {"folder": "DIR"}, "reproduce pairs simulates its scans, so the folder DIR"),
    ],
)
def test_options_without_effect_are_refused(name: str, options: dict, words: str) -> None:
    refuses(words, chosen, name, Request(**options))


def test_the_repeated_command_names_no_folder() -> None:
    options = {"quick": True, "seed": 0, "sigma2": (1.0, 2.5), "method": ("kiss",), "folder": "/where/it/lies"}
    request = Request(**options)
    wanted = "sonarmap reproduce x DIR --quick --sigma2 1 --sigma2 2.5 --seed 0 --method kiss"
    assert sorted(request.command("x").split()) == sorted(wanted.split())


def test_options_override_quick_settings_and_those_the_defaults() -> None:
    defaults = {"scenes": ("a", "b"), "seeds": 9, "first_seed": 7, "edges": (128, 256)}
    quick = {"seeds": 1, "edges": (128,)}
    assert vars(as_asked(Request(scene="c"), defaults, quick)) == defaults | {"scenes": ("c",)}
    assert vars(as_asked(Request(quick=True, seed=2, grid=64), defaults, quick)) == {
        **{"scenes": ("a", "b"), "seeds": 1, "first_seed": 2, "edges": (64,)}
    }


def test_missing_methods_are_left_out_unless_requested(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object) -> None:
        raise InputError("the method kiss needs the package kiss-matcher")

    monkeypatch.setattr(registrations, "is_installed", lambda name: name != "kiss")
    monkeypatch.setattr(registrations, "registrar", missing)
    compared = compared_methods(Request())
    assert compared == {"methods": tuple(name for name in EVALUATED if name != "kiss"), "left_out": ("kiss",)}
    refuses("kiss-matcher", compared_methods, Request(method=("kiss",)))
