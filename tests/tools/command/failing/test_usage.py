"""What typer refuses: one look with all other errors, and what to do."""

import pytest

from tests.samples.clutter_scans import sonarmap


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("fly", "error: there is no verb 'fly'. `sonarmap --help` lists them."),
        ("maps a", "error: there is no verb 'maps'; did you mean 'map'? `sonarmap --help` lists them."),
        ("--bogus", "error: sonarmap has no option --bogus. `sonarmap --help` lists them."),
        (
            "map a.ply -o x --gird 3",
            "error: sonarmap map has no option --gird; did you mean --grid? `sonarmap map --help-all` lists all "
            "options.",
        ),
        ("map", "error: INPUT... is missing: Scans: files, folders, patterns, topics of bags. `sonarmap map --help` "
         "shows how it is called."),
        ("map a.ply", "error: --out is missing: Folder for the results. `sonarmap map --help` shows how it is called."),
        ("map a.ply -o", "error: -o needs a value after it; give one, or leave -o out."),
        ("devices --device", "error: --device needs a value after it"),
        ("devices --bogus", "error: sonarmap devices has no option --bogus"),
        ("register a b c", "error: c is too much; `sonarmap register --help` shows how it is called."),
        ("devices --json=3", "error: --json takes no value; leave out what stands after it."),
        ("map a.ply -o x --grid many", "error: --grid: 'many'; give a whole number"),
        ("map a.ply -o x --loops 2.5", "error: --loops: '2.5'; give a whole number"),
        ("map a.ply -o x --max-speed fast", "error: --max-speed: 'fast'; give a number"),
        ("map a.ply -o x --workers 0", "error: --workers: '0'; give 1 or more"),
        (f"map a.ply -o x --workers={10**22}", f"error: --workers: '{10**22}'; give 1024 or less"),
        (f"reproduce all --workers={10**22}", f"error: --workers: '{10**22}'; give 1024 or less"),
        (f"map a.ply -o x --loops={10**22}", f"error: --loops: '{10**22}'; give 1000000 or less"),
        (f"map a.ply -o x --min-seen={10**22}", f"error: --min-seen: '{10**22}'; give 1000000 or less"),
        ("simulate -o x --fix-outliers 1.5 --priors position", "error: --fix-outliers: '1.5'; give 1 or less"),
        ("map a.ply -o x --method pencil", "error: --method: "),
        ("map a.ply -o x --grid 98", "error: --grid 98 is not an even product of 2, 3 and 5 from 16 to 512"),
        ("register a b --write x.jpg", "error: --write: x.jpg; give a name that ends in .ply or .pcd"),
    ],
)  # fmt: skip
def test_what_was_given_and_what_to_do(line: str, message: str) -> None:
    result = sonarmap(*line.split())
    assert (result.exit_code, result.stdout) == (2, "")
    said = " ".join(result.stderr.split())
    assert said.startswith(message)
    assert "Usage" not in said
    assert "╭" not in said


def test_without_a_verb_there_is_the_help() -> None:
    result = sonarmap()
    assert result.exit_code == 2
    assert "Usage: sonarmap VERB ..." in result.output
    assert "error" not in result.stderr
