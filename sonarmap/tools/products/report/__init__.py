"""Pictures as PNG files: of a registration step by step, of a map from above, of what the loops changed.

In: results of spectral/ and slam/. Out: files. `*_panels.py` draw parts of a figure, `plan.py` cuts the true plan of a
simulated scene. Matplotlib is imported only inside the functions that draw.
"""
