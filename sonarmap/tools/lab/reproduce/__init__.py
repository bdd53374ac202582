"""The paper's experiments on simulated scans, and evaluations that compare methods.

In: an experiment's name and options (`experiments.py` has the table). Out: rows, tables and figures in a folder.
`experiment.py` says what an experiment is: jobs that can be run one by one, and a section made of their rows. `run.py`
runs the jobs, with a journal and workers (`worker.py`); `provenance.py` says which rows may be used again.
`settings.py`, `rows.py`, `table.py`, `beside.py`, `figure.py` and `calibration_tables.py` hold what experiments share.
An experiment is a module with `create`, beside a section that shows its rows; `folder.py` writes files.
"""
