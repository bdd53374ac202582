"""Other methods of registration, to compare the spectral one with."""
