"""What the experiments on unseen pairs share.

`methods.py` has the methods that are compared, `set_pairs.py` the pairs, `settings.py` and `experiment.py` how batches
of pairs are registered, `answer.py` a registration as the cells of a row. `summary.py`, `calibration_tables.py` and
`figure.py` make tables and curves of rows.
"""
