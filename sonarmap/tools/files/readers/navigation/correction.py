"""Corrections of measured poses, as in --correct-priors heading_deg=90-heading_deg,x_m=y_m,y_m=x_m."""

import re
from dataclasses import dataclass
from typing import Self

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.readers.instruments import COLUMNS, prior_of, sigmas_of, values_of

_NUMBER = r"\d+(?:\.\d*)?|\.\d+"
_TERM = re.compile(rf"(\w+)=([+-]?(?:{_NUMBER})(?=[+-]))?([+-]?)(?:({_NUMBER})\*)?([a-z]\w*)")


@dataclass(frozen=True, slots=True)
class Correction:
    """Each measured value becomes offset + factor * a value, its own or another's."""

    sources: np.ndarray  # (6,) int, which value of COLUMNS each comes from
    factors: np.ndarray  # (6,)
    offsets: np.ndarray  # (6,) [deg, m]

    @classmethod
    def of(cls, text: str) -> Self:
        """Parse terms separated by commas. A column without a term is unchanged."""
        made = cls(np.arange(6), np.ones(6), np.zeros(6))
        for term in text.replace(" ", "").split(","):
            match = _TERM.fullmatch(term)
            if match is None or not {match[1], match[5]} <= set(COLUMNS):
                raise InputError(
                    f"--correct-priors is {text!r}; wanted corrections as heading_deg=-heading_deg, "
                    f"heading_deg=90+heading_deg or x_m=0.3048*x_m, of {', '.join(COLUMNS)}"
                )
            column = COLUMNS.index(match[1])
            made.sources[column] = COLUMNS.index(match[5])
            made.factors[column] = (-1 if match[3] == "-" else 1) * float(match[4] or 1)
            made.offsets[column] = float(match[2] or 0)
        return made

    def __str__(self) -> str:
        terms = list[str]()
        for column, source, factor, offset in zip(COLUMNS, self.sources, self.factors, self.offsets, strict=True):
            sign = "-" if factor < 0 else "+" if offset else ""
            times = "" if abs(factor) == 1 else f"{abs(factor):.9g}*"
            if (term := f"{f'{offset:.9g}' if offset else ''}{sign}{times}{COLUMNS[source]}") != column:
                terms.append(f"{column}={term}")
        return ",".join(terms)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Values (n, 6) in the order of COLUMNS, corrected; NaN where not measured."""
        return self.offsets + self.factors * values[:, self.sources]

    def after(self, first: "Correction") -> "Correction":
        """One correction for both."""
        factors, offsets = self.factors * first.factors[self.sources], self(first.offsets[None])[0]
        return Correction(first.sources[self.sources], factors, offsets)

    def of_prior(self, prior: PosePrior) -> PosePrior:
        """The prior with corrected values. Standard deviations stay those of their columns, and where a column has
        none, its source's count."""
        sigmas = sigmas_of(prior)
        values = np.where(np.isfinite(sigmas), values_of(prior.T_world_sensor), np.nan)
        own = np.where(np.isfinite(sigmas), sigmas, np.abs(self.factors) * sigmas[self.sources])
        return prior_of(self(values[None])[0], own)
