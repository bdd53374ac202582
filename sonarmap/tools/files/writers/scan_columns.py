"""What a scan says of its points beside where they are, as the columns that the readers know."""

import numpy as np

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.clouds.cloud import VIEWPOINT_NAMES


def columns_of(scan: Scan) -> dict[str, np.ndarray]:
    """{name: (N,)} for `write_points`: intensity and vp_x, vp_y, vp_z, as far as the scan has them."""
    columns = {} if scan.strength is None else {"intensity": scan.strength}
    if scan.viewpoints is not None:
        columns |= dict(zip(VIEWPOINT_NAMES, scan.viewpoints.T, strict=True))
    return columns
