"""Two scans in, one 6-DoF registration with its uncertainty out.

`registration.py` is the method, its steps in order: `prepare/` is what one scan contributes to every pair, `so3.py`
finds rotations, `translation.py` shifts, `verify/` tests the hypotheses that they make, and `judgement.py` says how
probable they are. `prior.py` says what the vehicle's instruments leave possible. `hemisphere.py` is the paper's own
chain. A method is any object with `prepare(scan)` and `register(target, source)`: see `result.Registrar`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
