"""Every verb and option that README and docs name exists in the real command line; nothing is run here."""

import shlex
from pathlib import Path

import pytest

from tests.commands.inputs import INPUTS
from tests.commands.pages import (
    PAGES,
    all_options,
    examples,
    is_complete,
    mentions,
    named,
    options,
    options_of,
    parse,
    starts,
    verbs,
    words_of,
)

# Options that sentences name: of other programs, and one that every verb takes.
FOREIGN = {"--help-all", "-m", "--filters", "--no-deps", "--quiet"}


def test_pages_have_commands_and_wrong_ones_are_refused() -> None:
    found = [example for page in PAGES for example in examples(page)]
    assert len(found) > 100
    assert {example.language for example in found} == {"sh", "python"}
    for wrong in ("mapp scans/", "map scans/ -o map/ --grids 64", "map scans/", "devices --tests"):
        assert not is_complete(f"sonarmap {wrong}")
    assert not is_complete("sonarmap map SCANS -o map/")
    assert is_complete("sonarmap map scans/ -o map/")


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_of_blocks_are_complete(page: Path) -> None:
    for example in examples(page):
        if not example.inline and example.language == "sh" and words_of_shell(example.text):
            parse(example.text)  # raises UsageError for a wrong command


def words_of_shell(text: str) -> list[str]:
    """Words of a line that begins with sonarmap, after optional variables; none of another line."""
    words = [word for word in shlex.split(text) if "=" not in word or word.startswith("-")]
    return words_of(text) if words[:1] == ["sonarmap"] else []


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_verbs_and_options_named_in_sentences_exist(page: Path) -> None:
    wrong = []
    for text in mentions(page):
        verb, *rest = words_of(text)
        if verb == "VERB":
            continue
        known = options_of(verb) if verb in verbs() else options_of()
        words = rest if verb in verbs() else [verb, *rest]
        wrong += [text for word in words if word.startswith("-") and word.partition("=")[0] not in known]
        wrong += [text] if verb not in verbs() and not verb.startswith("-") else []
    assert not wrong
    assert options(page) - all_options() <= FOREIGN


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_inputs_named_by_pages_exist(page: Path) -> None:
    assert set(starts(page)) <= set(INPUTS)
