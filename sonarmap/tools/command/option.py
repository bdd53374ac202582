"""Declarations of options: a `Panel` makes each, as the default of a parameter or of a dataclass's field.

Dataclasses hold options that several verbs share; `spread` replaces them by their fields, as typer needs it.
"""

import functools
import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, cast, get_origin

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import as_options

MOST_WORKERS = 1024  # more processes than any machine has use for
MOST = 1_000_000  # largest count that an option accepts; every file format and library can hold it

# Names for --priors of `simulate`.
INSTRUMENTS = ("attitude", "heading", "depth", "position")

REQUIRED: Any = MISSING  # the default of a mandatory option
_OPTION = "option"  # key in a field's metadata


def _named(text: str) -> Path:
    """Path of an output. An empty name, as from an unset variable, is refused: it would be the current folder."""
    if not str(text):
        raise typer.BadParameter("is empty; give a name, or . for the current folder")
    return Path(text)


@dataclass(frozen=True, slots=True)
class Panel:
    """A panel of the help, which declares options. `words` is an option's help, `names` are its names if they differ
    from the parameter's; `rare` options are shown only by --help-all. `more` is passed to typer.Option: min, max,
    and `callback`, which returns the value or raises typer.BadParameter."""

    title: str

    def value(self, metavar: str, words: str, *names: str, rare: bool = False, **more: Any) -> Any:
        """An option with a value, for use in `Annotated`; the help shows `metavar` for the value."""
        if "--out" in names or metavar == "DIR":
            more["parser"] = _named
        return typer.Option(*names, metavar=metavar, help=words, rich_help_panel=self.title, hidden=rare, **more)

    def switch(self, names: str, words: str, rare: bool = False) -> Any:
        """An option without a value, for use in `Annotated`; `names` as in "--quiet -q" or "--report/--no-report"."""
        return typer.Option(*names.split(), help=words, rich_help_panel=self.title, hidden=rare)

    def option(
        self, metavar: str, words: str, default: Any = None, *names: str, shown: str | bool = True, **more: Any
    ) -> Any:
        """A default that declares an option with a value; REQUIRED makes the option mandatory. `shown` is the
        default in words, for the help, if that is not the value."""
        metadata = {_OPTION: self.value(metavar, words, *names, show_default=shown, **more)}
        if isinstance(default, list):
            return field(default_factory=lambda: list[Any](default), metadata=metadata)
        return field(default=default, metadata=metadata)

    def flag(self, names: str, words: str, default: bool | None = False, rare: bool = False) -> Any:
        """A default that declares an option without a value."""
        return field(default=default, metadata={_OPTION: self.switch(names, words, rare)})

    def length(self, words: str, without: str, *, shown: str | bool | None = None, **more: Any) -> Any:
        """A default that declares an option with a length above 0 [m]. The help shows `without`, the length used if the
        option is left out, or `shown`."""
        wanted = "{} m; give a length above 0, or leave it out" + (f" for {without}" if without else "")
        shown = without if shown is None else shown
        return self.option("M", words, callback=checked(is_positive, wanted), shown=shown, **more)

    def choice(self, words: str, names: Iterable[str], metavar: str = "NAME", **more: Any) -> Any:
        """A default that declares an option with one of several names, by default the first."""
        names = tuple(names)
        wanted = f"{{!r}}; choose one of {', '.join(names)}, or leave it out for {names[0]}"
        check = checked(names.__contains__, wanted)
        return self.option(metavar, words, names[0], callback=check, **more)


INPUT = Panel("Input")
NAVIGATION = Panel("Navigation")
SCENE = Panel("Scene")
NOISE = Panel("Noise")
REGISTRATION = Panel("Registration")
EXPERIMENT = Panel("Experiment")
OPTIMIZATION = Panel("Optimization")
MEASUREMENT = Panel("Measurement")
LOOPS = Panel("Loops and motion")
EARTH = Panel("Place on the Earth")
OUTPUT = Panel("Output")
RUNNING = Panel("Running")


def given(options: Any) -> dict[str, Any]:
    """The options that were given, by name, with values for summary.json: paths as text, a list of one value as the
    value."""
    is_mapping = isinstance(options, Mapping)
    values = options if is_mapping else {each.name: getattr(options, each.name) for each in fields(options)}
    return {name: _held(value) for name, value in values.items() if value is not None and value != []}


def _held(value: Any) -> Any:
    if isinstance(value, list):
        held = [_held(each) for each in cast("list[Any]", value)]
        return held[0] if len(held) == 1 else held
    return str(value) if isinstance(value, Path) else value


def refuse_without(needed: str, options: Mapping[str, Any]) -> None:
    """Refuse `options` that were given, by their names with dashes; they need the option `needed`, which was not."""
    for name, value in options.items():
        if value is not None:
            raise InputError(f"{name} has no effect without {needed}; give it too, or leave it out")


def spread(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command as typer takes it: each dataclass of options is replaced by its fields."""
    signature = inspect.signature(command, eval_str=True)
    kinds: dict[str, Any] = {
        name: each.annotation for name, each in signature.parameters.items() if is_dataclass(each.annotation)
    }

    @functools.wraps(command)
    def flat(**values: Any) -> Any:
        made = {name: kind(**{each.name: values[each.name] for each in _options(kind)}) for name, kind in kinds.items()}
        return command(**{name: made[name] if name in made else values[name] for name in signature.parameters})

    parameters: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        if isinstance(parameter.default, Field):
            declared: Any = parameter.default
            option_of_it = Annotated[parameter.annotation, declared.metadata[_OPTION]]
            parameters.append(_parameter(name, option_of_it, _default(declared)))
        elif name in kinds:
            parameters += [_parameter(each.name, *_declared(each)) for each in _options(kinds[name])]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    setattr(flat, "__signature__", signature.replace(parameters=parameters))  # noqa: B010
    flat.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return flat


def _options(kind: Any) -> list[Any]:
    """The fields of a dataclass that are options."""
    return [each for each in fields(kind) if _OPTION in each.metadata or get_origin(each.type) is Annotated]


def _declared(each: Any) -> tuple[Any, Any]:
    """A field's annotation with its option, and its default."""
    info = each.metadata.get(_OPTION)
    return each.type if info is None else Annotated[each.type, info], _default(each)


def _default(each: Any) -> Any:
    return each.default if each.default_factory is MISSING else each.default_factory()


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    default = inspect.Parameter.empty if default is REQUIRED else default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def checked(fits: Callable[[Any], bool], wanted: str) -> Callable[[Any], Any]:
    """A callback that accepts None and values that pass `fits`; `wanted` is its message, with {} for the value."""

    def check(value: Any) -> Any:
        if value is None or fits(value):
            return value
        raise typer.BadParameter(wanted.format(value))

    return check


def refused_by(parse: Callable[[Any], object]) -> Callable[[Any], Any]:
    """A callback that accepts None and values that `parse` accepts; its message is that of the InputError."""

    def check(value: Any) -> Any:
        try:
            if value is not None:
                parse(value)
        except InputError as error:
            raise typer.BadParameter(as_options(str(error))) from error
        return value

    return check


def is_positive(number: float) -> bool:
    """Whether it is finite and above 0."""
    return 0 < number < math.inf


DeviceOption = Annotated[
    str | None,
    RUNNING.value(
        "DEVICE",
        "OpenCL device: cpu, gpu, a part of its name, or platform:device as `sonarmap devices` lists them.",
        "--device",
    ),
]
JsonOption = Annotated[bool, RUNNING.switch("--json", "Print the result as JSON, without progress.")]
QuietOption = Annotated[bool, RUNNING.switch("--quiet -q", "Print nothing but warnings and errors.")]
