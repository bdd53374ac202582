"""Other methods of registration, which the spectral one is compared with.

In: a scan (`prepare`), two prepared scans (`register`). Out: a `spectral.result.Registration`, as the protocol
`Registrar` asks for. `points.py` has the frame of those that work on points, their covariance, overlap and acceptance;
`surveys.py` maps whole surveys by other systems.
"""
