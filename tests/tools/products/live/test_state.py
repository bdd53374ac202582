"""What is said of a dive, in each status."""

import pytest

from sonarmap.tools.command.live.words import Standing, sentence

ALONE = Standing(1, 1, 1, sigma=0.072)
MANY = Standing(3200, 3156, 41, parts=2, behind=7, late=1.4, missing=3, sigma=1.26)


@pytest.mark.parametrize(
    ("status", "standing", "said"),
    [
        ("waiting", Standing(), "Waiting for scans."),
        ("waiting", Standing(silent=3.0), "Waiting for scans."),
        (
            "waiting",
            Standing(silent=7.4),
            "Waiting for scans; 0 of 0 scans placed, 0 loops, nothing has come for 7 s.",
        ),
        ("placed", Standing(5, 4), "Placed; 4 of 5 scans placed, 0 loops."),
        ("placed", ALONE, "Placed to within 7 cm; 1 of 1 scans placed, 1 loop."),
        (
            "uncertain",
            MANY,
            "Placed, but only to within 1.3 m; 3,156 of 3,200 scans placed, 41 loops, 2 parts that nothing joins yet, "
            "3 shots missing, 7 scans, 1 s, behind.",
        ),
        (
            "placed",
            Standing(9, 8, 2, missing=1, behind=1, late=2.6, sigma=0.31),
            "Placed to within 31 cm; 8 of 9 scans placed, 2 loops, 1 shot missing, 1 scan, 3 s, behind.",
        ),
        (
            "placed",
            Standing(900, 800, 2, behind=256, late=51.2, sigma=0.31),
            "Placed to within 31 cm; 800 of 900 scans placed, 2 loops, 256 or more scans, 51 s, behind.",
        ),
        ("placed", Standing(9, 8, behind=4, late=1.0), "Placed; 8 of 9 scans placed, 0 loops."),
        (
            "lost",
            Standing(12, 8, 1, lost_for=4.3),
            "Lost for 4 s: nothing that is seen fits the map; go back to the last sure place; 8 of 12 scans placed, "
            "1 loop.",
        ),
        (
            "lost",
            Standing(12, 8, 2, parts=2, alone=True),
            "Lost: what is seen now is a map of its own until a known place is seen again; 8 of 12 scans placed, "
            "2 loops, 2 parts that nothing joins yet.",
        ),
        ("ended", Standing(12, 8, 2, silent=60.0), "The dive has ended; 8 of 12 scans placed, 2 loops."),
    ],
)
def test_each_status_in_a_sentence(status: str, standing: Standing, said: str) -> None:
    assert sentence(status, standing) == said
