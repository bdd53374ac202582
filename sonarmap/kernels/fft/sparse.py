# pyright: strict
"""Emit the passes of a sparse volume's forward transform for a processor, between which other work finds its place.

The last two axes of a plane come first; rows without points are passed over, and so are planes. The columns of the
first axis follow, some beside each other in private arrays: whoever stores them does more with them on the way.
"""

from sonarmap.kernels.fft.cpu import KERNEL, columns, tables
from sonarmap.kernels.fft.cpu_rows import real_rows
from sonarmap.kernels.fft.edges import radices
from sonarmap.kernels.fft.plan import Layout
from sonarmap.kernels.fft.stage import KEEP, block, from_private, private_stages, stage, to_private


def sheet_width(layout: Layout) -> int:
    """How many adjacent blocks of 8 columns, and rows of the second axis, a work-item of the first axis takes."""
    return 4 if layout.shape[0] <= 128 else 8


def emit_planes(layout: Layout) -> str:
    """The program of `planes`, which whatever follows along the first axis shares: it is compiled once."""
    n1 = layout.shape[1]
    parts = ['#include "device/complex.cl"', *tables(layout, inverse=False)]
    parts += [columns("columns_1", n1, 2 * layout.pitch, 1, inverse=False), real_rows(layout, inverse=False)]
    return "\n".join([*parts, _sparse_planes(layout)])


def _sparse_planes(layout: Layout) -> str:
    """The last two axes of volumes, a work-item per plane; rows that were read are cleared, and so are the marks.

    A mark stands for 8 rows; rows without hold zeros. A plane of such rows alone is not written: `filled` is 0 for it.
    """
    _, n1, n2 = layout.shape
    pitch = 2 * layout.pitch
    return f"""
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
}}"""


def forward_columns(n: int, stride: int, wide: int, lanes: int = 8) -> str:
    """The stages but the last of `wide` times 8 or 16 columns at p, into the private arrays re and im.

    `filled` points to the (n,) int of `emit_planes`.
    """
    first = radices(n)[0]

    def load(q: int, _: str) -> str:
        f = f"(k + {q * n // first})"
        return f"""x{q}r = x{q}i = 0.0f;
            if (filled[{f}]) load_columns{lanes}(p + {f} * {stride} + i * {2 * lanes}, &x{q}r, &x{q}i);"""

    return f"""{KEEP} for (int k = 0; k < {n // first}; ++k) {{
        {KEEP} for (int i = 0; i < {wide}; ++i) {{
            const int at = i * {n} + position_{n}[k];
            {block(stage(n, 0, f"float{lanes}", load, to_private))}
        }}
    }}
    {private_stages(n, 1, len(radices(n)) - 1, wide, f"float{lanes}")}"""


def last_stage(n: int, wide: int, store: str, before: str = "", after: str = "", lanes: int = 8) -> str:
    """The last stage out of re and im; `store` is the statement for number f of the spectrum, Q in place of q."""
    last = radices(n)[-1]

    def stored(q: int, _: str) -> str:
        return f"{{ const int f = k + {q * n // last}; {store.replace('Q', str(q))} }}"

    return f"""{KEEP} for (int k = 0; k < {n // last}; ++k) {{
        {KEEP} for (int i = 0; i < {wide}; ++i) {{
            const int at = i * {n} + k;
            {before}
            {block(stage(n, len(radices(n)) - 1, f"float{lanes}", from_private, stored))}
            {after}
        }}
    }}"""
