"""Emit the Fourier transform for a processor: one work-item per plane or row, 8 lanes in explicit vectors.

A work-item takes 8 lines at a time as real and imaginary `float8` in private arrays, which stay in the cache.
The last two axes of a plane are one kernel, so that the second finds the plane in the second-level cache; the
first axis is another. Columns read and write memory in their first and last stage; rows are transposed in
registers.
An inverse transform is a forward one between real and imaginary parts that change places.
"""

from kernels.fft_plan import RADICES, Layout, Pass, Plan, literal, scatter, stage, twiddles, untangle

_KERNEL = "__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void"
_KEEP = "__attribute__((opencl_unroll_hint(1)))"  # an unrolled stage does not fit the instruction cache


def emit(layout: Layout, inverse: bool) -> Plan:
    """The program of a transform and its launches; see `Plan`."""
    n0, n1, _ = layout.shape
    edges = {layout.row_points, n1} | (set() if layout.batched else {n0})
    parts = ['#include "complex.cl"', *(twiddles(n) for n in sorted(edges))]
    parts.append(_columns("columns_1", n1, 2 * layout.pitch, inverse))
    parts.append(_real_rows(layout, inverse) if layout.real else _complex_rows(layout, inverse))
    parts.append(_planes(layout, inverse))
    passes = [Pass("planes", n0)]
    if not layout.batched:
        parts += [_columns("columns_0", n0, 2 * n1 * layout.pitch, inverse), _sheets(layout)]
        passes.insert(0 if inverse else 1, Pass("sheets", n1))
    return Plan("\n".join(parts), tuple(passes))


def _arguments(layout: Layout) -> str:
    return "__global float* volume, __global float* spectrum" if layout.real else "__global float* spectrum"


def _planes(layout: Layout, inverse: bool) -> str:
    """The kernel of the last two axes: a work-item per plane."""
    _, n1, n2 = layout.shape
    row = f"spectrum + row * {2 * layout.pitch}"
    rows = f"rows(volume + row * {n2}, {row})" if layout.real else f"rows({row})"
    rows = f"for (int row = 0; row < {n1}; row += 8) {rows};"
    columns = (
        f"for (int block = 0; block < {layout.column_blocks}; ++block) columns_1(spectrum + 16 * block);"
    )
    loops = [columns, rows] if inverse else [rows, columns]
    volume = f"volume += get_global_id(0) * {n1 * n2};" if layout.real else ""
    return f"""
{_KERNEL} planes({_arguments(layout)}) {{
    {volume}
    spectrum += get_global_id(0) * {2 * n1 * layout.pitch};
    {_KEEP} {loops[0]}
    {_KEEP} {loops[1]}
}}"""


def _sheets(layout: Layout) -> str:
    """The kernel of the first axis: a work-item per row of the second, whose columns are neighbors."""
    return f"""
{_KERNEL} sheets({_arguments(layout)}) {{
    spectrum += get_global_id(0) * {2 * layout.pitch};
    {_KEEP} for (int block = 0; block < {layout.column_blocks}; ++block) columns_0(spectrum + 16 * block);
}}"""


def _columns(name: str, n: int, stride: int, inverse: bool) -> str:
    """The function that transforms 8 adjacent columns in place; stride is in floats."""
    first, last = RADICES[n][0], RADICES[n][-1]
    re, im = ("i", "r") if inverse else ("r", "i")

    def load(q: int, _: str) -> str:
        return f"load_columns(p + (k + {q * n // first}) * {stride}, &x{q}{re}, &x{q}{im});"

    def store(q: int, _: str) -> str:
        return f"store_columns(p + (k + {q * n // last}) * {stride}, y{q}{re}, y{q}{im});"

    return f"""
inline void {name}(__global float* p) {{
    float8 re[{n}], im[{n}];
    {_KEEP} for (int k = 0; k < {n // first}; ++k) {{
        const int at = {scatter(n, "k")};
        {_block(stage(n, 0, "float8", load, _put))}
    }}
    {_inner_stages(n, 1, len(RADICES[n]) - 1)}
    {_KEEP} for (int k = 0; k < {n // last}; ++k) {{
        const int at = k;
        {_block(stage(n, len(RADICES[n]) - 1, "float8", _get, store))}
    }}
}}"""


def _real_rows(layout: Layout, inverse: bool) -> str:
    """The function that transforms 8 real rows: dense floats to half a spectrum, or back."""
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    scale = 2 / layout.points if inverse else 1.0  # a packed row has half the points of its real one
    common = f"{_position(n)}\n{untangle(n, scale, inverse, 'float8')}\n"
    if inverse:
        return (
            common
            + f"""
inline void rows(__global float* volume, __global const float* spectrum) {{
    float8 re[{n}], im[{n}], a[8], b[8];
    load_rows(spectrum + {n}, {pitch}, a);
    im[position({n // 2})] = a[0] * {literal(scale)};
    re[position({n // 2})] = a[1] * {literal(-scale)};
    {_KEEP} for (int k = 0; k < {n // 2}; k += 4) {{
        load_rows(spectrum + 2 * k, {pitch}, a);
        load_rows(spectrum + {2 * n - 6} - 2 * k, {pitch}, b);
        if (k == 0) a[1] = b[7] = 0.0f;  // a real row has none there
        {_untangle_tiles()}
        const int at = position(k), before = position({n - 4} - k), mirror = position({n} - k);
        {_tile_to_arrays("at", n, "im", "re", "a")}
        im[mirror] = b[6];
        re[mirror] = b[7];
        {_tile_to_arrays("before", n, "im", "re", "b", shift=1)}
    }}
    {_inner_stages(n, 0, len(RADICES[n]))}
    {_KEEP} for (int k = 0; k < {n}; k += 4) {{
        {_arrays_to_tile("k", "im", "re")}
        store_rows(volume + 2 * k, {length}, a);
    }}
}}"""
        )
    return (
        common
        + f"""
inline void rows(__global const float* volume, __global float* spectrum) {{
    float8 re[{n}], im[{n}], a[8], b[8];
    {_KEEP} for (int k = 0; k < {n}; k += 4) {{
        load_rows(volume + 2 * k, {length}, a);
        const int at = position(k);
        {_tile_to_arrays("at", n, "re", "im", "a")}
    }}
    {_inner_stages(n, 0, len(RADICES[n]))}
    a[0] = re[{n // 2}];
    a[1] = -im[{n // 2}];
    a[2] = a[3] = a[4] = a[5] = a[6] = a[7] = 0.0f;
    store_rows(spectrum + {n}, {pitch}, a);  // all but its first column is overwritten below
    {_KEEP} for (int k = 0; k < {n // 2}; k += 4) {{
        const int mirror = ({n} - k) & {n - 1}, before = {n - 4} - k;
        {_arrays_to_tile("k", "re", "im")}
        b[6] = re[mirror];
        b[7] = im[mirror];
        b[4] = re[before + 3];
        b[5] = im[before + 3];
        b[2] = re[before + 2];
        b[3] = im[before + 2];
        b[0] = re[before + 1];
        b[1] = im[before + 1];
        {_untangle_tiles()}
        store_rows(spectrum + 2 * k, {pitch}, a);
        store_rows(spectrum + {2 * n - 6} - 2 * k, {pitch}, b);
    }}
    for (int i = 0; i < 8; ++i) {{  // the padding, so that no column works on what memory happens to hold
        vstore8((float8)(0.0f), 0, spectrum + i * {pitch} + {2 * n + 2});
        vstore8((float8)(0.0f), 0, spectrum + i * {pitch} + {2 * n + 8});
    }}
}}"""
    )


def _complex_rows(layout: Layout, inverse: bool) -> str:
    """The function that transforms 8 complex rows in place."""
    n, pitch = layout.row_points, 2 * layout.pitch
    re, im = ("im", "re") if inverse else ("re", "im")
    scale = f" * {literal(1 / layout.points)}" if inverse else ""
    return f"""
{_position(n)}
inline void rows(__global float* spectrum) {{
    float8 re[{n}], im[{n}], a[8];
    {_KEEP} for (int k = 0; k < {n}; k += 4) {{
        load_rows(spectrum + 2 * k, {pitch}, a);
        const int at = position(k);
        {_tile_to_arrays("at", n, re, im, "a")}
    }}
    {_inner_stages(n, 0, len(RADICES[n]))}
    {_KEEP} for (int k = 0; k < {n}; k += 4) {{
        {_arrays_to_tile("k", re, im, scale)}
        store_rows(spectrum + 2 * k, {pitch}, a);
    }}
}}"""


def _untangle_tiles() -> str:
    """Untangle 4 numbers from k on, in a, with their 4 mirror images, in b from the last to the first."""
    return _block(
        [
            f"untangle(a + {2 * j}, a + {2 * j + 1}, b + {6 - 2 * j}, b + {7 - 2 * j}, k + {j});"
            for j in range(4)
        ]
    )


def _tile_to_arrays(at: str, n: int, re: str, im: str, tile: str, shift: int = 0) -> str:
    """Put consecutive numbers in the digit-reversed order; the first has the position `at`, less `shift`."""
    step = n // RADICES[n][-1]
    lines = []
    for j in range(4 - shift):
        to = f"{at} + {(j + shift) * step}"
        lines.append(f"{re}[{to}] = {tile}[{2 * j}]; {im}[{to}] = {tile}[{2 * j + 1}];")
    return _block(lines)


def _arrays_to_tile(at: str, re: str, im: str, scale: str = "") -> str:
    return _block(
        [f"a[{2 * j}] = {re}[{at} + {j}]{scale}; a[{2 * j + 1}] = {im}[{at} + {j}]{scale};" for j in range(4)]
    )


def _position(n: int) -> str:
    return f"inline int position(const int i) {{ return {scatter(n, 'i')}; }}"


def _inner_stages(n: int, begin: int, end: int) -> str:
    """Stages of an edge within the private arrays."""
    lines = []
    for index in range(begin, end):
        radix, before = RADICES[n][index], 1
        for earlier in RADICES[n][:index]:
            before *= earlier
        lines += [
            f"{_KEEP} for (int block = 0; block < {n}; block += {before * radix}) {{",
            f"    {_KEEP} for (int k = 0; k < {before}; ++k) {{",
            "        const int at = block + k;",
            f"        {_block(stage(n, index, 'float8', _get, _put))}",
            "    }",
            "}",
        ]
    return "\n    ".join(lines)


def _get(q: int, at: str) -> str:
    return f"x{q}r = re[{at}]; x{q}i = im[{at}];"


def _put(q: int, at: str) -> str:
    return f"re[{at}] = y{q}r; im[{at}] = y{q}i;"


def _block(lines: list[str]) -> str:
    return "\n        ".join(lines)
