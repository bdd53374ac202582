"""Where registrations run: workers, executors, and the journal of what is done.

In: pairs to register. Out: the same pairs with their registrations, however often the run was stopped and wherever it
ran. `runner.py` is what the mapper calls; `executor.py`, `transport.py` and `journal.py` know nothing of pairs.
"""
