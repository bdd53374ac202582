"""The pose graph: graph.g2o, and beside it the name, time and frame of every vertex, for which g2o has no place."""
# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false

from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
from sonarmap.tools.files.map_folder.names import GRAPH
from sonarmap.tools.files.time_scales import utc_texts
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.files.writers.table import write_table
from sonarmap.tools.products.export.georeferenced import Georeferenced

COLUMNS = ("vertex", "name", "stamp", "utc", "map", "frame")
WORLD, FIRST_POSE = "East-North-Up", "first pose"


def write_graph(path: Path, folder: MapFolder, part: MapPart, earth: Georeferenced | None) -> None:
    """Write the table to `path`, and graph.g2o beside it, unless that is the map's own.

    Raises:
        InputError: graph.g2o is missing, or a file cannot be written.
    """
    _write_vertices(path, folder)
    if path.parent.resolve() == folder.path.resolve():
        return
    try:
        content = read_content(folder.path / GRAPH)
    except InputError as error:
        raise InputError(f"{error}; map again") from error
    with atomic_path(path.with_name(GRAPH)) as temporary:
        temporary.write_bytes(content)


def _write_vertices(path: Path, folder: MapFolder) -> None:
    """Write one row per vertex of graph.g2o, of all parts of the map."""
    rows: list[tuple[int, str, str, str, int, str]] = []
    for number, each in enumerate(folder.parts, 1):
        stamps, frame = each.trajectory.stamps, WORLD if each.in_world else FIRST_POSE
        for scan, stamp, utc in zip(each.scans, stamps.tolist(), utc_texts(stamps), strict=True):
            rows.append((scan, folder.names[scan], repr(stamp), utc, number, frame))
    write_table(path, COLUMNS, sorted(rows))
