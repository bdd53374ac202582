# pyright: strict
"""Emit the Fourier transform for a processor: one work-item per plane, 8 lanes in explicit vectors.

A work-item takes 8 lines at a time as real and imaginary `float8` in private arrays, which stay in the cache.
The last two axes of a plane are one kernel, so that the second finds the plane in the second-level cache; the
first axis is another. Columns read and write memory in their first and last stage; rows are transposed in
registers. An inverse transform is a forward one between real and imaginary parts that change places.
"""

from kernels.fft.cpu_rows import real_rows
from kernels.fft.plan import RADICES, Layout, Pass, Plan
from kernels.fft.stage import KEEP, block, from_private, private_stages, scatter, stage, to_private, twiddles

KERNEL = "__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void"
_ARGUMENTS = "__global float* volume, __global float* spectrum"


def emit(layout: Layout, inverse: bool) -> Plan:
    """The program of a transform and its launches; see `Plan`."""
    n0, n1, _ = layout.shape
    edges = {layout.row_points, n1, *(() if layout.batched else (n0,))}
    parts = ['#include "device/complex.cl"', *(twiddles(n) for n in sorted(edges))]
    parts.append(columns("columns_1", n1, 2 * layout.pitch, 1, inverse))
    parts.append(real_rows(layout, inverse))
    parts.append(_planes(layout, inverse))
    passes = [Pass("planes", n0)]
    if not layout.batched:
        # The elements of a column of the first axis are a power of two apart, so all of them meet in one set
        # of the first-level cache. Several neighbors at once spread over several sets: up to 3 times faster.
        wide = 4 if n0 <= 128 else 8
        parts.append(columns("columns_0", n0, 2 * n1 * layout.pitch, wide, inverse))
        parts.append(_sheets(layout, wide))
        passes.insert(0 if inverse else 1, Pass("sheets", n1 // wide))
    return Plan("\n".join(parts), tuple(passes))


def _planes(layout: Layout, inverse: bool) -> str:
    """The kernel of the last two axes: a work-item per plane."""
    _, n1, n2 = layout.shape
    row = f"rows(volume + row * {n2}, spectrum + row * {2 * layout.pitch})"
    rows = f"for (int row = 0; row < {n1}; row += 8) {row};"
    columns = f"for (int i = 0; i < {16 * layout.column_blocks}; i += 16) columns_1(spectrum + i);"
    loops = [columns, rows] if inverse else [rows, columns]
    return f"""
{KERNEL} planes({_ARGUMENTS}) {{
    volume += get_global_id(0) * {n1 * n2};
    spectrum += get_global_id(0) * {2 * n1 * layout.pitch};
    {KEEP} {loops[0]}
    {KEEP} {loops[1]}
}}"""


def _sheets(layout: Layout, wide: int) -> str:
    """The kernel of the first axis: a work-item per `wide` rows of the second, neighbors in memory."""
    floats = 2 * layout.pitch * wide
    return f"""
{KERNEL} sheets({_ARGUMENTS}) {{
    spectrum += get_global_id(0) * {floats};
    {KEEP} for (int i = 0; i < {floats}; i += {16 * wide}) columns_0(spectrum + i);
}}"""


def columns(name: str, n: int, stride: int, wide: int, inverse: bool) -> str:
    """The function that transforms `wide` times 8 adjacent columns in place; stride is in floats."""
    first, last = RADICES[n][0], RADICES[n][-1]
    re, im = ("i", "r") if inverse else ("r", "i")

    def load(q: int, _: str) -> str:
        return f"load_columns(p + (k + {q * n // first}) * {stride} + i * 16, &x{q}{re}, &x{q}{im});"

    def store(q: int, _: str) -> str:
        return f"store_columns(p + (k + {q * n // last}) * {stride} + i * 16, y{q}{re}, y{q}{im});"

    return f"""
static inline void {name}(__global float* p) {{
    float8 re[{wide * n}], im[{wide * n}];
    {KEEP} for (int k = 0; k < {n // first}; ++k) {{
        {KEEP} for (int i = 0; i < {wide}; ++i) {{
            const int at = i * {n} + {scatter(n, "k")};
            {block(stage(n, 0, "float8", load, to_private))}
        }}
    }}
    {private_stages(n, 1, len(RADICES[n]) - 1, wide)}
    {KEEP} for (int k = 0; k < {n // last}; ++k) {{
        {KEEP} for (int i = 0; i < {wide}; ++i) {{
            const int at = i * {n} + k;
            {block(stage(n, len(RADICES[n]) - 1, "float8", from_private, store))}
        }}
    }}
}}"""
