"""The orders of IHO S-44, Standards for Hydrographic Surveys, edition 6.1, Table 1 (bathymetry).

Nothing heavy is imported here: the command line's help names the orders.
"""

from dataclasses import dataclass

STANDARD = "IHO S-44 edition 6.1"


@dataclass(frozen=True, slots=True)
class Order:
    """The requirements of one order; uncertainties are those of 95 % confidence.

    Attributes:
        title: its name in the standard.
        a, b: of the largest vertical uncertainty, sqrt(a^2 + (b depth)^2) [m, 1].
        fixed, share: of the largest horizontal uncertainty, fixed + share * depth [m, 1].
        coverage: least bathymetric coverage, a share of the area: 1 is full coverage, 2 is full coverage twice.
        feature: edge of the smallest cube that has to be detected [m]; for orders without one, that of Order 1a.
    """

    title: str
    a: float
    b: float
    fixed: float
    share: float
    coverage: float
    feature: float = 2.0


# The strictest first. Order 1a asks for a coverage "up to 100 %"; no order may have less than 5 % of the area.
ORDERS = {
    "exclusive": Order("Exclusive Order", 0.15, 0.0075, 1.0, 0.0, 2.0, 0.5),
    "special": Order("Special Order", 0.25, 0.0075, 2.0, 0.0, 1.0, 1.0),
    "1a": Order("Order 1a", 0.5, 0.013, 5.0, 0.05, 0.05),
    "1b": Order("Order 1b", 0.5, 0.013, 5.0, 0.05, 0.05),
    "2": Order("Order 2", 1.0, 0.023, 20.0, 0.1, 0.05),
}
