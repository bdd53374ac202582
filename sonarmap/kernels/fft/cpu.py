"""Emit the Fourier transform for a processor: one work-item per plane, 8 or 16 lanes in explicit vectors.

A work-item takes 8 lines at a time as real and imaginary `float8` in private arrays, which stay in the cache.
The last two axes of a plane are one kernel, so that the second finds the plane in the second-level cache; the
first axis is another, which takes 16 lines as `float16` where the processor has such registers. Columns read and
write memory in their first and last stage; rows are transposed in registers. An inverse transform is a forward one
with real and imaginary parts exchanged.
"""

import numpy as np

from sonarmap.kernels.device.source import literal
from sonarmap.kernels.fft.edges import Layout, Pass, Plan, radices
from sonarmap.kernels.fft.stage import KEEP, Edges, block, half_turns, positions, private_stages, twiddles, untangle

KERNEL = "__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void"
_ARGUMENTS = "__global float* volume, __global float* spectrum, const ulong volume_at, const ulong spectrum_at"
# Rows of the second axis in a sheet, of which 8 columns each are transformed at once along the first axis: the first of
# these numbers that divides the second axis, for 16 lanes, for 8, and for 8 with a short first axis.
_ROWS_OF_16 = (8, 6, 10, 4)
_ROWS_OF_8 = (8, 6, 5, 4)
_SHORT_ROWS_OF_8 = (4, 6, 5)


def emit(layout: Layout, inverse: bool, lanes: int = 8) -> Plan:
    """Program and launches of a transform; `lanes`, 8 or 16, is the vector width along the first axis."""
    n0, n1, _ = layout.shape
    parts = ['#include "device/complex.cl"', *tables(layout, inverse)]
    parts.append(columns("columns_1", 2 * layout.pitch, Edges(n1, 1), inverse))
    parts.append(real_rows(layout, inverse))
    parts.append(_planes(layout, inverse))
    passes = [Pass("planes", n0)]
    if not layout.batched:
        # The elements of a column of the first axis are often a power of two apart and then share one set of the
        # first-level cache. Neighboring columns together use several sets, which is up to 3 times faster.
        choices = _ROWS_OF_16 if lanes == 16 else _ROWS_OF_8 if n0 > 128 else _SHORT_ROWS_OF_8
        rows = next(count for count in choices if n1 % count == 0)
        edges, floats = Edges(n0, rows * 8 // lanes, f"float{lanes}"), 2 * layout.pitch * rows
        parts.append(columns("columns_0", 2 * n1 * layout.pitch, edges, inverse))
        # a work-item per `rows` rows of the second axis, neighbors in memory
        parts.append(f"""
{KERNEL} sheets({_ARGUMENTS}) {{
    spectrum += spectrum_at + get_global_id(0) * {floats};
    {KEEP} for (int i = 0; i < {floats}; i += {16 * rows}) columns_0(spectrum + i);
}}""")
        passes.insert(0 if inverse else 1, Pass("sheets", n1 // rows))
    return Plan("\n".join(parts), tuple(passes))


def tables(layout: Layout, inverse: bool) -> list[str]:
    """Declarations of the constant tables that the functions read."""
    n0, n1, _ = layout.shape
    edges = sorted({layout.row_points, n1, *(() if layout.batched else (n0,))})
    turns = {"half_turn": half_turns(layout.row_points, layout.row_scale(inverse), inverse)}
    for n in edges:
        turns |= twiddles(n)
    tables = [_constant("float", name, values) for name, values in turns.items()]
    return tables + [_constant("ushort", f"position_{n}", positions(n)) for n in edges]


def _constant(kind: str, name: str, values: np.ndarray) -> str:
    return f"__constant {kind} {name}[{values.size}] = {{{', '.join(map(literal, values))}}};"


def _planes(layout: Layout, inverse: bool) -> str:
    """The kernel of the last two axes: a work-item per plane."""
    _, n1, n2 = layout.shape
    # if n1 is no multiple of 8, the last 8 rows overlap the previous ones and are computed twice
    first = "i" if n1 % 8 == 0 else f"min(i, {n1 - 8})"
    row = f"rows(volume + row * {n2}, spectrum + row * {2 * layout.pitch})"
    rows = f"for (int i = 0; i < {n1}; i += 8) {{ const int row = {first}; {row}; }}"
    columns = f"for (int i = 0; i < {16 * layout.column_blocks}; i += 16) columns_1(spectrum + i);"
    loops = [columns, rows] if inverse else [rows, columns]
    return f"""
{KERNEL} planes({_ARGUMENTS}) {{
    volume += volume_at + get_global_id(0) * {n1 * n2};
    spectrum += spectrum_at + get_global_id(0) * {2 * n1 * layout.pitch};
    {KEEP} {loops[0]}
    {KEEP} {loops[1]}
}}"""


def columns(name: str, stride: int, edges: Edges, inverse: bool) -> str:
    """The function that transforms `edges.wide` vectors of adjacent columns in place; stride is in floats."""
    first, lanes = radices(edges.n)[0], int(edges.vector.removeprefix("float"))
    re, im = ("i", "r") if inverse else ("r", "i")

    def load(q: int, _: str) -> str:
        at = f"p + (k + {q * edges.n // first}) * {stride} + i * {2 * lanes}"
        return f"load_columns{lanes}({at}, &x{q}{re}, &x{q}{im});"

    store = f"store_columns{lanes}(p + f * {stride} + i * {2 * lanes}, yQ{re}, yQ{im});"
    return f"""
static inline void {name}(__global float* p) {{
    {edges.vector} re[{edges.wide * edges.n}], im[{edges.wide * edges.n}];
    {edges.first(load)}
    {edges.middle()}
    {edges.last(store)}
}}"""


def real_rows(layout: Layout, inverse: bool, maxima: bool = False) -> str:
    """The function that transforms 8 real rows: dense floats to half a spectrum, or back.

    It needs the tables position_<M> and half_turn. With `maxima`, an inverse takes two more arguments: the array for
    the maxima of the 8 rows, and the largest cyclic distance from column 0 of the numbers that count.
    """
    scale = layout.row_scale(inverse)
    rows = _spectra_to_rows(layout, scale, maxima) if inverse else _rows_to_spectra(layout)
    return "\n".join([untangle(scale, "float8"), rows])


def _rows_to_spectra(layout: Layout) -> str:
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    last = min(n, layout.pitch - 4)  # so that its tile stays within the row
    # columns must not compute with uninitialized memory
    padding = f"for (int i = 0; i < 8; ++i) vstore8((float8)(0.0f), 0, spectrum + i * {pitch} + {pitch - 8});"
    return f"""
static inline void rows(__global const float* volume, __global float* spectrum) {{
    float8 re[{n}], im[{n}], a[8], b[8];
    {KEEP} for (int i = 0; i < {n}; i += 4) {{
        {_tile("i", n)}
        load_rows(volume + 2 * k, {length}, a);
        {_tile_to_arrays(n, "re", "im", "a", [f"k + {j}" for j in range(4)])}
    }}
    {private_stages(n, 0, len(radices(n)))}
    {_single_number(0, "re[0] + im[0]")}  // of this tile and the next all but 0 and M is overwritten below
    store_rows(spectrum, {pitch}, a);
    {_single_number(n - last, "re[0] - im[0]")}
    store_rows(spectrum + {2 * last}, {pitch}, a);
    {padding if n + 4 < layout.pitch else ""}
    {KEEP} for (int k = 1; k <= {n // 2}; k += 4) {{
        const int mirror = {n - 3} - k;
        {_arrays_to_tile("k", "re", "im", "a")}
        {_arrays_to_tile("mirror", "re", "im", "b")}
        {_untangle_tiles()}
        store_rows(spectrum + 2 * k, {pitch}, a);
        store_rows(spectrum + 2 * mirror, {pitch}, b);
    }}
}}"""


def _spectra_to_rows(layout: Layout, scale: float, maxima: bool) -> str:
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    last = min(n, layout.pitch - 4)
    tops, reduce = (", __global float* tops, const int reach", _row_maxima(n)) if maxima else ("", "")
    return f"""
static inline void rows(__global float* volume, __global const float* spectrum{tops}) {{
    float8 re[{n}], im[{n}], a[8], b[8];
    load_rows(spectrum, {pitch}, a);
    load_rows(spectrum + {2 * last}, {pitch}, b);
    im[0] = (a[0] + b[{2 * (n - last)}]) * {literal(0.5 * scale)};
    re[0] = (a[0] - b[{2 * (n - last)}]) * {literal(0.5 * scale)};
    {KEEP} for (int k = 1; k <= {n // 2}; k += 4) {{
        const int mirror = {n - 3} - k;
        load_rows(spectrum + 2 * k, {pitch}, a);
        load_rows(spectrum + 2 * mirror, {pitch}, b);
        {_untangle_tiles()}
        {_tile_to_arrays(n, "im", "re", "a", [f"k + {j}" for j in range(4)])}
        {_tile_to_arrays(n, "im", "re", "b", [f"mirror + {j}" for j in range(4)])}
    }}
    {private_stages(n, 0, len(radices(n)))}
    {reduce}
    {KEEP} for (int i = 0; i < {n}; i += 4) {{
        {_tile("i", n)}
        {_arrays_to_tile("k", "im", "re", "a")}
        store_rows(volume + 2 * k, {length}, a);
    }}
}}"""


def _row_maxima(n: int) -> str:
    """Statements that store the maxima of 8 rows of 2 n numbers, the even ones in im, the odd ones in re."""
    return f"""float8 top = -INFINITY;
    {KEEP} for (int k = 0; k < {n}; ++k) {{
        if (2 * k <= reach || 2 * k >= {2 * n} - reach) top = max(top, im[k]);
        if (2 * k + 1 <= reach || 2 * k + 1 >= {2 * n} - reach) top = max(top, re[k]);
    }}
    vstore8(top, 0, tops);"""


def _single_number(place: int, value: str) -> str:
    """Statements that set a tile to zeros and one real number."""
    return " ".join(f"a[{j}] = {value if j == 2 * place else '0.0f'};" for j in range(8))


def _tile(begin: str, n: int) -> str:
    """The declaration of k, the first number of a tile of 4."""
    return f"const int k = {begin if n % 4 == 0 else f'min({begin}, {n - 4})'};"


def _untangle_tiles() -> str:
    """Statements that untangle the 4 numbers from k on, in a, and their mirror images, in b in reverse order."""
    return block(
        [
            f"untangle(a + {2 * j}, a + {2 * j + 1}, b + {6 - 2 * j}, b + {7 - 2 * j},"
            f" half_turn[2 * k + {2 * j}], half_turn[2 * k + {2 * j + 1}]);"
            for j in range(4)
        ]
    )


def _tile_to_arrays(n: int, re: str, im: str, tile: str, numbers: list[str]) -> str:
    """Statements that store a tile's numbers in digit-reversed order."""
    lines: list[str] = []
    for j, number in enumerate(numbers):
        at = f"position_{n}[{number}]"
        lines.append(f"{re}[{at}] = {tile}[{2 * j}]; {im}[{at}] = {tile}[{2 * j + 1}];")
    return block(lines)


def _arrays_to_tile(at: str, re: str, im: str, tile: str) -> str:
    return block([f"{tile}[{2 * j}] = {re}[{at} + {j}]; {tile}[{2 * j + 1}] = {im}[{at} + {j}];" for j in range(4)])
