"""The files of an experiment and the page of a group of experiments.

In: a section, rows, times, provenance. Out: CSV, Markdown, PNG and JSON in the output folder (`folder.py`), and pages
such as docs/reproduction.md (`page.py`).
"""
