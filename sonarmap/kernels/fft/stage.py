"""Write the stages of a Fourier transform as OpenCL C.

An edge of N = r1 r2 ... points is transformed by decimation in time: its elements are put in the
digit-reversed order of `positions`, stage s turns every group of r_s transforms of r1..r_{s-1} points into one
of r1..r_s, in place, and the spectrum comes out in its natural order. Cooley and Tukey,
doi:10.1090/S0025-5718-1965-0178586-1.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import gcd, prod

import numpy as np

from sonarmap.kernels.device.source import literal
from sonarmap.kernels.fft.edges import radices

Value = tuple[str, str]  # expressions of the real and the imaginary part


@dataclass(slots=True)
class Butterfly:
    """Writes a small transform as straight-line code; values are pairs of expressions, (real, imaginary)."""

    scalar: str
    lines: list[str] = field(default_factory=list[str])

    def let(self, real: str, imag: str) -> Value:
        name = f"v{len(self.lines)}"
        self.lines.append(f"const {self.scalar} {name}r = {real}, {name}i = {imag};")
        return f"{name}r", f"{name}i"

    def add(self, a: Value, b: Value) -> Value:
        return self.let(f"{a[0]} + {b[0]}", f"{a[1]} + {b[1]}")

    def subtract(self, a: Value, b: Value) -> Value:
        return self.let(f"{a[0]} - {b[0]}", f"{a[1]} - {b[1]}")

    def multiply(self, a: Value, w: Value) -> Value:
        return self.let(f"{a[0]} * {w[0]} - {a[1]} * {w[1]}", f"{a[0]} * {w[1]} + {a[1]} * {w[0]}")

    def rotate(self, a: Value, k: int, n: int) -> Value:
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

    def turned(self, a: Value, b: Value) -> tuple[Value, Value]:
        """The values a - i b and a + i b."""
        (ar, ai), (br, bi) = a, b
        return self.let(f"{ar} + {bi}", f"{ai} - {br}"), self.let(f"{ar} - {bi}", f"{ai} + {br}")

    def weighted(self, values: list[Value], weights: list[float], first: Value | None = None) -> Value:
        """The sum of values times real weights, plus `first`."""
        parts: list[str] = []
        for part in (0, 1):
            terms = [f"{value[part]} * {literal(weight)}" for value, weight in zip(values, weights, strict=True)]
            parts.append(" + ".join(terms if first is None else [first[part], *terms]))
        return self.let(parts[0], parts[1])

    def transform(self, x: list[Value]) -> list[Value]:
        """The transform of n values, n a product of 2, 3 and 5, in natural order."""
        n = len(x)
        if n == 1:
            return x
        if n <= 5:
            return {2: self._two, 3: self._three, 4: self._four, 5: self._five}[n](x)
        inner = 4 if n % 4 == 0 else max(factor for factor in (2, 3, 5) if n % factor == 0)
        outer = n // inner
        if gcd(inner, outer) == 1:
            return self._coprime(x, inner, outer)
        partial = [self.transform(x[j::inner]) for j in range(inner)]
        result = [("", "")] * n
        for p in range(outer):
            result[p::outer] = self.transform([self.rotate(partial[j][p], j * p, n) for j in range(inner)])
        return result

    def _coprime(self, x: list[Value], a: int, b: int) -> list[Value]:
        """The transform of a b values, a and b coprime, without twiddle factors (Good,
        doi:10.1111/j.2517-6161.1958.tb00300.x)."""
        rows = [self.transform([x[(b * i + a * j) % (a * b)] for i in range(a)]) for j in range(b)]
        columns = [self.transform([row[k] for row in rows]) for k in range(a)]
        return [columns[k % a][k % b] for k in range(a * b)]

    def _two(self, x: list[Value]) -> list[Value]:
        return [self.add(*x), self.subtract(*x)]

    def _three(self, x: list[Value]) -> list[Value]:
        total = self.add(x[1], x[2])
        middle = self.weighted([total], [-0.5], x[0])
        return [self.add(x[0], total), *self.turned(middle, self.weighted([self.subtract(x[1], x[2])], [_sine(3)]))]

    def _four(self, x: list[Value]) -> list[Value]:
        even, odd = self._two(x[0::2]), self._two(x[1::2])
        second, fourth = self.turned(even[1], odd[1])
        return [self.add(even[0], odd[0]), second, self.subtract(even[0], odd[0]), fourth]

    def _five(self, x: list[Value]) -> list[Value]:
        sums = [self.add(x[1], x[4]), self.add(x[2], x[3])]
        differences = [self.subtract(x[1], x[4]), self.subtract(x[2], x[3])]
        cosines, sines = [_cosine(5), _cosine(5, 2)], [_sine(5), _sine(5, 2)]
        first = self.weighted(sums, cosines, x[0]), self.weighted(differences, sines)
        second = self.weighted(sums, cosines[::-1], x[0]), self.weighted(differences, [sines[1], -sines[0]])
        (one, four), (two, three) = self.turned(*first), self.turned(*second)
        return [self.add(self.add(x[0], sums[0]), sums[1]), one, two, three, four]


def _cosine(n: int, k: int = 1) -> float:
    return float(np.cos(2 * np.pi * k / n))


def _sine(n: int, k: int = 1) -> float:
    return float(np.sin(2 * np.pi * k / n))


KEEP = "__attribute__((opencl_unroll_hint(1)))"  # an unrolled stage does not fit the instruction cache

Access = Callable[[int, str], str]


def stage(n: int, index: int, scalar: str, load: Access, store: Access) -> list[str]:
    """The body of the loop over the groups of one stage of an edge of n points.

    The loop declares `at`, the position of the group's first element, and from the second stage on `k`, the frequency
    of this element in its transform of the previous stage. Given q and a position, `load` returns the statement that
    sets x<q>r and x<q>i, and `store` the one that stores y<q>r and y<q>i. `scalar` is the type of a real part.
    """
    radix, before = radices(n)[index], prod(radices(n)[:index])
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


def private_stages(n: int, begin: int, end: int, wide: int = 1, vector: str = "float8") -> str:
    """Stages of `wide` edges, which are stored one after the other in private arrays re and im of a vector type."""
    lines: list[str] = []
    for index in range(begin, end):
        radix, before = radices(n)[index], prod(radices(n)[:index])
        lines += [
            f"{KEEP} for (int group = 0; group < {wide * n}; group += {before * radix}) {{",
            f"    {KEEP} for (int k = 0; k < {before}; ++k) {{",
            "        const int at = group + k;",
            f"        {block(stage(n, index, vector, from_private, to_private))}",
            "    }",
            "}",
        ]
    return "\n    ".join(lines)


@dataclass(frozen=True, slots=True)
class Edges:
    """`wide` edges of n points, stored one after the other in private arrays re and im of a vector type."""

    n: int
    wide: int
    vector: str = "float8"

    def first(self, load: Access) -> str:
        """The first stage, which stores what it loads in digit-reversed order; `load` as in `stage`."""
        return self.loop(0, f"position_{self.n}[k]", load, to_private)

    def last(self, store: str, before: str = "", after: str = "") -> str:
        """The last stage; `store` is the statement that stores number f of the spectrum, with Q for q."""

        def stored(q: int, _: str) -> str:
            f = q * self.n // radices(self.n)[-1]
            return f"{{ const int f = k + {f}; {store.replace('Q', str(q))} }}"

        return self.loop(len(radices(self.n)) - 1, "k", from_private, stored, before, after)

    def middle(self) -> str:
        return private_stages(self.n, 1, len(radices(self.n)) - 1, self.wide, self.vector)

    def loop(self, index: int, at: str, load: Access, store: Access, before: str = "", after: str = "") -> str:
        """One stage over the groups k and the edges i; `before` and `after` are statements around each."""
        return f"""{KEEP} for (int k = 0; k < {self.n // radices(self.n)[index]}; ++k) {{
        {KEEP} for (int i = 0; i < {self.wide}; ++i) {{
            const int at = i * {self.n} + {at};
            {before}
            {block(stage(self.n, index, self.vector, load, store))}
            {after}
        }}
    }}"""


def from_private(q: int, at: str) -> str:
    return f"x{q}r = re[{at}]; x{q}i = im[{at}];"


def to_private(q: int, at: str) -> str:
    return f"re[{at}] = y{q}r; im[{at}] = y{q}i;"


def block(lines: list[str]) -> str:
    return "\n        ".join(lines)


def twiddles(n: int) -> dict[str, np.ndarray]:
    """Twiddle factors per stage: exp(-2 pi i k q / L), k < L / r, 0 < q < r, with radix r and L points afterwards."""
    tables: dict[str, np.ndarray] = {}
    for index in range(1, len(radices(n))):
        radix, before = radices(n)[index], prod(radices(n)[:index])
        turns = np.outer(np.arange(before), np.arange(1, radix)) / (before * radix)
        tables[f"twiddle_{n}_{index}"] = interleaved(np.exp(-2j * np.pi * turns))
    return tables


def interleaved(values: np.ndarray) -> np.ndarray:
    return np.stack([np.real(values), np.imag(values)], axis=-1).astype(np.float32).ravel()


def positions(n: int) -> np.ndarray:
    """(n,) int64: the position of each element of an edge in digit-reversed order."""
    remaining, weight, result = np.arange(n), n, np.zeros(n, np.int64)
    for radix in reversed(radices(n)):
        weight //= radix
        result += remaining % radix * weight
        remaining //= radix
    return result


def half_turns(points: int, scale: float, inverse: bool) -> np.ndarray:
    """The table of `untangle`: v times `scale`, for k up to M / 2 and 3 beyond, where the last tile ends."""
    turn = np.exp(-1j * np.pi * np.arange(points // 2 + 4) / points) * -0.5j * scale
    return interleaved(turn.conj() if inverse else turn)


def untangle(scale: float, scalar: str) -> str:
    """The function that turns a packed row's spectrum Z into a real row's X, or X into Z.

    A real row x is transformed as z[j] = x[2 j] + i x[2 j + 1], of M points. With
    E = Z[k] + conj(Z[M - k]) and D = Z[k] - conj(Z[M - k]): X[k] = E / 2 + v D and
    X[M - k] = conj(E / 2 - v D), where v = -i / 2 exp(-pi i k / M), k <= M / 2. The inverse has the same
    form, with v = i / 2 exp(pi i k / M).

    The function replaces the numbers at k (its first two arguments) and at M - k (the next two) by the
    results times `scale`; v (the last two) is from `half_turns`, which has scaled it.
    """
    return f"""
static inline void untangle({scalar}* ar, {scalar}* ai, {scalar}* br, {scalar}* bi, const float vr, const float vi) {{
    const {scalar} er = (*ar + *br) * {literal(0.5 * scale)}, ei = (*ai - *bi) * {literal(0.5 * scale)};
    const {scalar} dr = *ar - *br, di = *ai + *bi;
    const {scalar} tr = vr * dr - vi * di, ti = vr * di + vi * dr;
    *ar = er + tr;
    *ai = ei + ti;
    *br = er - tr;
    *bi = ti - ei;
}}"""
