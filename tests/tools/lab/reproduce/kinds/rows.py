"""Rows as the experiment on kinds of scans makes them, by hand."""


def row(**changes: object) -> dict:
    """A right, believed registration by ours with nothing known, but for what is said."""
    place = {"kind": "patch", "number": 1, "scene": "harbor", "relief": "rich", "shared": 0.5, "priors": "none"}
    answer = {"right": True, "accepted": True, "nees": 5.0, "probability": 0.95}
    return place | {"method": "spectral", "voxel_m": 1.0} | answer | changes


def fixed(sigma: float, error: float, navigation_error: float, number: int) -> dict[str, float]:
    """The cells of one direction, in which navigation has a standard deviation of 1.5 m."""
    values = {"sigma": sigma, "error": error, "navigation_sigma": 1.5, "navigation_error": navigation_error}
    return {f"direction{number}_{name}_m": value for name, value in values.items()}
