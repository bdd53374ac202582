"""LAS and LAZ files, written by laspy."""

import io

import laspy
import numpy as np
from laspy.header import GpsTimeType

from tests.samples.cloud_files import TABLE

SCALE = 1 / 1024  # exact in binary, as the numbers of TABLE are


def las(
    table: np.ndarray = TABLE,
    compressed: bool = True,
    form: int = 6,
    version: str = "1.4",
    gps: np.ndarray | None = None,
    adjusted: bool = True,
    offset: tuple[float, float, float] = (0.5, -3.0, 0.25),
    crs: object = None,
    extra: dict[str, np.ndarray] | None = None,
) -> bytes:
    """x, y, z and intensity of a table.

    Args:
        table: (N, 4).
        form, version: of the points and of the file.
        gps: (N,) times; None for none.
        adjusted: whether these are adjusted standard GPS time, or seconds of a week.
        offset: of the coordinates' integers [m].
        crs: of pyproj, or None.
        extra: more dimensions (N,), float64.
    """
    header = laspy.LasHeader(point_format=form, version=version)
    header.scales, header.offsets = np.full(3, SCALE), np.array(offset)
    header.global_encoding.gps_time_type = GpsTimeType.STANDARD if adjusted else GpsTimeType.WEEK_TIME
    for name in extra or {}:
        header.add_extra_dim(laspy.ExtraBytesParams(name, "f8"))
    if crs is not None:
        header.add_crs(crs)  # type: ignore[arg-type]
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (table[:, axis].astype(np.float64) for axis in range(3))
    cloud.intensity = np.round(table[:, 3])
    if gps is not None:
        cloud.gps_time = gps
    for name, values in (extra or {}).items():
        setattr(cloud, name, values)
    file = io.BytesIO()
    cloud.write(file, do_compress=compressed)
    return file.getvalue()
