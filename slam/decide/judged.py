"""A possible answer beside what speaks for it, and whether that is enough."""

from dataclasses import dataclass
from math import log

from slam.decide.consistency import Support
from slam.decide.hypothesis import Hypothesis

Key = tuple[int, int]  # the scans of a pair

# Scans at most this far apart in a chain may show that one of its registrations is wrong.
_BLAME = 5
# Weights, as a hypothesis has them: of one as probable as one of three, and of pairs all wrong once in twenty times.
_LIKELY, _SURE = -log(2 / 3), -log(0.05)


@dataclass(frozen=True, slots=True)
class Judged:
    """A hypothesis and what speaks for it."""

    hypothesis: Hypothesis
    support: Support

    @property
    def joins(self) -> bool:
        """Whether it may join two parts: at least two pairs say so, or one that is believed, of scans close in time."""
        one, support = self.hypothesis, self.support
        borne_out = support.pairs >= 2 and support.weight >= _SURE
        return support.leading and (borne_out or (one.accepted and one.near))

    @property
    def fits(self) -> bool:
        """Whether it may stand beside the chain that it is part of.

        What agrees with the chain may; what the registration was not sure of has to be among the likely,
        and needs other pairs besides: the chain holds without it. What
        contradicts the chain needs others that say the same, and scans so close in time that few registrations of the
        chain can be to blame: then the graph decides between them. Farther away it is more likely that a place looks
        like another, which several pairs can be wrong about alike.
        """
        one, support = self.hypothesis, self.support
        if support.agrees:
            likely = one.weight >= _LIKELY and support.leading and support.pairs >= 2
            return one.accepted or likely
        return one.accepted and support.pairs >= 2 and one.j - one.i <= _BLAME
