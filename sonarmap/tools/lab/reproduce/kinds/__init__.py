"""Every kind of scan that is simulated, by every method, with and without what instruments know.

Registered are pairs of the kinds of tools/lab/simulate/kinds, in `run.py`; `navigation.py` compares a registration with
navigation alone. The rest shows rows: `tables.py` what is right and believed, `calibration_tables.py` whether
probabilities and covariances hold.
"""
