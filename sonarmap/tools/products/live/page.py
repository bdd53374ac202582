# pyright: strict
"""The page as one text: its own scripts behind those of the report, and the policy that lets no others run."""

from string import Template

from sonarmap.tools.products.report.page.parts import REPORT_WEB, joined, part

OWN = "sonarmap.tools.products.live.web"
_OF_REPORT = (
    *("map/camera", "map/shaders", "map/scene", "map/picking", "map/palettes", "elements"),
    *("map/layers", "map/labels", "map/gestures", "map/controls"),
)
_OWN = ("dive", "clouds", "view", "coverage", "live")


def live_page() -> tuple[str, str]:
    """The page, and its Content-Security-Policy."""
    scripts = [*((REPORT_WEB, name) for name in _OF_REPORT), *((OWN, name) for name in _OWN)]
    parts = joined(
        [(REPORT_WEB, "page.css"), (OWN, "live.css")], [(package, f"{name}.js") for package, name in scripts]
    )
    policy = (
        f"default-src 'none'; connect-src 'self'; img-src data:; style-src {parts['style_hash']}; "
        f"script-src {parts['script_hash']}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return Template(part(OWN, "live.html")).substitute(parts), policy
