"""Other methods of registration, which the spectral one is compared with.

In: a scan (`prepare`), two prepared scans (`register`). Out: a `spectral.result.Registration`, as the protocol
`Registrar` asks for. One file per method; `cloud.py` has what they prepare, `result.py` their covariance, overlap and
acceptance, `packages.py` the imports of optional packages. `planes/` registers plane patches, `surveys/` maps whole
surveys by other systems. The table of all methods is tools/methods/registry.py.
"""
