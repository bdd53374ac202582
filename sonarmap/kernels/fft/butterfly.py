"""Write small Fourier transforms as straight-line OpenCL C: the butterflies of a stage."""

from dataclasses import dataclass, field
from math import gcd

import numpy as np

from sonarmap.kernels.device.source import literal

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
        """Name a - i b and a + i b."""
        (ar, ai), (br, bi) = a, b
        return self.let(f"{ar} + {bi}", f"{ai} - {br}"), self.let(f"{ar} - {bi}", f"{ai} + {br}")

    def weighted(self, values: list[Value], weights: list[float], first: Value | None = None) -> Value:
        """Name the sum of values times real weights, added to a first one."""
        parts: list[str] = []
        for part in (0, 1):
            terms = [f"{value[part]} * {literal(weight)}" for value, weight in zip(values, weights, strict=True)]
            parts.append(" + ".join(terms if first is None else [first[part], *terms]))
        return self.let(parts[0], parts[1])

    def transform(self, x: list[Value]) -> list[Value]:
        """The transform of as many values as a product of 2, 3 and 5, in natural order."""
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
