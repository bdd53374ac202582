# pyright: strict
"""report.html: the page's parts joined into one file that needs no other."""

import html
import json
from base64 import b64encode
from collections.abc import Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import FULL_GRAPH, REPORT, SUMMARY
from sonarmap.tools.files.user_file import naming
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path
from sonarmap.tools.files.writers.json_text import write_json
from sonarmap.tools.products.report.page.content import Content, content_of

# One after another in one scope, so that a name is there before what uses it at load.
SCRIPTS = tuple(
    f"{name}.js"
    for name in (
        *("map/packed", "map/camera", "map/shaders", "map/scene", "map/picking", "map/palettes", "elements", "charts"),
        *("map/colorings", "map/layers", "map/geodesy", "map/labels", "map/gestures", "map/view", "map/controls"),
        *("map/picked", "byhand/csv", "byhand/decisions", "byhand/ties", "byhand/control"),
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
    try:
        with naming(folder.path):
            page = report_text(content_of(folder))
    except InputError:
        raise
    except (ValueError, LookupError, TypeError, ArithmeticError, AttributeError) as error:
        raise InputError(
            f"{folder.path / SUMMARY} and {FULL_GRAPH} are not as `sonarmap map` writes them ({error!r}); map again"
        ) from error
    with all_or_none():
        with atomic_path(folder.path / REPORT) as temporary:
            temporary.write_text(page, encoding="utf-8")
        listed = dict.fromkeys([*folder.summary.get("files", []), REPORT])
        write_json(folder.path / SUMMARY, {**folder.summary, "files": list(listed)})
    return folder.path / REPORT


def report_text(content: Content) -> str:
    """The page. Texts from files are in it as JSON, which the scripts show as text, or escaped."""
    style = f"\n{_part('page.css')}"
    script = "\n" + "\n".join(_part(name) for name in SCRIPTS)
    pictures = {name: f"data:image/png;base64,{_base64(data)}" for name, data in content.pictures.items()}
    judged = content.shown["verdict"]
    return Template(_part("page.html")).substitute(
        title=_escaped(content.shown["title"]),
        verdict=_escaped(judged["sentence"]),
        style=style,
        style_hash=_hash(style),
        script=script,
        script_hash=_hash(script),
        content=_embedded(content.shown),
        pictures=_embedded(pictures),
        points="\n".join([*_points("points", content.points), *_points("doubtful", content.doubtful)]),
    )


def _points(kind: str, parts: Sequence[bytes | None]) -> list[str]:
    return [
        f'<script type="application/gzip" id="{kind}-{number}">{_base64(packed)}</script>'
        for number, packed in enumerate(parts)
        if packed is not None
    ]


def _part(name: str) -> str:
    return (files("sonarmap.tools.products.report.page.web") / name).read_text(encoding="utf-8")


def _embedded(value: Any) -> str:
    """JSON that no HTML parser takes for a tag, whatever texts are in it; ASCII, so that any file name survives."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", r"\u003c").replace(">", r"\u003e").replace("&", r"\u0026")


def _escaped(text: str) -> str:
    """A text as HTML; what is no Unicode in it is shown as its number."""
    return html.escape(text.encode("utf-8", "backslashreplace").decode("utf-8"))


def _hash(text: str) -> str:
    """As a Content-Security-Policy names a script that may run."""
    return f"'sha256-{b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


def _base64(data: bytes) -> str:
    return b64encode(data).decode("ascii")
