"""Emit fused passes over sparse volumes for a processor, each of which reads and writes a spectrum once.

A forward transform begins with the last two axes (`emit_planes`), which skips rows and planes without points. The pass
of the first axis also whitens the spectrum and writes magnitudes (`emit_spectra`); or whitens it, multiplies it by the
target and the gains, and transforms back along the same axis (`correlate`); or sums the correlation near one shift
(`near`). The last pass of the inverse transform also stores the maximum of each row.
"""

from sonarmap.kernels.device.source import literal
from sonarmap.kernels.fft.cpu import KERNEL, columns, real_rows, tables
from sonarmap.kernels.fft.edges import Layout, radices
from sonarmap.kernels.fft.stage import KEEP, Edges, block, to_private


def sheet_width(layout: Layout) -> int:
    """Rows of the second axis per work-item of the first axis, and blocks of 8 columns that it transforms at once."""
    return 4 if layout.shape[0] <= 128 else 8


def emit_planes(layout: Layout) -> str:
    """Program of the kernel `planes`: the last two axes of volumes, a plane per work-item.

    Each mark stands for 8 rows that may hold points; other rows hold zeros. Marked rows are cleared once they are read,
    and so are their marks. A plane without marks is not written, and its `filled` is 0.
    """
    _, n1, n2 = layout.shape
    pitch = 2 * layout.pitch
    parts = ['#include "device/complex.cl"', *tables(layout, inverse=False)]
    parts += [columns("columns_1", pitch, Edges(n1, 1), inverse=False), real_rows(layout, inverse=False)]
    parts.append(f"""
{KERNEL} planes(__global float* volume, __global int* marks, __global int* filled, __global float* spectrum) {{
    volume += get_global_id(0) * {n1 * n2};
    marks += get_global_id(0) * {n1 // 8};
    spectrum += get_global_id(0) * {n1 * pitch};
    int any_row = 0;
    for (int k = 0; k < {n1 // 8}; ++k) any_row |= marks[k];
    filled[get_global_id(0)] = any_row;
    if (!any_row) return;
    {KEEP} for (int row = 0; row < {n1}; row += 8) {{
        if (marks[row / 8]) {{
            rows(volume + row * {n2}, spectrum + row * {pitch});
            {KEEP} for (int k = 0; k < {n2 // 2}; ++k) vstore16((float16)(0.0f), k, volume + row * {n2});
            marks[row / 8] = 0;
        }} else {{
            {KEEP} for (int k = 0; k < {pitch // 2}; ++k) vstore16((float16)(0.0f), k, spectrum + row * {pitch});
        }}
    }}
    {KEEP} for (int i = 0; i < {16 * layout.column_blocks}; i += 16) columns_1(spectrum + i);
}}""")
    return "\n".join(parts)


def forward_columns(edges: Edges, stride: int) -> str:
    """All stages but the last of the columns at p, into re and im; `filled` is the (n,) int of `emit_planes`."""
    n, lanes = edges.n, int(edges.vector.removeprefix("float"))

    def load(q: int, _: str) -> str:
        f = f"(k + {q * n // radices(n)[0]})"
        return f"""x{q}r = x{q}i = 0.0f;
            if (filled[{f}]) load_columns{lanes}(p + {f} * {stride} + i * {2 * lanes}, &x{q}r, &x{q}i);"""

    return f"{edges.first(load)}\n    {edges.middle()}"


def emit_spectra(layout: Layout, exponents: tuple[float, ...], magnitude: bool, lanes: int = 8) -> str:
    """Program of the kernel `sheets`, after `planes`: a spectrum for each exponent of the whitening, and magnitudes."""
    parts = [f"#define LANE float{lanes}", f"#define ALIKE int{lanes}"]
    parts += ['#include "device/complex.cl"', '#include "pomf/whitening.cl"', *tables(layout, inverse=False)]
    parts += [_MAGNITUDES if magnitude else "", _columns(layout, exponents, magnitude, lanes)]
    return "\n".join([*parts, _sheets(layout, exponents, magnitude)])


# Store the first `many` of 8 magnitudes; a row's last block has fewer than 8 valid ones.
_MAGNITUDES = """
static inline void store_magnitudes(__global float* to, const int many, const float8 values) {
    if (many >= 8) {
        vstore8(values, 0, to);
        return;
    }
    float each[8];
    vstore8(values, 0, each);
    for (int k = 0; k < many; ++k) to[k] = each[k];
}"""


def _columns(layout: Layout, exponents: tuple[float, ...], magnitude: bool, lanes: int) -> str:
    """The function that transforms and whitens the columns at p, in place for the first exponent. `row` is the first
    row of the sheet, `first` the number of p's block in it."""
    n0, n1, _ = layout.shape
    stride, edges = 2 * n1 * layout.pitch, Edges(n0, 8 * sheet_width(layout) // lanes, f"float{lanes}")
    others = "".join(f", __global float* whitened{e}" for e in range(1, len(exponents)))
    stores = ["const LANE power = yQr * yQr + yQi * yQi;"]
    for e, exponent in enumerate(exponents):
        stores.append(f"""{{
                const LANE scale = whitening(power, {literal(exponent)});
                const LANE r = select((LANE)(0.0f), yQr * scale, scale > 0.0f);
                const LANE m = select((LANE)(0.0f), yQi * scale, scale > 0.0f);
                store_columns{lanes}({f"whitened{e}" if e else "p"} + f * {stride} + i * {2 * lanes}, r, m);
            }}""")
    parameters, rows = "", ""
    if magnitude:
        parameters = ", __global float* magnitudes, const int row, const int first"
        rows = _magnitude_rows(layout)
        stores.append(_store_magnitudes(layout, lanes))
    return f"""
static inline void whitened_columns(__global float* p, __global const int* filled{others}{parameters}) {{
    LANE re[{edges.wide * n0}], im[{edges.wide * n0}];
    {rows}
    {forward_columns(edges, stride)}
    {edges.last(block(stores))}
}}"""


def _magnitude_rows(layout: Layout) -> str:
    """Declare pointers to the magnitudes of each block of 8 columns, and the blocks' positions in their rows."""
    _, n1, n2 = layout.shape
    wide, per_row = sheet_width(layout), layout.pitch // 8
    return f"""__global float* rows[{wide}];
    int along[{wide}];
    for (int b = 0; b < {wide}; ++b) {{
        const int j = row + (first + b) / {per_row}, k = (first + b) % {per_row} * 8;
        rows[b] = magnitudes + {_centered("j", n1)} * {n2 // 2 + 1} + k;
        along[b] = k;
    }}"""


def _store_magnitudes(layout: Layout, lanes: int) -> str:
    """Statements that store the root of `power`, for number f of column block i."""
    n0, n1, n2 = layout.shape
    valid = n2 // 2 + 1
    # the order of 8 lanes is that of complex.cl
    blocks = {"i": "root.s01452367"} if lanes == 8 else {"2 * i": "root.lo", "2 * i + 1": "root.hi"}
    stores = [f"store_magnitudes(rows[{b}] + to, {valid} - along[{b}], {values});" for b, values in blocks.items()]
    return f"""{{
                const int to = {_centered("f", n0)} * {n1 * valid};
                const LANE root = sqrt(power);
                {" ".join(stores)}
            }}"""


def _centered(index: str, n: int) -> str:
    """Expression of the position of an index when frequency 0 is in the middle."""
    return f"({index} < {n // 2} ? {index} + {n // 2} : {index} - {n // 2})"


def _sheets(layout: Layout, exponents: tuple[float, ...], magnitude: bool) -> str:
    """The kernel of the first axis, a work-item per sheet."""
    wide, others = sheet_width(layout), range(1, len(exponents))
    spectra = "".join(f", __global float* spectrum{e}" for e in others)
    more = ", __global float* magnitudes" if magnitude else ""
    at = "".join(f", spectrum{e} + start + i" for e in others)
    at += f", magnitudes, get_global_id(0) * {wide}, i / 16" if magnitude else ""
    return f"""
{KERNEL} sheets(__global float* spectrum, __global const int* filled{spectra}{more}) {{
    const size_t start = get_global_id(0) * {2 * layout.pitch * wide};
    {KEEP} for (int i = 0; i < {2 * layout.pitch * wide}; i += {16 * wide})
        whitened_columns(spectrum + start + i, filled{at});
}}"""


# Real and imaginary sums of a column: at a shift, and these times cosine and sine of the phases of 1 and 2 voxels.
_SUMS = 10
_HEADER = '#include "device/complex.cl"\n#include "pomf/whitening.cl"'


def emit_correlation(layout: Layout, exponents: tuple[float, ...]) -> str:
    """Program of the kernels `correlate` and `near`, which follow `emit_planes`; and of the kernel `planes`: the last
    two axes of the inverse transform, with the maxima of its rows."""
    stride, edges = 2 * layout.shape[1] * layout.pitch, Edges(layout.shape[0], sheet_width(layout))
    parts = [_HEADER, *tables(layout, inverse=True)]
    parts += [_correlate_columns(edges, stride, exponents), _correlate(layout, exponents)]
    parts += [_near_columns(edges, stride, exponents[0]), _near(layout)]
    parts.append(columns("columns_1", 2 * layout.pitch, Edges(layout.shape[1], 1), inverse=True))
    return "\n".join([*parts, real_rows(layout, inverse=True, maxima=True), _planes_with_maxima(layout)])


def _correlate_columns(edges: Edges, stride: int, exponents: tuple[float, ...]) -> str:
    """The function that turns columns of a source's spectrum into those of each exponent's correlation, and adds the
    power to `energy`."""
    n, wide = edges.n, edges.wide
    pointers = "".join(f", __global const float* target{e}, __global float* product{e}" for e in range(len(exponents)))
    keep = f"sr[i * {n} + f] = yQr; si[i * {n} + f] = yQi;"
    backs = [_back_columns(edges, stride, e, exponent) for e, exponent in enumerate(exponents)]
    return f"""
static inline void correlate_columns(__global const float* p, __global const int* filled{pointers},
                                     __global const float* across,
                                     __global const float* weights, __global const float* along, float8* energy,
                                     float* origin) {{
    float8 re[{wide * n}], im[{wide * n}], sr[{wide * n}], si[{wide * n}];
    {forward_columns(edges, stride)}
    {edges.last(keep)}
    *origin = sr[0].s0;
    {block(backs)}
}}"""


def _back_columns(edges: Edges, stride: int, e: int, exponent: float) -> str:
    """The inverse transform of the product with the spectrum in sr and si, to product<e>; its parts are exchanged."""
    n = edges.n

    def load(q: int, _: str) -> str:
        f = f"k + {q * n // radices(n)[0]}"
        return f"""{{
                float8 tr, ti;
                load_columns8(target{e} + ({f}) * {stride} + i * 16, &tr, &ti);
                const int s = i * {n} + {f};
                whitened_product(tr, ti, sr[s], si[s], gain * along[{f}], {literal(exponent)}, &x{q}i, &x{q}r);
                power += x{q}r * x{q}r + x{q}i * x{q}i;
            }}"""

    before = "const float8 gain = vload8(i, across).s01452367; float8 power = 0.0f;"
    after = f"energy[{e}] += power * vload8(i, weights).s01452367;"
    store = f"store_columns8(product{e} + f * {stride} + i * 16, yQi, yQr);"
    return f"""{edges.loop(0, f"position_{n}[k]", load, to_private, before, after)}
    {edges.middle()}
    {edges.last(store)}"""


def _sheet_head(layout: Layout) -> str:
    """Declare a work-item's `sheet`, its volume's `number`, and the sheet's offset `start` [floats]."""
    wide = sheet_width(layout)
    sheets = layout.shape[1] // wide
    return f"""const int sheet = get_global_id(0) % {sheets}, number = get_global_id(0) / {sheets};
    const size_t start = sheet * {2 * layout.pitch * wide};"""


def _correlate(layout: Layout, exponents: tuple[float, ...]) -> str:
    """The kernel of the first axis, there and back; spectra are (exponents, count, n0, n1, pitch), the first in place;
    energies (exponents, count, sheets + 1) are the sums of |X|^2 and, last, the term X of frequency 0."""
    n0, n1, _ = layout.shape
    wide, many = sheet_width(layout), range(len(exponents))
    sheets, floats, volume = n1 // wide, 2 * layout.pitch * wide, 2 * n0 * n1 * layout.pitch
    targets = ", ".join(f"__global const float* target{e}" for e in many)
    pairs = ", ".join(f"target{e} + at, spectrum + (size_t)({e} * count + number) * {volume} + at" for e in many)
    ends = [
        f"""float8 sum{e} = energy[{e}];
    energies[({e} * count + number) * {sheets + 1} + sheet] = sum8(sum{e});
    if (sheet == 0) energies[({e} * count + number) * {sheets + 1} + {sheets}] =
        dc * target{e}[0] * whitening((float8)(dc * dc), {literal(exponent)}).s0;"""
        for e, exponent in enumerate(exponents)
    ]
    return f"""
static float sum8(const float8 v) {{
    const float4 a = v.lo + v.hi;
    return a.x + a.y + a.z + a.w;
}}

{KERNEL} correlate(__global float* spectrum, __global const int* filled, {targets},
                   __global const float* across, __global const float* along,
                   __global float* energies, const int count) {{
    {_sheet_head(layout)}
    float8 energy[{len(exponents)}] = {{0.0f}};
    float dc = 0.0f;
    {KEEP} for (int i = 0; i < {floats}; i += {16 * wide}) {{
        const size_t at = start + i;
        float origin;
        correlate_columns(spectrum + (size_t)number * {volume} + at, filled + number * {n0}, {pairs}, across + at / 2,
                          across + {n1 * layout.pitch} + at / 2, along, energy, &origin);
        if (i == 0) dc = origin;
    }}
    {block(ends)}
}}"""


def _near_columns(edges: Edges, stride: int, exponent: float) -> str:
    """The function that sums columns of the correlation's spectrum at the 5 shifts within 2 voxels of a given one."""
    n, wide = edges.n, edges.wide
    store = f"""float8 tr, ti, xr, xi;
                load_columns8(target + f * {stride} + i * 16, &tr, &ti);
                whitened_product(tr, ti, yQr, yQi, gain * along[f], {literal(exponent)}, &xr, &xi);
                energy += xr * xr + xi * xi;
                if (f == 0) first[i] = xr;
                add_near(xr, xi, roots, f, (f * shift) % {n}, (2 * f) % {n}, sum);"""
    before = f"const float8 gain = vload8(i, across).s01452367; float8 energy = 0.0f; float8* sum = sums + i * {_SUMS};"
    return f"""
static inline void add_near(const float8 xr, const float8 xi, __global const float* roots, const int one,
                            const int there, const int two, float8* sum) {{
    const float2 turn = vload2(there, roots), a = vload2(one, roots), b = vload2(two, roots);
    const float8 zr = xr * turn.x - xi * turn.y, zi = xr * turn.y + xi * turn.x;
    sum[0] += zr;
    sum[1] += zi;
    sum[2] += zr * a.x;
    sum[3] += zi * a.x;
    sum[4] += zr * a.y;
    sum[5] += zi * a.y;
    sum[6] += zr * b.x;
    sum[7] += zi * b.x;
    sum[8] += zr * b.y;
    sum[9] += zi * b.y;
}}

static inline void near_columns(__global const float* p, __global const int* filled, __global const float* target,
                                __global const float* across, __global const float* along,
                                __global const float* roots, const int shift, __global float* out) {{
    float8 re[{wide * n}], im[{wide * n}], sums[{wide * _SUMS}], powers[{wide}], first[{wide}];
    for (int i = 0; i < {wide * _SUMS}; ++i) sums[i] = 0.0f;
    for (int i = 0; i < {wide}; ++i) powers[i] = 0.0f;
    {forward_columns(edges, stride)}
    {edges.last(store, before, "powers[i] += energy;")}
    for (int i = 0; i < {wide}; ++i) {{
        const float8* sum = sums + i * {_SUMS};
        __global float* to = out + i * 16;
        store_columns8(to, sum[6] + sum[9], sum[7] - sum[8]);
        store_columns8(to + {stride}, sum[2] + sum[5], sum[3] - sum[4]);
        store_columns8(to + {2 * stride}, sum[0], sum[1]);
        store_columns8(to + {3 * stride}, sum[2] - sum[5], sum[3] + sum[4]);
        store_columns8(to + {4 * stride}, sum[6] - sum[9], sum[7] + sum[8]);
        store_columns8(to + {5 * stride}, powers[i], first[i]);
    }}
}}"""


def _near(layout: Layout) -> str:
    """The kernel of the first axis of spectrum `number`, with sums (6, n1, pitch): at 5 shifts, of the power, and X at
    frequency 0."""
    n0, n1, _ = layout.shape
    wide = sheet_width(layout)
    return f"""
{KERNEL} near(__global const float* spectrum, __global const int* filled, __global const float* target,
              __global const float* across, __global const float* along, __global const float* roots, const int shift,
              const int number, __global float* out) {{
    const size_t start = get_global_id(0) * {2 * layout.pitch * wide};
    spectrum += (size_t)number * {2 * n0 * n1 * layout.pitch};
    filled += number * {n0};
    {KEEP} for (int i = 0; i < {2 * layout.pitch * wide}; i += {16 * wide}) {{
        const size_t at = start + i;
        near_columns(spectrum + at, filled, target + at, across + at / 2, along, roots, shift, out + at);
    }}
}}"""


def _planes_with_maxima(layout: Layout) -> str:
    """The last two axes of correlations (exponents, count, n0, n1, n2), up to 1 voxel beyond the reaches in `poses`;
    tops (exponents, count, n0, n1) are the maxima of the rows within their reach."""
    n0, n1, n2 = layout.shape
    pitch = 2 * layout.pitch
    return f"""
{KERNEL} planes(__global float* volume, __global float* spectrum, __global float* tops,
                __global const float* poses, const int count, const int first) {{
    const int plane = get_global_id(0) % {n0}, number = get_global_id(0) / {n0};
    const float4 reach = vload4(4, poses + (first + number % count) * 20);
    if (min(plane, {n0} - plane) > reach.x + 1) return;
    volume += get_global_id(0) * {n1 * n2};
    spectrum += get_global_id(0) * {n1 * pitch};
    tops += get_global_id(0) * {n1};
    {KEEP} for (int i = 0; i < {16 * layout.column_blocks}; i += 16) columns_1(spectrum + i);
    {KEEP} for (int row = 0; row < {n1}; row += 8) {{
        if (min(row, {n1 - 7} - row) > reach.y + 1 && row) continue;
        rows(volume + row * {n2}, spectrum + row * {pitch}, tops + row, reach.z);
    }}
}}"""
