"""Two scans in, one 6-DoF registration with its uncertainty out.

`registration.py` runs the steps of the method in order: `prepare/` computes what a scan contributes to all its pairs,
`so3.py` finds rotations, `translation.py` finds shifts, `verify/` tests the resulting hypotheses, and `judgement.py`
computes their probabilities. `prior.py` bounds the pose by the vehicle's instruments. `hemisphere.py` is the paper's
own chain. A method is any object with `prepare(scan)` and `register(target, source)`: see `result.Registrar`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
