# pyright: strict
"""The parts of pages that need no network: styles and scripts with their hashes, and texts and bytes that are embedded
so that nothing takes them for markup."""

import html
import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from hashlib import sha256
from importlib.resources import files
from string import Template
from typing import Any

REPORT_WEB = "sonarmap.tools.products.report.page.web"
Files = Sequence[tuple[str, str]]  # package and name of each


def page_text(
    body: tuple[str, str],
    styles: Files,
    scripts: Files,
    said: tuple[str, str],
    content: Mapping[str, Any],
    points: Mapping[str, Sequence[bytes | None]],
    **more: str,
) -> str:
    """A page that holds all that it needs. Texts are in it as JSON, which the scripts show as text, or escaped.

    Args:
        body: the file of what follows the heading, with `$content`, `$points`, `$script` and whatever `more` fills in.
        said: the heading, and a sentence below it.
        content: what the scripts show.
        points: gzipped points; the scripts know those of `kind` as the elements kind-0, kind-1 and so on.
    """
    elements = [
        f'<script type="application/gzip" id="{kind}-{number}">{_base64(each)}</script>'
        for kind, packed in points.items()
        for number, each in enumerate(packed)
        if each is not None
    ]
    title, verdict = (html.escape(text.encode("utf-8", "backslashreplace").decode("utf-8")) for text in said)
    return Template(part(REPORT_WEB, "head.html") + part(*body)).substitute(
        joined(styles, scripts),
        title=title,
        verdict=verdict,
        content=embedded(content),
        points="\n".join(elements),
        **more,
    )


def joined(styles: Files, scripts: Files) -> Mapping[str, str]:
    """What a page's template has to fill in of these files: `style`, `script`, and what a
    Content-Security-Policy names them by, `style_hash` and `script_hash`."""
    style = "\n" + "".join(part(*each) for each in styles)
    script = "\n" + "\n".join(part(*each) for each in scripts)
    return {"style": style, "style_hash": _hash(style), "script": script, "script_hash": _hash(script)}


def part(package: str, name: str) -> str:
    """The text of a file of ours."""
    return (files(package) / name).read_text(encoding="utf-8")


def embedded(value: Any) -> str:
    """JSON that no HTML parser takes for a tag, whatever texts are in it; ASCII, so that any file name survives."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", r"\u003c").replace(">", r"\u003e").replace("&", r"\u0026")


def embedded_png(data: bytes) -> str:
    """The address of a picture that is in the page."""
    return f"data:image/png;base64,{_base64(data)}"


def _base64(data: bytes) -> str:
    return b64encode(data).decode("ascii")


def _hash(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"
