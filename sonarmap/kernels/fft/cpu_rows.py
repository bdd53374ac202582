"""Emit the last axis of a Fourier transform for a processor: 8 rows at a time, transposed in registers.

A row of M points comes and goes in tiles of 4 numbers. Where M is no multiple of 4 the last tile lies over the one
before and writes the same numbers again. Numbers k and M - k of a spectrum are made together, k = 1 to M / 2; 0 and M,
which have no imaginary part, by themselves.
"""

from sonarmap.kernels.device.source import literal
from sonarmap.kernels.fft.edges import radices
from sonarmap.kernels.fft.plan import Layout
from sonarmap.kernels.fft.stage import KEEP, block, private_stages, untangle


def real_rows(layout: Layout, inverse: bool, maxima: bool = False) -> str:
    """The function that transforms 8 real rows: dense floats to half a spectrum, or back.

    It needs the tables position_<M> and half_turn, of `positions` and `half_turns`.

    Args:
        maxima: of an inverse: the function takes two more arguments, where to store the maximum of each row, 8 floats,
            and up to which cyclic distance from column 0 it is taken.
    """
    scale = layout.row_scale(inverse)
    rows = _spectra_to_rows(layout, scale, maxima) if inverse else _rows_to_spectra(layout)
    return "\n".join([untangle(scale, "float8"), rows])


def _rows_to_spectra(layout: Layout) -> str:
    n, pitch, length = layout.row_points, 2 * layout.pitch, layout.shape[2]
    last = min(n, layout.pitch - 4)  # so that its tile stays within the row
    # so that no column works on what memory happens to hold
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
    """Store the maxima of 8 rows of 2 n numbers, the even ones in im, the odd ones in re."""
    return f"""float8 top = -INFINITY;
    {KEEP} for (int k = 0; k < {n}; ++k) {{
        if (2 * k <= reach || 2 * k >= {2 * n} - reach) top = max(top, im[k]);
        if (2 * k + 1 <= reach || 2 * k + 1 >= {2 * n} - reach) top = max(top, re[k]);
    }}
    vstore8(top, 0, tops);"""


def _single_number(place: int, value: str) -> str:
    """Make a tile of zeros but for one real number."""
    return " ".join(f"a[{j}] = {value if j == 2 * place else '0.0f'};" for j in range(8))


def _tile(begin: str, n: int) -> str:
    """The declaration of k, where a tile of 4 begins."""
    return f"const int k = {begin if n % 4 == 0 else f'min({begin}, {n - 4})'};"


def _untangle_tiles() -> str:
    """Untangle 4 numbers from k on, in a, with their 4 mirror images, in b from the last to the first."""
    return block(
        [
            f"untangle(a + {2 * j}, a + {2 * j + 1}, b + {6 - 2 * j}, b + {7 - 2 * j},"
            f" half_turn[2 * k + {2 * j}], half_turn[2 * k + {2 * j + 1}]);"
            for j in range(4)
        ]
    )


def _tile_to_arrays(n: int, re: str, im: str, tile: str, numbers: list[str]) -> str:
    """Put a tile's numbers in the digit-reversed order."""
    lines: list[str] = []
    for j, number in enumerate(numbers):
        at = f"position_{n}[{number}]"
        lines.append(f"{re}[{at}] = {tile}[{2 * j}]; {im}[{at}] = {tile}[{2 * j + 1}];")
    return block(lines)


def _arrays_to_tile(at: str, re: str, im: str, tile: str) -> str:
    return block([f"{tile}[{2 * j}] = {re}[{at} + {j}]; {tile}[{2 * j + 1}] = {im}[{at} + {j}];" for j in range(4)])
