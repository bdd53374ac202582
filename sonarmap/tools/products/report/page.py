"""report.html: the page's parts joined into one self-contained file."""

import html
import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import REPORT, as_written, write_summary
from sonarmap.tools.files.user_file import naming
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path
from sonarmap.tools.products.report.content import Content, content_of

# Joined in this order in one scope: a script may use names of earlier ones at load.
SCRIPTS = tuple(
    f"{name}.js"
    for name in (
        *("packed", "camera", "scene", "elements", "colorings", "layers", "labels", "gestures", "map_view"),
        *("picking", "view", "geo", "controls", "ties", "sections", "main"),
    )
)
REPORT_WEB = "sonarmap.tools.products.report.web"
Files = Sequence[tuple[str, str]]  # package and name of each


def write_report(folder: Map) -> Path:
    """Write report.html into a map's folder and return its path; summary.json lists it, so that the next `sonarmap map`
    removes it."""
    with as_written(folder.path), naming(folder.path):
        page = report_text(content_of(folder))
    with all_or_none():
        with atomic_path(folder.path / REPORT) as temporary:
            temporary.write_text(page, encoding="utf-8")
        write_summary(folder.path, folder.summary, [REPORT])
    return folder.path / REPORT


def report_text(content: Content) -> str:
    """HTML of a self-contained page; its texts are JSON, which the scripts show as text, or escaped. The gzipped points
    of part N are in the element points-N."""
    shown = content.shown
    elements = [
        f'<script type="application/gzip" id="points-{number}">{base64_text(data)}</script>'
        for number, data in enumerate(content.points)
    ]
    return Template(part(REPORT_WEB, "page.html")).substitute(
        joined([(REPORT_WEB, "page.css")], [(REPORT_WEB, name) for name in SCRIPTS]),
        title=escaped(shown["title"]),
        verdict=escaped(shown["verdict"]["sentence"]),
        content=embedded(shown),
        pictures=embedded(
            {name: f"data:image/png;base64,{base64_text(data)}" for name, data in content.pictures.items()}
        ),
        points="\n".join(elements),
    )


def joined(styles: Files, scripts: Files) -> Mapping[str, str]:
    """Values for a page's template: `style` and `script`, the joined files, and `style_hash` and `script_hash`, their
    hashes for the Content-Security-Policy."""
    style = "\n" + "".join(part(*each) for each in styles)
    script = "\n" + "\n".join(part(*each) for each in scripts)
    return {"style": style, "style_hash": _hash(style), "script": script, "script_hash": _hash(script)}


def part(package: str, name: str) -> str:
    return (files(package) / name).read_text(encoding="utf-8")


def embedded(value: Any) -> str:
    """JSON without characters of HTML tags, for use in a page; ASCII, so that any file name survives."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", r"\u003c").replace(">", r"\u003e").replace("&", r"\u0026")


def escaped(text: str) -> str:
    return html.escape(text.encode("utf-8", "backslashreplace").decode("utf-8"))


def base64_text(data: bytes) -> str:
    return b64encode(data).decode("ascii")


def _hash(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"
