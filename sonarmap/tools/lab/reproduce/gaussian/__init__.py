"""Table 1 of the paper: scans ever farther apart, with Gaussian noise along the beams (Sect. 3, Figs. 20, 21).

`variants.py` has the variants of the paper's chain that are compared, `series.py` registers, `scored.py` and `row.py`
compare with the truth, `summary.py`, `section.py`, `remarks.py` and `figure.py` show it.
"""
