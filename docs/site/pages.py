"""Pages of the site that are made from other files: README, changelog, license, examples, and the API from docstrings.

MkDocs loads this as a hook (`hooks` in .mkdocs.yml). Links are written as they work on GitHub; what lies outside docs/
or is shown in another form on the site is rewritten here.
"""

import ast
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
API = {  # page: (title, what is on it, the file that lists the public names)
    "tools": (
        "Scans and maps",
        "Register scans, make a map, write, open and export it.",
        "tools/__init__.pyi",
    ),
    "spectral": ("Registration", "Scans, and how one lies relative to another.", "spectral/__init__.pyi"),
    "slam": ("Surveys", "Poses, pose graphs, pairs and maps.", "slam/__init__.pyi"),
    "kernels": (
        "Kernels",
        "Names of `sonarmap.kernels`: devices, transforms, peaks.",
        "kernels/__init__.pyi",
    ),
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that have no file of their own in docs/."""
    readme = (ROOT / "README.md").read_text()
    pages = {
        "index.md": readme.replace("](docs/", "](").replace("](LICENSE)", "](license.md)"),
        "changelog.md": (ROOT / "CHANGELOG.md").read_text().replace("](docs/", "]("),
        "license.md": f"# License\n\n```text\n{(ROOT / 'LICENSE').read_text()}```\n",
        "api/index.md": api_index(),
    }
    pages |= {f"api/{room}.md": api_page(room) for room in API}
    for example in sorted((ROOT / "docs/examples").glob("*.py")):
        pages[f"examples/{example.stem}.md"] = example_page(example)
    for name, content in pages.items():
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The text of a page with links to README, changelog and examples as they are on the site."""
    markdown = re.sub(r"\]\(\.\./((?:\.\./)*)README\.md", r"](\1index.md", markdown)
    markdown = re.sub(r"\]\(\.\./((?:\.\./)*)CHANGELOG\.md", r"](\1changelog.md", markdown)
    return re.sub(r"\]\(((?:\.\./)*examples/\w+)\.py\)", r"](\1.md)", markdown)


def public_names(source: Path) -> dict[str, str]:
    """The names in the file's `__all__`, each with its module: {"Device": "sonarmap.kernels.device.device"}."""
    tree = ast.parse(source.read_text())
    module = ".".join(source.relative_to(ROOT).with_suffix("").parts)
    package = module.removesuffix(".__init__")
    origins: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            origin = f"{package}.{node.module}" if node.level else f"{node.module}"
            origins |= {alias.asname or alias.name: origin for alias in node.names}
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return {name: origins.get(name, module) for name in ast.literal_eval(node.value)}
    raise ValueError(f"{source} has no __all__; wanted: the list of the names that sonarmap offers")


def api_index() -> str:
    lines = [
        "# API",
        "",
        "Everything here is a name of `sonarmap`, as `sonarmap.register`; kernels are names of `sonarmap.kernels`.",
        "",
    ]
    lines.append("Frames, units and the order of covariances: [conventions](../conventions.md).")
    for room, (title, subject, source) in API.items():
        names = ", ".join(
            f"[`{name}`]({room}.md#{origin}.{name})" for name, origin in public_names(ROOT / source).items()
        )
        lines += ["", f"## {title}", "", f"{subject} {names}"]
    return "\n".join(lines) + "\n"


def api_page(room: str) -> str:
    title, subject, source = API[room]
    package = "sonarmap.kernels" if room == "kernels" else "sonarmap"
    blocks = [
        f"::: {origin}.{name}\n    options:\n      heading: {package}.{name}\n      toc_label: {name}\n"
        for name, origin in public_names(ROOT / source).items()
    ]
    return "\n".join([f"# {title}", "", subject, "", *blocks])


def example_page(example: Path) -> str:
    """The code of an example below its first sentence."""
    code = example.read_text()
    title = (ast.get_docstring(ast.parse(code)) or example.stem).splitlines()[0].partition(":")[0].rstrip(".")
    return f"# {title}\n\n`docs/examples/{example.name}`\n\n```python\n{code}```\n"
