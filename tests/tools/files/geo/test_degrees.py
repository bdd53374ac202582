"""Latitudes and longitudes as people write them."""

import pytest

from sonarmap.tools.files.geo.degrees import place_of


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("60.3913,5.3221", [60.3913, 5.3221]),
        ("60°23.478'N,5°19.326'E", [60.3913, 5.3221]),
        ("60 23.478 N, 5 19.326 E", [60.3913, 5.3221]),
        ("60°23’28.68″ N, 5°19′19.56″ W,-3.5", [60.3913, -5.3221, -3.5]),
        ("n60:23.478, w 5:19.326", [60.3913, -5.3221]),
        ("-33.8568,151.2153,2.5", [-33.8568, 151.2153, 2.5]),
        ("-0 30, 0 30 W", [-0.5, -0.5]),
        ("60.3913° S,5.3221°", [-60.3913, 5.3221]),
    ],
)
def test_places(text: str, place: list[float]) -> None:
    assert place_of(text) == pytest.approx(place, abs=1e-9)


@pytest.mark.parametrize(
    "text", ["60 61 N,5 E", "5 E,60 N", "-60 23 N,5 E", "60 23.4 28 N,5", "60.5 23 N,5", "north,5", ",", "60 23 99 N,5"]
)
def test_what_is_none(text: str) -> None:
    with pytest.raises(ValueError, match=r"convert|below 60|sign|no letter"):
        place_of(text)
