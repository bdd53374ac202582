# pyright: strict
"""Emit the passes of a sparse volume's forward transform for a processor, between which other work finds its place.

The last two axes of a plane come first; rows without points are passed over, and so are planes. The columns of the
first axis follow, some beside each other in private arrays: whoever stores them does more with them on the way.
"""

from sonarmap.kernels.fft.cpu import KERNEL, columns, tables
from sonarmap.kernels.fft.cpu_rows import real_rows
from sonarmap.kernels.fft.edges import radices
from sonarmap.kernels.fft.plan import Layout
from sonarmap.kernels.fft.stage import KEEP, Edges


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
