"""Where registrations run: workers, executors, and the journal of results.

In: pairs to register. Out: the pairs with their registrations, the same wherever they ran and however often the run was
stopped. The mapper calls `runner.py`; `executor.py` and `journal.py` know nothing of pairs.
"""
