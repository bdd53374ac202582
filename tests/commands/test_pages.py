"""What counts as a command of a page, and what the real command line refuses."""

from pathlib import Path

import pytest

from tests.commands.pages import UsageError, examples, is_complete, mentions, options, parse, starts

PAGE = """# A page

<!-- commands: scans dive.bag -->
<!-- not run: sonarmap record: needs a sonar -->

Give `sonarmap inspect scans/` first; `sonarmap map` wants `-o OUT`, and `sonarmap map scans/ ... --loops 2` tries some.

```sh
sonarmap record -o dive.sonar
sonarmap map scans/ -o map/ \\
    --grid 64    # a comment
# nothing

sonarmap inspect scans/
```

```python
print(1)
```

```text
sonarmap nonsense
```
"""


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "page.md"
    path.write_text(PAGE)
    return path


def test_commands_come_in_their_order(page: Path) -> None:
    found = [(" ".join(example.text.split()), example.inline, example.not_run) for example in examples(page)]
    assert found == [
        ("sonarmap inspect scans/", True, ""),
        ("sonarmap record -o dive.sonar", False, "needs a sonar"),
        ("sonarmap map scans/ -o map/ --grid 64", False, ""),
        ("sonarmap inspect scans/", False, ""),
        ("print(1)", False, ""),
    ]
    assert [example.language for example in examples(page)] == ["sh"] * 4 + ["python"]


def test_what_sentences_name_is_seen(page: Path) -> None:
    assert starts(page) == ["scans", "dive.bag"]
    assert mentions(page) == ["sonarmap inspect scans/", "sonarmap map", "sonarmap map scans/ ... --loops 2"]
    assert options(page) == {"-o"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sonarmap mapp scans/", "no verb 'mapp'"),
        ("sonarmap map scans/ -o map/ --grids 64", "--grids"),
        ("sonarmap map scans/", "--out"),
        ("SONARMAP_FLAVOR=gpu sonarmap devices --tests", "--tests"),
    ],
)
def test_the_real_command_line_refuses_what_is_wrong(text: str, words: str) -> None:
    with pytest.raises(UsageError) as error:
        parse(text)
    assert words in f"{error.value} {getattr(error.value, 'format_message', str)()}"
    assert not is_complete(text)


def test_placeholders_are_not_run() -> None:
    assert is_complete("sonarmap map scans/ -o map/")
    assert not is_complete("sonarmap map SCANS -o map/")
