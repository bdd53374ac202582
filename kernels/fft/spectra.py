# pyright: strict
"""Emit the transform of a sparse volume for a processor, whose last pass whitens and writes magnitudes on the way."""

from kernels.device.source import literal
from kernels.fft.cpu import KERNEL, columns, tables
from kernels.fft.cpu_rows import real_rows
from kernels.fft.plan import Layout
from kernels.fft.sparse import forward_columns, last_stage, sheet_width, sparse_planes
from kernels.fft.stage import KEEP, block

_HEADER = '#include "device/complex.cl"\n#include "pomf/whitening.cl"'


def emit_spectra(layout: Layout, exponents: tuple[float, ...], magnitude: bool) -> str:
    """The program of `planes` and `sheets`.

    Args:
        exponents: of the whitening, a spectrum for each.
        magnitude: whether `sheets` writes magnitudes, too.
    """
    n1 = layout.shape[1]
    parts = [_HEADER, *tables(layout, inverse=False)]
    parts += [columns("columns_1", n1, 2 * layout.pitch, 1, inverse=False), real_rows(layout, inverse=False)]
    parts += [sparse_planes(layout), _MAGNITUDES if magnitude else "", _columns(layout, exponents, magnitude)]
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


def _columns(layout: Layout, exponents: tuple[float, ...], magnitude: bool) -> str:
    """The function that turns columns of the first axis at p into whitened ones.

    Those of the first exponent take the place of p. `first` is which block of its sheet, which begins at `row`, p is.
    """
    n0, n1, n2 = layout.shape
    stride, wide, per_row, valid = 2 * n1 * layout.pitch, sheet_width(layout), layout.pitch // 8, n2 // 2 + 1
    others = "".join(f", __global float* whitened{e}" for e in range(1, len(exponents)))
    stores = ["const float8 power = yQr * yQr + yQi * yQi;"]
    for e, exponent in enumerate(exponents):
        stores.append(f"""{{
                const float8 scale = whitening(power, {literal(exponent)});
                const float8 r = select((float8)(0.0f), yQr * scale, scale > 0.0f);
                const float8 m = select((float8)(0.0f), yQi * scale, scale > 0.0f);
                store_columns8({f"whitened{e}" if e else "p"} + f * {stride} + i * 16, r, m);
            }}""")
    parameters, prepare = "", ""
    if magnitude:
        parameters = ", __global float* magnitudes, const float farthest, const int row, const int first"
        stores.append(f"""if (min(f, {n0} - f) <= reach[i])
                store_magnitudes(rows[i] + {_centered("f", n0)} * {n1 * valid}, {valid} - along[i],
                                 sqrt(power).s01452367);""")
        prepare = f"""__global float* rows[{wide}];
    int along[{wide}], reach[{wide}];
    for (int i = 0; i < {wide}; ++i) {{
        const int j = row + (first + i) / {per_row}, k = (first + i) % {per_row} * 8, near = min(j, {n1} - j);
        rows[i] = magnitudes + {_centered("j", n1)} * {valid} + k;
        along[i] = k;
        const float left = farthest * farthest - near * near - k * k;
        reach[i] = left >= 0.0f ? (int)sqrt(left) : -1;
    }}"""
    return f"""
static inline void whitened_columns(__global float* p, __global const int* filled{others}{parameters}) {{
    float8 re[{wide * n0}], im[{wide * n0}];
    {prepare}
    {forward_columns(n0, stride, wide)}
    {last_stage(n0, wide, block(stores))}
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
