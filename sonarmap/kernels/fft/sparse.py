"""Emit the passes of a sparse volume's forward transform for a processor, between which other work finds its place.

The last two axes of a plane come first; rows without points are passed over, and so are planes. The columns of the
first axis follow, some beside each other in private arrays: whoever stores them does more with them on the way, as
`emit_spectra` does: it whitens them and writes magnitudes.
"""

from sonarmap.kernels.device.source import literal
from sonarmap.kernels.fft.cpu import KERNEL, columns, tables
from sonarmap.kernels.fft.cpu_rows import real_rows
from sonarmap.kernels.fft.edges import radices
from sonarmap.kernels.fft.plan import Layout
from sonarmap.kernels.fft.stage import KEEP, Edges, block


def sheet_width(layout: Layout) -> int:
    """How many adjacent blocks of 8 columns, and rows of the second axis, a work-item of the first axis takes."""
    return 4 if layout.shape[0] <= 128 else 8


def emit_planes(layout: Layout) -> str:
    """The program of `planes`, the last two axes of volumes, which whatever follows along the first axis shares.

    A work-item has a plane; rows that were read are cleared, and so are the marks. A mark stands for 8 rows; rows
    without hold zeros. A plane of such rows alone is not written: `filled` is 0 for it.
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
    """The stages but the last of the columns at p, into re and im; `filled` points to the (n,) int of `emit_planes`."""
    n, lanes = edges.n, int(edges.vector.removeprefix("float"))

    def load(q: int, _: str) -> str:
        f = f"(k + {q * n // radices(n)[0]})"
        return f"""x{q}r = x{q}i = 0.0f;
            if (filled[{f}]) load_columns{lanes}(p + {f} * {stride} + i * {2 * lanes}, &x{q}r, &x{q}i);"""

    return f"{edges.first(load)}\n    {edges.middle()}"


def emit_spectra(layout: Layout, exponents: tuple[float, ...], magnitude: bool, lanes: int = 8) -> str:
    """The program of `sheets`, which follows the planes.

    Args:
        exponents: of the whitening, a spectrum for each.
        magnitude: whether `sheets` writes magnitudes, too.
        lanes: 8 or 16, the numbers in a vector along the first axis.
    """
    parts = [f"#define LANE float{lanes}", f"#define ALIKE int{lanes}"]
    parts += ['#include "device/complex.cl"', '#include "pomf/whitening.cl"', *tables(layout, inverse=False)]
    parts += [_MAGNITUDES if magnitude else "", _columns(layout, exponents, magnitude, lanes)]
    return "\n".join([*parts, _sheets(layout, exponents, magnitude)])


# The first `many` of 8 magnitudes; a row's last block has fewer than 8 that are valid.
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
    """The function that turns columns of the first axis at p into whitened ones.

    Those of the first exponent take the place of p. `first` is which block of its sheet, which begins at `row`, p is.
    """
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
        parameters = ", __global float* magnitudes, const float farthest, const int row, const int first"
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
    """Where the magnitudes of each block of 8 columns go, how far along a row, and how far along the first axis."""
    _, n1, n2 = layout.shape
    wide, per_row = sheet_width(layout), layout.pitch // 8
    return f"""__global float* rows[{wide}];
    int along[{wide}], reach[{wide}];
    for (int b = 0; b < {wide}; ++b) {{
        const int j = row + (first + b) / {per_row}, k = (first + b) % {per_row} * 8, near = min(j, {n1} - j);
        rows[b] = magnitudes + {_centered("j", n1)} * {n2 // 2 + 1} + k;
        along[b] = k;
        const float left = farthest * farthest - near * near - k * k;
        reach[b] = left >= 0.0f ? (int)sqrt(left) : -1;
    }}"""


def _store_magnitudes(layout: Layout, lanes: int) -> str:
    """The statements that store the root of `power`, of number f of column block i."""
    n0, n1, n2 = layout.shape
    valid = n2 // 2 + 1
    # of 8 lanes complex.cl says in which order they are
    blocks = {"i": "root.s01452367"} if lanes == 8 else {"2 * i": "root.lo", "2 * i + 1": "root.hi"}
    stores = [
        f"""if (near <= reach[{b}]) store_magnitudes(rows[{b}] + to, {valid} - along[{b}], {values});"""
        for b, values in blocks.items()
    ]
    return f"""{{
                const int near = min(f, {n0} - f), to = {_centered("f", n0)} * {n1 * valid};
                const LANE root = sqrt(power);
                {" ".join(stores)}
            }}"""


def _centered(index: str, n: int) -> str:
    """Where the number of this index stands once frequency 0 is in the middle."""
    return f"({index} < {n // 2} ? {index} + {n // 2} : {index} - {n // 2})"


def _sheets(layout: Layout, exponents: tuple[float, ...], magnitude: bool) -> str:
    """The kernel of the first axis, a work-item per sheet."""
    wide, others = sheet_width(layout), range(1, len(exponents))
    spectra = "".join(f", __global float* spectrum{e}" for e in others)
    more = ", __global float* magnitudes, const float farthest" if magnitude else ""
    at = "".join(f", spectrum{e} + start + i" for e in others)
    at += f", magnitudes, farthest, get_global_id(0) * {wide}, i / 16" if magnitude else ""
    return f"""
{KERNEL} sheets(__global float* spectrum, __global const int* filled{spectra}{more}) {{
    const size_t start = get_global_id(0) * {2 * layout.pitch * wide};
    {KEEP} for (int i = 0; i < {2 * layout.pitch * wide}; i += {16 * wide})
        whitened_columns(spectrum + start + i, filled{at});
}}"""
