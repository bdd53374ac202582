"""A section as Markdown, and the claims and verdicts in its first table."""

import re
from dataclasses import dataclass

from sonarmap.tools.lab.reproduce.experiment import Section
from sonarmap.tools.lab.reproduce.table import Table


@dataclass(frozen=True, slots=True)
class Verdict:
    """One claim: the paper's value or the other methods', ours, and the verdict or what follows."""

    claim: str
    paper: str
    ours: str
    verdict: str


def verdicts(section: Section) -> tuple[Verdict, ...]:
    """The rows of the section's first table.

    It has columns whose headings begin with paper or others, with ours, and with verdict or what follows; the cells
    left of them name the claim. A section without a table has no claims.

    Raises:
        ValueError: the table lacks one of these columns.
    """
    if not section.tables:
        return ()
    table = section.tables[0]
    columns = [_column(table, word) for word in ("paper|others", "ours", "verdict|what follows")]
    before = min(columns)
    return tuple(
        Verdict(", ".join(cell for cell in row[:before] if cell), *(row[k] for k in columns)) for row in table.rows
    )


def section_text(section: Section, level: int, pictures: str = "") -> str:
    """Markdown of a section, without its times.

    Args:
        section: its title, text, tables and pictures.
        level: of its heading, 1 for a page of its own.
        pictures: what to put before the pictures' file names, as in "reproduction/".
    """
    parts = [
        f"{'#' * level} {section.title}",
        section.introduction.strip(),
        *(table.markdown().strip() for table in section.tables),
        *(f"![{caption}]({pictures}{name})\n\n*{caption}*" for name, caption in section.pictures.items()),
        section.remarks.strip(),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def duration(seconds: float) -> str:
    """As in "41 s", "12 min" or "3 h 05 min"."""
    minutes = round(seconds / 60)
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def _column(table: Table, word: str) -> int:
    """The first column whose heading begins with the word, whatever follows it, as in "ours, worst series"."""
    columns = [k for k, heading in enumerate(table.headings) if re.match(rf"({word})\b", heading)]
    if not columns:
        raise ValueError(f"no heading of {table.title!r} begins with the word {word!r}: {table.headings}")
    return columns[0]
