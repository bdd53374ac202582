# pyright: strict
"""Emit the last axis of a Fourier transform for a processor: 8 rows at a time, transposed in registers."""

from kernels.device.source import literal
from kernels.fft.plan import RADICES, Layout
from kernels.fft.stage import KEEP, block, private_stages, scatter, untangle


def real_rows(layout: Layout, inverse: bool, maxima: bool = False) -> str:
    """The function that transforms 8 real rows: dense floats to half a spectrum, or back.

    Args:
        maxima: of an inverse: the function takes two more arguments, where to store the maximum of each row, 8 floats,
            and up to which cyclic distance from column 0 it is taken.
    """
    scale = 2 / layout.points if inverse else 1.0  # a packed row has half the points of its real one
    parts = [_position(layout.row_points), untangle(layout.row_points, scale, inverse, "float8")]
    return "\n".join([*parts, _spectra_to_rows(layout, scale, maxima) if inverse else _rows_to_spectra(layout)])


def _rows_to_spectra(layout: Layout) -> str:
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    return f"""
static inline void rows(__global const float* volume, __global float* spectrum) {{
    float8 re[{n}], im[{n}], a[8], b[8];
    {KEEP} for (int k = 0; k < {n}; k += 4) {{
        load_rows(volume + 2 * k, {length}, a);
        const int at = position(k);
        {_tile_to_arrays("at", n, "re", "im", "a")}
    }}
    {private_stages(n, 0, len(RADICES[n]))}
    a[0] = re[{n // 2}];
    a[1] = -im[{n // 2}];
    a[2] = a[3] = a[4] = a[5] = a[6] = a[7] = 0.0f;
    store_rows(spectrum + {n}, {pitch}, a);  // all but its first column is overwritten below
    {KEEP} for (int k = 0; k < {n // 2}; k += 4) {{
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


def _spectra_to_rows(layout: Layout, scale: float, maxima: bool) -> str:
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    tops, reduce = (", __global float* tops, const int reach", _row_maxima(n)) if maxima else ("", "")
    return f"""
static inline void rows(__global float* volume, __global const float* spectrum{tops}) {{
    float8 re[{n}], im[{n}], a[8], b[8];
    load_rows(spectrum + {n}, {pitch}, a);
    im[position({n // 2})] = a[0] * {literal(scale)};
    re[position({n // 2})] = a[1] * {literal(-scale)};
    {KEEP} for (int k = 0; k < {n // 2}; k += 4) {{
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
    {private_stages(n, 0, len(RADICES[n]))}
    {reduce}
    {KEEP} for (int k = 0; k < {n}; k += 4) {{
        {_arrays_to_tile("k", "im", "re")}
        store_rows(volume + 2 * k, {length}, a);
    }}
}}"""


def _row_maxima(n: int) -> str:
    """Store the maxima of 8 rows of 2 n numbers, the even ones in im, the odd ones in re."""
    return f"""float8 top = -INFINITY;
    {KEEP} for (int k = 0; k < {n}; ++k) {{
        if (2 * k <= reach || 2 * k >= {2 * n} - reach) top = max(top, im[k]);
        if (2 * k + 1 <= reach || 2 * k + 1 >= {2 * n} - reach) top = max(top, re[k]);
    }}
    vstore8(top, 0, tops);"""


def _untangle_tiles() -> str:
    """Untangle 4 numbers from k on, in a, with their 4 mirror images, in b from the last to the first."""
    return block(
        [f"untangle(a + {2 * j}, a + {2 * j + 1}, b + {6 - 2 * j}, b + {7 - 2 * j}, k + {j});" for j in range(4)]
    )


def _tile_to_arrays(at: str, n: int, re: str, im: str, tile: str, shift: int = 0) -> str:
    """Put consecutive numbers in the digit-reversed order; the first has the position `at`, less `shift`."""
    step = n // RADICES[n][-1]
    lines: list[str] = []
    for j in range(4 - shift):
        to = f"{at} + {(j + shift) * step}"
        lines.append(f"{re}[{to}] = {tile}[{2 * j}]; {im}[{to}] = {tile}[{2 * j + 1}];")
    return block(lines)


def _arrays_to_tile(at: str, re: str, im: str) -> str:
    return block([f"a[{2 * j}] = {re}[{at} + {j}]; a[{2 * j + 1}] = {im}[{at} + {j}];" for j in range(4)])


def _position(n: int) -> str:
    return f"static inline int position(const int i) {{ return {scatter(n, 'i')}; }}"
