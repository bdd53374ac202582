"""The flood gate: maps of eighteen scans by chained registrations (Sect. 4, Table 2, Figs. 22 to 31).

`survey.py` simulates the scans, `methods.py` lists the methods, `chain.py` makes rows and chains of poses; the other
files show them in tables, figures and sentences.
"""
