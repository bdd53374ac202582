# pyright: strict
"""Write the stages of a Fourier transform as OpenCL C.

An edge of N = r1 r2 ... points is transformed by decimation in time: its elements are put in the
digit-reversed order of `scatter`, stage s turns every group of r_s transforms of r1..r_{s-1} points into one
of r1..r_s, in place, and the spectrum comes out in its natural order. Cooley and Tukey,
doi:10.1090/S0025-5718-1965-0178586-1.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import prod

import numpy as np

from kernels.device.source import literal
from kernels.fft.plan import RADICES

KEEP = "__attribute__((opencl_unroll_hint(1)))"  # an unrolled stage does not fit the instruction cache

Access = Callable[[int, str], str]


@dataclass(slots=True)
class Butterfly:
    """Writes a small transform as straight-line code; values are pairs of expressions, (real, imaginary)."""

    scalar: str
    lines: list[str] = field(default_factory=list[str])

    def let(self, real: str, imag: str) -> tuple[str, str]:
        """Name a complex value."""
        name = f"v{len(self.lines)}"
        self.lines.append(f"const {self.scalar} {name}r = {real}, {name}i = {imag};")
        return f"{name}r", f"{name}i"

    def add(self, a: tuple[str, str], b: tuple[str, str]) -> tuple[str, str]:
        """Name the sum a + b."""
        return self.let(f"{a[0]} + {b[0]}", f"{a[1]} + {b[1]}")

    def subtract(self, a: tuple[str, str], b: tuple[str, str]) -> tuple[str, str]:
        """Name the difference a - b."""
        return self.let(f"{a[0]} - {b[0]}", f"{a[1]} - {b[1]}")

    def multiply(self, a: tuple[str, str], w: tuple[str, str]) -> tuple[str, str]:
        """Name the complex product a w."""
        return self.let(f"{a[0]} * {w[0]} - {a[1]} * {w[1]}", f"{a[0]} * {w[1]} + {a[1]} * {w[0]}")

    def rotate(self, a: tuple[str, str], k: int, n: int) -> tuple[str, str]:
        """Multiply by exp(-2 pi i k / n)."""
        eighth = 8 * k / n
        half = literal(np.sqrt(0.5))
        if eighth == 0:
            return a
        if eighth == 1:
            return self.let(f"({a[0]} + {a[1]}) * {half}", f"({a[1]} - {a[0]}) * {half}")
        if eighth == 2:
            return self.let(a[1], f"-{a[0]}")
        if eighth == 3:
            return self.let(f"({a[1]} - {a[0]}) * {half}", f"({a[0]} + {a[1]}) * -{half}")
        angle = -2 * np.pi * k / n
        return self.multiply(a, (literal(np.cos(angle)), literal(np.sin(angle))))

    def transform(self, x: list[tuple[str, str]]) -> list[tuple[str, str]]:
        """The transform of 2, 4, 8 or 16 values, in natural order."""
        n = len(x)
        if n == 2:
            return [self.add(*x), self.subtract(*x)]
        if n == 4:
            even, odd = self.transform(x[0::2]), self.transform(x[1::2])
            (ar, ai), (br, bi) = even[1], odd[1]
            second, fourth = (
                self.let(f"{ar} + {bi}", f"{ai} - {br}"),
                self.let(f"{ar} - {bi}", f"{ai} + {br}"),
            )
            return [self.add(even[0], odd[0]), second, self.subtract(even[0], odd[0]), fourth]
        outer, inner = n // 4, 4
        partial = [self.transform(x[j::inner]) for j in range(inner)]
        result = [("", "")] * n
        for p in range(outer):
            result[p::outer] = self.transform([self.rotate(partial[j][p], j * p, n) for j in range(inner)])
        return result


def stage(n: int, index: int, scalar: str, load: Access, store: Access) -> list[str]:
    """The body of the loop over the groups of one stage.

    The loop declares `at`, the position of the group's first element, and from the second stage on `k`, the
    frequency that this element has in its transform of the stage before.

    Args:
        n: points of the edge.
        index: which of its stages.
        scalar: "float" or "float8", the type of a real part.
        load: the statement that sets x<q>r and x<q>i to element q, given q and its position, an expression.
        store: the statement that stores y<q>r and y<q>i.
    """
    radix, before = RADICES[n][index], prod(RADICES[n][:index])
    butterfly = Butterfly(scalar)
    x = [(f"x{q}r", f"x{q}i") for q in range(radix)]
    lines = [f"{scalar} {', '.join(f'{re}, {im}' for re, im in x)};"]
    lines += [load(q, f"at + {q * before}") for q in range(radix)]
    if before > 1:
        for q in range(1, radix):
            entry = [f"twiddle_{n}_{index}[k * {2 * radix - 2} + {2 * q - 2 + part}]" for part in (0, 1)]
            x[q] = butterfly.multiply(x[q], (entry[0], entry[1]))
    y = butterfly.transform(x)
    lines += butterfly.lines
    lines += [f"const {scalar} y{p}r = {re}, y{p}i = {im};" for p, (re, im) in enumerate(y)]
    return lines + [store(p, f"at + {p * before}") for p in range(radix)]


def private_stages(n: int, begin: int, end: int, wide: int = 1) -> str:
    """Stages of `wide` edges, one behind the other in the private arrays re and im, eight lanes each."""
    lines: list[str] = []
    for index in range(begin, end):
        radix, before = RADICES[n][index], prod(RADICES[n][:index])
        lines += [
            f"{KEEP} for (int group = 0; group < {wide * n}; group += {before * radix}) {{",
            f"    {KEEP} for (int k = 0; k < {before}; ++k) {{",
            "        const int at = group + k;",
            f"        {block(stage(n, index, 'float8', from_private, to_private))}",
            "    }",
            "}",
        ]
    return "\n    ".join(lines)


def from_private(q: int, at: str) -> str:
    """Load element q of a stage from the private arrays."""
    return f"x{q}r = re[{at}]; x{q}i = im[{at}];"


def to_private(q: int, at: str) -> str:
    """Store element q of a stage to the private arrays."""
    return f"re[{at}] = y{q}r; im[{at}] = y{q}i;"


def block(lines: list[str]) -> str:
    """Statements of an indented block."""
    return "\n        ".join(lines)


def twiddles(n: int) -> str:
    """The tables of an edge's stages: exp(-2 pi i k q / L), k < L / r, 0 < q < r, L the length it makes."""
    tables: list[str] = []
    for index in range(1, len(RADICES[n])):
        radix, before = RADICES[n][index], prod(RADICES[n][:index])
        turns = np.outer(np.arange(before), np.arange(1, radix)) / (before * radix)
        tables.append(constants(f"twiddle_{n}_{index}", np.exp(-2j * np.pi * turns)))
    return "\n".join(tables)


def constants(name: str, values: np.ndarray) -> str:
    """A constant table of complex numbers, interleaved."""
    flat = np.stack([np.real(values), np.imag(values)], axis=-1).ravel()
    return f"__constant float {name}[{flat.size}] = {{{', '.join(map(literal, flat))}}};"


def scatter(n: int, index: str) -> str:
    """The expression of the position that element `index` of an edge takes before the first stage."""
    terms: list[str] = []
    weight, shift = n, 0
    for radix in reversed(RADICES[n]):
        weight //= radix
        terms.append(f"(({index}) >> {shift} & {radix - 1}) * {weight}")
        shift += radix.bit_length() - 1
    return " + ".join(terms)


def untangle(points: int, scale: float, inverse: bool, scalar: str) -> str:
    """The function that turns a packed row's spectrum Z into a real row's X, or X into Z, and its table.

    A real row x is transformed as z[j] = x[2 j] + i x[2 j + 1], of M = `points`. With
    E = Z[k] + conj(Z[M - k]) and D = Z[k] - conj(Z[M - k]): X[k] = E / 2 + v D and
    X[M - k] = conj(E / 2 - v D), where v = -i / 2 exp(-pi i k / M), k <= M / 2. The way back has the same
    form, with v = i / 2 exp(pi i k / M).

    The function replaces the numbers at k, its first two arguments, and at M - k, the next two, by what
    becomes of them, times `scale`.
    """
    turn = np.exp(-1j * np.pi * np.arange(points // 2 + 1) / points) * -0.5j * scale
    return f"""{constants("half_turn", turn.conj() if inverse else turn)}
static inline void untangle({scalar}* ar, {scalar}* ai, {scalar}* br, {scalar}* bi, const int k) {{
    const float vr = half_turn[2 * k], vi = half_turn[2 * k + 1];
    const {scalar} er = (*ar + *br) * {literal(0.5 * scale)}, ei = (*ai - *bi) * {literal(0.5 * scale)};
    const {scalar} dr = *ar - *br, di = *ai + *bi;
    const {scalar} tr = vr * dr - vi * di, ti = vr * di + vi * dr;
    *ar = er + tr;
    *ai = ei + ti;
    *br = er - tr;
    *bi = ti - ei;
}}"""
