"""The paper's experiments on simulated scans, and evaluations that compare methods.

In: an experiment's name and options (`experiments.py` has the table). Out: rows, tables and a picture in a folder.
Each experiment has a module with `create`, which makes it from the options: its settings, its jobs, and how one is
done. `run.py` runs the jobs, with a journal and workers, and says which rows may be used again. `tables.py`,
`paper_tables.py` and `figures.py` say what is shown of the rows, `render.py` makes tables of them by pandas, and
`folder.py` writes the files.
"""
