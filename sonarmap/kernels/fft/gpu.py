"""Emit the Fourier transform for a graphics processor: one work-group per 8 lines, in local memory.

Each axis has a kernel. A work-group loads 8 lines into local memory in digit-reversed order, computes the stages in
place, with barriers between them, and stores the lines. Neighboring work-items access neighboring memory. They need
different twiddle factors, which are in global memory, since constant memory serves different addresses one after the
other. An inverse transform is a forward one with real and imaginary parts exchanged.
"""

from dataclasses import dataclass
from math import prod

import numpy as np

from sonarmap.kernels.fft.edges import Layout, Pass, Plan, radices
from sonarmap.kernels.fft.stage import half_turns, stage, twiddles, untangle

_BARRIER = "barrier(CLK_LOCAL_MEM_FENCE);"


@dataclass(frozen=True, slots=True)
class _Axis:
    """An axis other than the last: its kernel, points per column, number of work-groups, and the distances from one set
    of adjacent columns to the next (outer) and from one element of a column to the next (stride) [floats]."""

    name: str
    points: int
    groups: int
    outer: int
    stride: int


def emit(layout: Layout, inverse: bool) -> Plan:
    """Program and launches of a transform; see `Plan`."""
    n0, n1, _ = layout.shape
    points, pitch, blocks = layout.row_points, 2 * layout.pitch, layout.column_blocks
    axes = [_Axis("columns_1", n1, n0 * blocks, n1 * pitch, pitch)]
    if not layout.batched:
        axes.append(_Axis("columns_0", n0, n1 * blocks, pitch, n1 * pitch))
    turns = {"half_turn": half_turns(points, layout.row_scale(inverse), inverse)}
    for n in sorted({points, *(axis.points for axis in axes)}):
        turns |= twiddles(n)
    first = np.cumsum([0, *(values.size for values in turns.values())])
    offsets = dict(zip(turns, first.tolist(), strict=False))
    parts = [_rows(layout, offsets, inverse)]
    passes = [Pass("rows", -(-n0 * n1 // 8), group_size(points))]
    for axis in axes:
        parts.append(_columns(layout, offsets, axis, inverse))
        passes.append(Pass(axis.name, axis.groups, group_size(axis.points)))
    table = np.concatenate([*turns.values()])
    return Plan("\n".join(parts), tuple(reversed(passes) if inverse else passes), table)


def group_size(n: int) -> int:
    """Work-items of a group that transforms lines of n points: whole warps of 32, 256 at most."""
    return min(256, -(-n // 32) * 32)


def _kernel(name: str, n: int, offsets: dict[str, int], body: list[str]) -> str:
    """A kernel with these statements, which declares the tables that they use; `item` is the work-item's number."""
    text = "\n    ".join(body)
    tables = [
        f"__global const float* const {table} = tables + {first};" for table, first in offsets.items() if table in text
    ]
    declared = "\n    ".join(tables)
    return f"""
__kernel __attribute__((reqd_work_group_size({group_size(n)}, 1, 1)))
void {name}(__global float* volume, __global float* spectrum, const ulong volume_at, const ulong spectrum_at,
            __global const float* const restrict tables) {{
    volume += volume_at;
    spectrum += spectrum_at;
    __local float re[{8 * n}], im[{8 * n}];
    const int item = get_local_id(0);
    const size_t group = get_group_id(0);
    {declared}
    {text}
}}"""


def _each(n: int, count: int, body: list[str]) -> list[str]:
    """A loop over `t` < `count` that is shared by the work-items of a group, and the barrier after it."""
    return [
        f"for (int t = item; t < {count}; t += {group_size(n)}) {{",
        *(f"    {line}" for line in body),
        "}",
        _BARRIER,
    ]


def _stages(n: int) -> list[str]:
    lines: list[str] = []
    for index, radix in enumerate(radices(n)):
        before = prod(radices(n)[:index])
        body = stage(n, index, "float", _get, _put)
        head = [
            f"const int line = t & 7, k = (t >> 3) % {before};",
            f"const int at = (t >> 3) / {before} * {before * radix} + k;",
        ]
        lines += _each(n, 8 * n // radix, head + body)
    return lines


def _get(q: int, at: str) -> str:
    return f"x{q}r = re[8 * ({at}) + line]; x{q}i = im[8 * ({at}) + line];"


def _put(q: int, at: str) -> str:
    return f"re[8 * ({at}) + line] = y{q}r; im[8 * ({at}) + line] = y{q}i;"


def _parts(inverse: bool) -> tuple[str, str]:
    return ("im", "re") if inverse else ("re", "im")


def _position(n: int, index: str) -> str:
    """The expression of element `index`'s position in the digit-reversed order of an edge."""
    terms: list[str] = []
    weight, below = n, 1
    for radix in reversed(radices(n)):
        weight //= radix
        terms.append(f"({index}) / {below} % {radix} * {weight}")
        below *= radix
    return " + ".join(terms)


def _columns(layout: Layout, offsets: dict[str, int], axis: _Axis, inverse: bool) -> str:
    """The kernel of an axis; `offsets` are those of the tables."""
    re, im = _parts(inverse)
    blocks, n = layout.column_blocks, axis.points
    where = "const int line = t & 7, k = t >> 3;"
    load = [
        f"{where} const int at = 8 * ({_position(n, 'k')}) + line;",
        f"const float2 z = vload2(0, p + k * {axis.stride} + 2 * line);",
        f"{re}[at] = z.x; {im}[at] = z.y;",
    ]
    store = [f"{where} vstore2((float2)({re}[t], {im}[t]), 0, p + k * {axis.stride} + 2 * line);"]
    first = f"__global float* p = spectrum + group / {blocks} * {axis.outer} + group % {blocks} * 16;"
    return _kernel(axis.name, n, offsets, [first, *_each(n, 8 * n, load), *_stages(n), *_each(n, 8 * n, store)])


def _rows(layout: Layout, offsets: dict[str, int], inverse: bool) -> str:
    """The kernel of the last axis: packed real rows and their half spectra. The last group's rows may overlap the
    previous ones."""
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    re, im = _parts(inverse)
    rows, pairs = layout.shape[0] * layout.shape[1], n // 2 + 1
    row = f"const int line = t / {n}, k = t % {n}; __global float* v = rows + line * {length};"
    pair = f"const int line = t / {pairs}, k = t % {pairs}; __global float* p = spectra + line * {pitch};"
    load, store = _spectra_to_rows(n, re, im) if inverse else _rows_to_spectra(n, re, im)
    loops = [
        *_each(n, 8 * (pairs if inverse else n), [pair if inverse else row, *load]),
        *_stages(n),
        *_each(n, 8 * (n if inverse else pairs), [row if inverse else pair, *store]),
    ]
    at = "8 * group" if rows % 8 == 0 else f"min(8 * group, (size_t){rows - 8})"
    first = f"const size_t first = {at};"
    first += f" __global float *rows = volume + first * {length}, *spectra = spectrum + first * {pitch};"
    kernel = _kernel("rows", n, offsets, [first, *loops])
    return untangle(layout.row_scale(inverse), "float") + kernel


def _rows_to_spectra(n: int, re: str, im: str) -> tuple[list[str], list[str]]:
    """Statements that load point k of a packed row v, and store numbers k and n - k of its half spectrum p."""
    load = [
        f"const int at = 8 * ({_position(n, 'k')}) + line;",
        "const float2 z = vload2(k, v);",
        f"{re}[at] = z.x; {im}[at] = z.y;",
    ]
    store = [
        f"const int at = 8 * k + line, mirror = k == 0 ? line : 8 * ({n} - k) + line;",
        f"float ar = {re}[at], ai = {im}[at], br = {re}[mirror], bi = {im}[mirror];",
        "untangle(&ar, &ai, &br, &bi, half_turn[2 * k], half_turn[2 * k + 1]);",
        f"vstore2((float2)(ar, ai), k, p); vstore2((float2)(br, bi), {n} - k, p);",
    ]
    return load, store


def _spectra_to_rows(n: int, re: str, im: str) -> tuple[list[str], list[str]]:
    """Statements that load numbers k and n - k of a half spectrum p, and store point k of its packed row v."""
    load = [
        f"float2 a = vload2(k, p), b = vload2({n} - k, p);",
        "if (k == 0) a.y = b.y = 0.0f;  // a real row has none there",
        "float ar = a.x, ai = a.y, br = b.x, bi = b.y;",
        "untangle(&ar, &ai, &br, &bi, half_turn[2 * k], half_turn[2 * k + 1]);",
        f"const int m = ({n} - k) % {n}, at = 8 * ({_position(n, 'k')}) + line;",
        f"const int mirror = 8 * ({_position(n, 'm')}) + line;",
        f"{re}[at] = ar; {im}[at] = ai;",
        f"if (m != k) {{ {re}[mirror] = br; {im}[mirror] = bi; }}",
    ]
    store = [f"vstore2((float2)({re}[8 * k + line], {im}[8 * k + line]), k, v);"]
    return load, store
