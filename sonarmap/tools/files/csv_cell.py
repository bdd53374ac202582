"""A text in a cell of a CSV file that spreadsheets show and never run, and back.

A spreadsheet takes a cell that begins with =, +, - or @ for a formula, whoever named the scan. Such a text has an
apostrophe before it in our files, which says "text" to a spreadsheet's user, and which our readers take off again.
"""

import re

# Japanese spreadsheets take the wide forms for the same
_FORMULA = re.compile("'*[=+\\-@\uff1d\uff0b\uff0d\uff20]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]")


def cell_of(text: str) -> str:
    """The cell of a text; a number stays as it is. `text_of` gives `plain_text` of it again."""
    text = plain_text(text)
    return f"'{text}" if _FORMULA.match(text) and not _is_number(text) else text


def text_of(cell: str) -> str:
    """The text of a cell."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def plain_text(text: str) -> str:
    """A text as a cell can have it: on one line, without blanks around it, and what is no UTF-8 as its number."""
    return _CONTROL.sub(" ", text).encode("utf-8", "backslashreplace").decode().strip()


def _is_number(text: str) -> bool:
    try:
        return "_" not in text and float(text) is not None
    except ValueError:
        return False
