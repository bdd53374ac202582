"""Ties: a person's verdicts on pairs of scans, which override the survey's own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Literal, get_args

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration

Verdict = Literal["accept", "reject", "add"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
# A person's verdict on a pair: "given" is "add" with a transform, which no registration replaces; "" is none.
ByHand = Literal["", "accept", "reject", "add", "given"]


@dataclass(frozen=True, slots=True)
class Tie:
    """A person's verdict on two scans.

    Attributes:
        i, j: target and source, i < j, as of a `Pair`.
        verdict: "reject": the pair is never an edge; "accept": its registration is an edge whatever other pairs show;
            "add": the same, and the pair is registered if the search did not propose it.
        given: T_i_j as a person measured it, which replaces a registration; only with "add".
        note: why, in the person's words.
    """

    i: int
    j: int
    verdict: Verdict
    given: Registration | None = None
    note: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.verdict, str) or self.verdict not in VERDICTS:
            raise InputError(f"the verdict of a tie is {self.verdict!r}; wanted one of {', '.join(VERDICTS)}")
        if not all(isinstance(k, Integral) for k in self.scans) or not 0 <= self.i < self.j:
            raise InputError(f"a tie names scans {self.i} and {self.j}; wanted two different ones, the lower first")
        if not isinstance(self.given, Registration | None):
            raise InputError(f"the transform of a tie is {self.given!r}; wanted a Registration")
        if self.given is not None and self.verdict != "add":
            raise InputError(f"a tie with a transform has the verdict {self.verdict}; only add takes a transform")

    def renumbered(self, number: Mapping[int, int], names: Sequence[str]) -> "Tie":
        """The tie with its scans counted among the key scans."""
        for k in self.scans:
            if k not in number:
                near = names[min(number, key=lambda key: abs(key - k))]
                raise InputError(
                    f"{names[k]} is not a key scan of this dense stream: it is placed between its neighbors, no pair "
                    f"of it is registered. Tie {near} instead, or choose other key scans (the setting keys.step)"
                )
        return replace(self, i=number[self.i], j=number[self.j])

    @property
    def scans(self) -> tuple[int, int]:
        return self.i, self.j

    @property
    def by_hand(self) -> ByHand:
        return self.verdict if self.given is None else "given"
