"""The flood gate: maps of eighteen scans by chained registrations (Sect. 4, Table 2, Figs. 22 to 31).

`chain.py` simulates the scans, lists the methods, and makes rows and chains of poses; the other files show them in
tables, figures and sentences.
"""
