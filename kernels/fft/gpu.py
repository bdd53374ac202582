# pyright: strict
"""Emit the Fourier transform for a graphics processor: one work-group per 8 lines, in local memory.

Every axis is a kernel. A work-group brings 8 lines into local memory in their digit-reversed order, does the
stages in place, a barrier between them, and writes the lines back. Neighbors in a group touch neighbors in
memory.
An inverse transform is a forward one between real and imaginary parts that change places.
"""

from math import prod

from kernels.fft.plan import RADICES, Layout, Pass, Plan
from kernels.fft.stage import scatter, stage, twiddles, untangle

_BARRIER = "barrier(CLK_LOCAL_MEM_FENCE);"


def emit(layout: Layout, inverse: bool) -> Plan:
    """The program of a transform and its launches; see `Plan`."""
    n0, n1, _ = layout.shape
    points, pitch, blocks = layout.row_points, 2 * layout.pitch, layout.column_blocks
    columns = [("columns_1", n1, n0 * blocks, n1 * pitch, pitch)]
    if not layout.batched:
        columns.append(("columns_0", n0, n1 * blocks, pitch, n1 * pitch))
    parts = [twiddles(n) for n in sorted({points, *(edge[1] for edge in columns)})]
    parts.append(_rows(layout, inverse))
    passes = [Pass("rows", n0 * n1 // 8, group_size(points))]
    for name, n, groups, outer, stride in columns:
        parts.append(_columns(layout, name, n, outer, stride, inverse))
        passes.append(Pass(name, groups, group_size(n)))
    return Plan("\n".join(parts), tuple(reversed(passes) if inverse else passes))


def group_size(n: int) -> int:
    """Work-items of a group that transforms lines of n points."""
    return min(256, max(32, n))


def local_bytes(n: int) -> int:
    """Local memory of a group: 8 lines of n points, real and imaginary parts."""
    return 8 * n * 2 * 4


def _kernel(name: str, n: int, body: list[str]) -> str:
    """A kernel around its statements; `item` is the work-item's number in its group."""
    text = "\n    ".join(body)
    return f"""
__kernel __attribute__((reqd_workgroup_size({group_size(n)}, 1, 1)))
void {name}(__global float* volume, __global float* spectrum) {{
    __local float re[{8 * n}], im[{8 * n}];
    const int item = get_local_id(0);
    const size_t group = get_group_id(0);
    {text}
}}"""


def _each(n: int, count: int, body: list[str]) -> list[str]:
    """A loop whose `count` turns `t` are shared by the work-items of a group, and the barrier after it."""
    return [
        f"for (int t = item; t < {count}; t += {group_size(n)}) {{",
        *(f"    {line}" for line in body),
        "}",
        _BARRIER,
    ]


def _stages(n: int) -> list[str]:
    lines: list[str] = []
    for index, radix in enumerate(RADICES[n]):
        before = prod(RADICES[n][:index])
        body = stage(n, index, "float", _get, _put)
        head = [
            f"const int line = t & 7, k = (t >> 3) & {before - 1};",
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


def _columns(layout: Layout, name: str, n: int, outer: int, stride: int, inverse: bool) -> str:
    """The kernel of an axis other than the last.

    Args:
        outer: floats from one set of adjacent columns to the next.
        stride: floats from one element of a column to the next.
    """
    re, im = _parts(inverse)
    blocks = layout.column_blocks
    where = "const int line = t & 7, k = t >> 3;"
    load = [
        f"{where} const int at = 8 * ({scatter(n, 'k')}) + line;",
        f"const float2 z = vload2(0, p + k * {stride} + 2 * line);",
        f"{re}[at] = z.x; {im}[at] = z.y;",
    ]
    store = [f"{where} vstore2((float2)({re}[t], {im}[t]), 0, p + k * {stride} + 2 * line);"]
    first = f"__global float* p = spectrum + group / {blocks} * {outer} + group % {blocks} * 16;"
    return _kernel(name, n, [first, *_each(n, 8 * n, load), *_stages(n), *_each(n, 8 * n, store)])


def _rows(layout: Layout, inverse: bool) -> str:
    """The kernel of the last axis: packed real rows and their half spectra."""
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    re, im = _parts(inverse)
    row = f"const int line = t / {n}, k = t % {n}; __global float* v = rows + line * {length};"
    pair = f"const int line = t / {n // 2 + 1}, k = t % {n // 2 + 1};"
    pair += f" __global float* p = spectra + line * {pitch};"
    load, store = _spectra_to_rows(n, re, im) if inverse else _rows_to_spectra(n, re, im)
    loops = [
        *_each(n, 4 * n + 8 if inverse else 8 * n, [pair if inverse else row, *load]),
        *_stages(n),
        *_each(n, 8 * n if inverse else 4 * n + 8, [row if inverse else pair, *store]),
    ]
    first = f"__global float *rows = volume + group * {8 * length}, *spectra = spectrum + group * {8 * pitch};"
    scale = 2 / layout.points if inverse else 1.0  # a packed row has half the points of its real one
    return untangle(n, scale, inverse, "float") + _kernel("rows", n, [first, *loops])


def _rows_to_spectra(n: int, re: str, im: str) -> tuple[list[str], list[str]]:
    """Load point k of a packed row v; store numbers k and n - k of its half spectrum p."""
    load = [
        f"const int at = 8 * ({scatter(n, 'k')}) + line;",
        "const float2 z = vload2(k, v);",
        f"{re}[at] = z.x; {im}[at] = z.y;",
    ]
    store = [
        f"const int at = 8 * k + line, mirror = 8 * (({n} - k) & {n - 1}) + line;",
        f"float ar = {re}[at], ai = {im}[at], br = {re}[mirror], bi = {im}[mirror];",
        "untangle(&ar, &ai, &br, &bi, k);",
        f"vstore2((float2)(ar, ai), k, p); vstore2((float2)(br, bi), {n} - k, p);",
    ]
    return load, store


def _spectra_to_rows(n: int, re: str, im: str) -> tuple[list[str], list[str]]:
    """Load numbers k and n - k of a half spectrum p; store point k of its packed row v."""
    load = [
        f"float2 a = vload2(k, p), b = vload2({n} - k, p);",
        "if (k == 0) a.y = b.y = 0.0f;  // a real row has none there",
        "float ar = a.x, ai = a.y, br = b.x, bi = b.y; untangle(&ar, &ai, &br, &bi, k);",
        f"const int m = {n} - k, at = 8 * ({scatter(n, 'k')}) + line;",
        f"const int mirror = 8 * ({scatter(n, 'm')}) + line;",
        f"{re}[at] = ar; {im}[at] = ai; {re}[mirror] = br; {im}[mirror] = bi;",
    ]
    store = [f"vstore2((float2)({re}[8 * k + line], {im}[8 * k + line]), k, v);"]
    return load, store
