"""Ties decided by clicks in Chromium, and the file that the page saves."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sonarmap.tools.products.report.content import Content
from tests.tools.products.report.browser import Opened, click, opened
from tests.tools.products.report.known_map import AS_WRITTEN, NAMES, path_of, saved

if TYPE_CHECKING:
    from playwright.sync_api import Dialog

MADE: dict[str, Any] = {"target": NAMES[0], "source": NAMES[7], "verdict": "add", "note": 'why, "so"', "effect": "kept"}
MADE |= {"transform": {}}


@pytest.fixture(scope="class")
def shown(content: Content, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    """Page of a map whose scan names need escaping."""
    with opened(path_of(content, tmp_path_factory.mktemp("the page's"))) as page:
        yield page


@pytest.fixture
def page(shown: Opened) -> Opened:
    """The page, reset to its state after opening."""
    shown.page.evaluate("sonarmap.decisions.forget('ties'); sonarmap.view.leave(); sonarmap.view.camera.reset()")
    return shown


def decide(page: Opened, row: int, verdict: str) -> None:
    page.page.locator("#loops tbody tr").nth(row).get_by_role("button", name=verdict, exact=True).click()


def tie(target: int, source: int, verdict: str, note: str = "") -> dict[str, str]:
    return {"target": AS_WRITTEN[target], "source": AS_WRITTEN[source], "verdict": verdict, "note": note}


def ends(content: Content, row: int) -> tuple[int, int]:
    pair = content.shown["pairs"][row]
    return pair["target"], pair["source"]


class TestOfOnePage:
    """The tests share one page."""

    def test_loops_are_accepted_and_rejected_in_the_list(self, page: Opened, content: Content, tmp_path: Path) -> None:
        decide(page, 0, "reject")
        decide(page, 1, "accept")
        decide(page, 2, "reject")
        decide(page, 2, "undecided")
        page.page.locator("#ties tbody tr").nth(0).locator("input").fill('like, "another" pillar')
        first, second = ends(content, 0), ends(content, 1)
        rejected = tie(*first, "reject", 'like, "another" pillar')
        assert saved(page, "ties", tmp_path) == [rejected, tie(*second, "accept")]

    def test_names_are_saved_as_they_are(self, page: Opened, tmp_path: Path) -> None:
        """Commas, quotes, line breaks, a # or blanks at the ends, letters of any script, bytes that are no UTF-8."""
        page.page.evaluate(
            "for (let k = 1; k < 8; k++) sonarmap.decisions.decide({ target: k - 1, source: k }, 'reject')"
        )
        assert saved(page, "ties", tmp_path) == [tie(k - 1, k, "reject") for k in range(1, 8)]

    def test_a_tie_is_added_by_clicking_on_two_scans(self, page: Opened, content: Content, tmp_path: Path) -> None:
        """From above, where no two poses of the ring are seen at the same place."""
        tried = {
            *map(tuple, content.shown["sequential"]),
            *(ends(content, k) for k in range(len(content.shown["pairs"]))),
        }
        i, j = next(pair for pair in combinations(range(8), 2) if pair not in tried)
        page.page.evaluate("sonarmap.view.camera.fromAbove()")
        places = np.array(content.shown["parts"][0]["track"]["places"])
        click(page.page, places[j])
        page.page.get_by_role("button", name="Tie to another scan").click()
        assert "Click on the place of the scan" in page.page.locator("#picked").inner_text()
        page.page.locator("#canvas").press("Escape")
        assert page.page.evaluate("sonarmap.view.tying") is None
        click(page.page, places[j])
        page.page.get_by_role("button", name="Tie to another scan").click()
        click(page.page, places[i])
        picked = page.page.locator("#picked")
        assert "not tried by the map" in picked.inner_text()
        picked.get_by_role("button", name="add").click()
        assert page.page.evaluate("sonarmap.view.scene.lines.get('accepted').count") == 1
        assert saved(page, "ties", tmp_path) == [tie(i, j, "add")]
        click(page.page, (places[i] + places[j]) / 2)
        picked.get_by_role("button", name="undecided").click()
        assert page.page.evaluate("sonarmap.view.scene.lines.get('accepted').count") == 0


@pytest.mark.slow
def test_the_ties_of_the_map_remain_when_new_ones_are_discarded(content: Content, tmp_path: Path) -> None:
    made = tie(0, 7, "add", MADE["note"])
    with opened(path_of(content, tmp_path, ties=[MADE])) as page:
        assert "kept" in page.page.locator("#ties tbody tr").inner_text()
        assert saved(page, "ties", tmp_path) == [made]
        decide(page, 0, "reject")
        page.page.locator("#ties tbody input").nth(1).fill("seen twice")
        assert not page.page.evaluate("sonarmap.decisions.saved")
        assert saved(page, "ties", tmp_path) == [made, tie(*ends(content, 0), "reject", "seen twice")]
        assert page.page.evaluate("sonarmap.decisions.saved")
        page.page.locator("#ties").get_by_role("button", name="Discard new decisions").click()
        assert saved(page, "ties", tmp_path) == [made]


@pytest.mark.slow
def test_the_browser_asks_before_unsaved_decisions_are_lost(content: Content, tmp_path: Path) -> None:
    with opened(path_of(content, tmp_path)) as page:
        asked: list[str] = []

        def agree(dialog: "Dialog") -> None:
            asked.append(dialog.type)
            dialog.accept()

        page.page.on("dialog", agree)
        decide(page, 0, "reject")
        saved(page, "ties", tmp_path)
        page.page.reload()
        assert asked == []
        decide(page, 0, "reject")
        page.page.reload()
        assert asked == ["beforeunload"]
