"""What typer refuses on the command line, in the words and the look of the command's other errors."""

import re
from typing import Any

import typer

UsageError: Any = typer.BadParameter.__base__  # of all that typer refuses; it has no public name

# what is said of a value -> what to give instead
_WANTED = (
    (re.compile(r"Input should be a valid integer.*"), "give a whole number"),
    (re.compile(r"Input should be a valid number.*"), "give a number"),
    (re.compile(r"Input should be greater than or equal to (\S+)"), r"give \1 or more"),
    (re.compile(r"Input should be less than or equal to (\S+)"), r"give \1 or less"),
)
_NO_VERB = re.compile(r"No such command '(.*?)'\.?")
_MEANT = re.compile(r"Did you mean (.*)\?")
_NO_VALUE = re.compile(r"Option '?(\S+?)'? requires an argument\.?")
_A_VALUE = re.compile(r"Option '?(\S+?)'? does not take a value\.?")
_EXTRA = re.compile(r"Got unexpected extra argument\(?s?\)? \((.*)\)", re.DOTALL)


def usage_words(error: Any) -> str:
    """What was given, what was wanted and what to do, of a `UsageError`."""
    call = error.ctx.command_path if error.ctx is not None else "sonarmap"
    everything = f"`{call} --help-all` lists all options." if " " in call else f"`{call} --help` lists them."
    match type(error).__name__:
        case "NoSuchOption":
            meant = f"; did you mean {' or '.join(sorted(error.possibilities))}?" if error.possibilities else "."
            return f"{call} has no option {error.option_name}{meant} {everything}"
        case "MissingParameter":
            wanted = (error.param.help or "").partition(". ")[0].rstrip(".").replace("\\[", "[")
            return f"{_name(error.param)} is missing: {wanted}. `{call} --help` shows how it is called."
        case "BadParameter":
            return _refused(error)
    return _other(error.format_message(), call)


def _refused(error: Any) -> str:
    """Of a value that an option cannot have."""
    message = error.message
    for pattern, wanted in _WANTED:
        if match := pattern.fullmatch(message):
            given = getattr(error.__cause__, "errors", list)()
            value = repr(given[0]["input"]) if given else "the value"
            message = f"{value}; {match.expand(wanted)}"
    name = _name(error.param) if error.param is not None else ""
    return message if not name or message.startswith(name) else f"{name}: {message}"


def _other(message: str, call: str) -> str:
    if match := _NO_VERB.match(message):
        meant = _MEANT.search(message)
        verb = f"; did you mean {meant[1]}?" if meant else "."
        return f"there is no verb '{match[1]}'{verb} `{call} --help` lists them."
    if match := _NO_VALUE.fullmatch(message):
        return f"{match[1]} needs a value after it; give one, or leave {match[1]} out."
    if match := _A_VALUE.fullmatch(message):
        return f"{match[1]} takes no value; leave out what stands after it."
    if match := _EXTRA.fullmatch(message):
        return f"{match[1]} is too much; `{call} --help` shows how it is called."
    return message


def _name(parameter: Any) -> str:
    """As the help calls it: "--out", "INPUT..."."""
    names = [name for name in parameter.opts if name.startswith("-")]
    return max(names, key=len) if names else parameter.metavar or str(parameter.name).upper()
