"""The paper's experiments on simulated scans, and evaluations that compare methods.

In: an experiment's name and options (`experiments.py` has the table). Out: rows, tables, figures and pages in a folder.
`experiment.py` says what an experiment is: jobs that can be run one by one, and a section made of their rows. `run.py`
runs the jobs, with a journal and workers (`worker.py`); `provenance.py` says which rows may be used again. Every
experiment is a folder: `run.py`, `section.py`, mostly `settings.py` and `figure.py`. `structures/`, `evaluation/` hold
what several experiments share, `pages/` writes files.
"""
