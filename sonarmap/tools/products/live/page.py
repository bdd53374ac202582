# pyright: strict
"""The page as one text: its own scripts behind those of the report, and the policy that lets no others run."""

from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
from string import Template

REPORT, OWN = "sonarmap.tools.products.report.page.web", "sonarmap.tools.products.live.web"
_OF_REPORT = (
    *("map/camera", "map/shaders", "map/scene", "map/picking", "map/palettes", "elements"),
    *("map/layers", "map/labels", "map/gestures", "map/controls"),
)
_OWN = ("dive", "clouds", "view", "coverage", "live")


def live_page() -> tuple[str, str]:
    """The page, and its Content-Security-Policy."""
    style = "\n" + _part(REPORT, "page.css") + _part(OWN, "live.css")
    scripts = [*((REPORT, name) for name in _OF_REPORT), *((OWN, name) for name in _OWN)]
    script = "\n" + "\n".join(_part(package, f"{name}.js") for package, name in scripts)
    policy = (
        f"default-src 'none'; connect-src 'self'; img-src data:; style-src {_hash(style)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return Template(_part(OWN, "live.html")).substitute(style=style, script=script), policy


def _part(package: str, name: str) -> str:
    return (files(package) / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"
