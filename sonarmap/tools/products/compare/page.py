# pyright: strict, reportUnknownMemberType=false
"""changes.html: both surveys and what changed between them in 3D, on one page that needs no other file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.tools.products.compare.comparison import Comparison
from sonarmap.tools.products.compare.picture import colored
from sonarmap.tools.products.report.page.parts import REPORT_WEB, embedded_png, page_text
from sonarmap.tools.products.report.page.points import pack

OWN = "sonarmap.tools.products.compare.web"
_OF_REPORT = (
    *("map/packed", "map/camera", "map/shaders", "map/scene", "map/picking", "map/palettes", "elements"),
    *("map/colorings", "map/labels", "map/gestures", "map/canvas", "map/controls"),
)
MOST_POINTS = 1_000_000  # of a survey, and core points
UNSAID, _MIDDLE = 255, 127  # codes of distances: nothing can be said, and none
_EXTREMES, _MOST_PART = (0.01, 0.99), (0.005, 0.995)  # quantiles, of heights and of places, as on the report


def changes_page(comparison: Comparison, picture: bytes) -> str:
    """The page, with changes.png for who has no WebGL."""
    content, clouds = _content(comparison)
    regions, names = comparison.regions, [Path(name).name or name for name in (comparison.old, comparison.new)]
    gained, lost = (sum(abs(each.volume) for each in regions if each.gained is kind) for kind in (True, False))
    said = f"{counted(len(regions), 'region')} changed: {gained:,.1f} m³ gained, {lost:,.1f} m³ lost."
    return page_text(
        (OWN, "changes.html"),
        [(REPORT_WEB, "page.css"), (OWN, "changes.css")],
        [*((REPORT_WEB, f"{name}.js") for name in _OF_REPORT), (OWN, "changes.js")],
        (f"What changed from {names[0]} to {names[1]}", said),
        content,
        {"points": clouds},
        picture=embedded_png(picture),
    )


def _content(comparison: Comparison) -> tuple[dict[str, Any], Sequence[bytes]]:
    """What the page says, for JSON, and the points of `old`, `new` and `changes`."""
    distances = comparison.distances
    known, most = colored(distances)
    code = np.rint(_MIDDLE * np.clip(distances.distance / most, -1, 1)) + _MIDDLE
    columns = {"distance": np.where(known, code, UNSAID).astype(np.int64), "verdict": distances.verdict}
    surveys = {"old": comparison.old_points, "new": comparison.new_points}
    clouds: dict[str, Any] = {}
    packed: list[bytes] = []
    for name, points in {**surveys, "changes": distances.cores.points}.items():
        chosen = np.arange(len(points))
        if len(points) > MOST_POINTS:
            chosen = np.random.default_rng(0).choice(len(points), MOST_POINTS, replace=False)
        own = {key: column[chosen] for key, column in columns.items()} if name == "changes" else {}
        data, layout = pack(points[chosen], own, distances.voxel)
        packed.append(data)
        clouds[name] = {"packed": layout, "count": len(chosen), "all": len(points)}
    both = np.concatenate(list(surveys.values()))
    extent, middle, heights = (np.quantile(both, share, axis=0) for share in ((0, 1), _MOST_PART, _EXTREMES))
    shown = {"clouds": clouds, "extent": extent.tolist(), "middle": middle.tolist(), "most_m": most}
    return {**comparison.as_json, **shown, "height_range": heights[:, 2].tolist()}, packed
