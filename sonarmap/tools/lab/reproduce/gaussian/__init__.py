"""Table 1 of the paper: scans ever farther apart, with Gaussian noise along the beams (Sect. 3, Figs. 20, 21).

`series.py` has the variants of the paper's chain that are compared, registers, and compares with the truth;
`section.py` and `figure.py` show it.
"""
