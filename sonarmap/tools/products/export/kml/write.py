"""KML and KMZ files."""

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.kml.document import kml_text
from sonarmap.tools.products.export.kml.overlay import legend_of, pictures_of

_LEGEND = "files/legend.png"


def write_kml(path: Path, earth: Georeferenced) -> None:
    """Write the track of a part, with times where the scans have them, as KML 2.2."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(kml_text(earth))


def write_kmz(path: Path, earth: Georeferenced) -> None:
    """Write the same, the map from above as a picture on the ground, and a legend, as KMZ."""
    pictures = [(f"files/map_{number}.png", picture) for number, picture in enumerate(pictures_of(earth), 1)]
    # the document comes first, where readers look for it
    contents = [("doc.kml", kml_text(earth, pictures, _LEGEND)), *((name, picture.png) for name, picture in pictures)]
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, content in (*contents, (_LEGEND, legend_of(earth))):
            entry = zipfile.ZipInfo(name)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)


def kmz_details(earth: Georeferenced) -> Mapping[str, Any]:
    """What the picture shows, for the side-car."""
    return {
        "picture": "the uppermost surface from above, colored by height from the first to the last percent of the "
        "points that several scans saw; north up, rows and columns along latitude and longitude",
        "altitude_mode": "clampToGround: all is drawn on the water's surface, whatever its height",
    }
