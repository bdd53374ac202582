"""The paper's experiments on simulated scans, and evaluations that compare methods.

An experiment has a name and options (`experiments.py` lists all) and produces rows and tables in a folder.
Its module has a function `create`, which turns the options into settings, jobs and a function that runs a job. `run.py`
runs the jobs, with a journal and workers, and decides which rows of an earlier run are valid. `tables.py` and
`paper_tables.py` define the tables, `render.py` formats them with pandas, and `folder.py` writes the files.
"""
