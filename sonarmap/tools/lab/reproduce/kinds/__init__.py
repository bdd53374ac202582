"""Every kind of scan that is simulated, by every method, with and without what instruments know.

Registered are pairs of the kinds of tools/lab/simulate/kinds, in `run.py`; `navigation.py` compares a registration with
navigation alone. The rest shows rows: `kind_summary.py`, `tables.py` and `navigation_table.py` what is right and
believed, `calibration_tables.py` whether probabilities and covariances hold, also for a kind that had no part in
fitting them (`refit_summary.py`).
"""
