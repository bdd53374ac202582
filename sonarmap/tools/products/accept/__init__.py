"""The acceptance sheet: which order of IHO S-44 a finished map meets, where it fails and why.

`orders.py` holds the orders, `cells.py` depths with their uncertainties, `sheet.py` the verdicts, `crossings.py`
observed and predicted differences of passes, `page.py` the page.
"""
