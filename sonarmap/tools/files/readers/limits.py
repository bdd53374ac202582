"""The largest numbers that files of poses may hold: beyond any use, and far below where squares overflow."""

# Of a coordinate, a rotation's parts and a standard deviation [m, rad, degrees]: 80 times as wide as the Earth.
LARGEST = 1e9
LARGEST_STAMP = 1e19  # nanoseconds since 1970 are 1.8e18
LARGEST_INFORMATION = 1e30  # its inverse is the largest variance
LEAST_SIGMA = 1e-9  # [m, rad, degrees]; a quaternion is not shorter either


def largest_of(column: str) -> float:
    """How large the numbers of a column may be, by its name: a stamp or id, an information (I11, ...), or any other."""
    if column.startswith("I"):
        return LARGEST_INFORMATION
    return LARGEST_STAMP if column in ("stamp", "id") else LARGEST
