# pyright: strict
"""report.html: the page's parts joined into one file that needs no other."""

from pathlib import Path

from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import REPORT
from sonarmap.tools.files.map_folder.whole import as_written, write_summary
from sonarmap.tools.files.user_file import naming
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path
from sonarmap.tools.products.report.page.content import Content, content_of
from sonarmap.tools.products.report.page.parts import REPORT_WEB, embedded, embedded_png, page_text

# One after another in one scope, so that a name is there before what uses it at load.
SCRIPTS = tuple(
    f"{name}.js"
    for name in (
        *("map/packed", "map/camera", "map/shaders", "map/scene", "map/picking", "map/palettes", "elements", "charts"),
        *("map/colorings", "map/layers", "map/geodesy", "map/labels", "map/gestures", "map/canvas", "map/view"),
        *("map/controls", "map/picked", "ties"),
        *("profile", "sections", "main"),
    )
)


def write_report(folder: Map) -> Path:
    """Write report.html into a map's folder, and list it in summary.json, so that the next `sonarmap map` removes it.

    Returns:
        The page's path.

    Raises:
        InputError: the map's files are damaged, or the page cannot be written.
    """
    with as_written(folder.path), naming(folder.path):
        page = report_text(content_of(folder))
    with all_or_none():
        with atomic_path(folder.path / REPORT) as temporary:
            temporary.write_text(page, encoding="utf-8")
        write_summary(folder.path, folder.summary, [REPORT])
    return folder.path / REPORT


def report_text(content: Content) -> str:
    """The page."""
    shown = content.shown
    pictures = {name: embedded_png(data) for name, data in content.pictures.items()}
    return page_text(
        (REPORT_WEB, "page.html"),
        [(REPORT_WEB, "page.css")],
        [(REPORT_WEB, name) for name in SCRIPTS],
        (shown["title"], shown["verdict"]["sentence"]),
        shown,
        {"points": content.points, "doubtful": content.doubtful},
        pictures=embedded(pictures),
    )
