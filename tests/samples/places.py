"""Where the checkout is, and the recordings and graphs beside it, without which some tests are skipped."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
