"""The KML document of a map: its track, where it starts and ends, and pictures on the ground.

Everything is clamped to the ground, which on the sea is the water's surface: below it Google Earth's own sea floor,
coarse and often above the true one, would hide the map. The coordinates have their heights all the same.
"""

import re
from collections.abc import Sequence
from html import escape
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from sonarmap.tools.files.geo.georeference import VERTICALS
from sonarmap.tools.files.time_scales import are_times, utc_text
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.kml.overlay import Picture

KML, GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
_CLAMPED = "clampToGround"
_TRACK_COLOR = "ff2727d6"  # alpha, blue, green, red
_NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_NARROWEST = 100.0  # of what is in view at first [m]


def kml_text(earth: Georeferenced, pictures: Sequence[tuple[str, Picture]] = (), legend: str | None = None) -> bytes:
    """The document in UTF-8.

    Args:
        earth: the part of the map.
        pictures: of the map, with the paths under which they will be in a KMZ.
        legend: path of the picture that explains their colors.
    """
    root = Element("kml", {"xmlns": KML, "xmlns:gx": GX})
    document = SubElement(root, "Document")
    _text(document, "name", f"{earth.folder.path.resolve().name} map{earth.part.suffix}")
    _text(document, "open", "1")
    _described(document, _description(earth))
    _look_at(document, earth)
    style = SubElement(document, "Style", {"id": "track"})
    line = SubElement(style, "LineStyle")
    _text(line, "color", _TRACK_COLOR)
    _text(line, "width", "3")
    for number, (href, picture) in enumerate(pictures):
        _overlay(document, href, picture, "map" if number == 0 else f"map, piece {number + 1}")
    if legend:
        _legend(document, legend)
    _line(document, earth)
    if are_times(earth.part.trajectory.stamps):
        _timed_track(document, earth)
    _place(document, earth, "start", 0)
    _place(document, earth, "end", -1)
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _text(parent: Element, tag: str, text: str) -> None:
    """A child with text; characters that XML cannot hold (of a file's name) become question marks."""
    SubElement(parent, tag).text = _NOT_IN_XML.sub("?", text)


def _described(parent: Element, words: str) -> None:
    """A description, which Google Earth takes for HTML: what a scan's name has of that is shown as it is."""
    _text(parent, "description", escape(words, quote=False))


def _description(earth: Georeferenced) -> str:
    part = earth.part
    return (
        f"{len(part.scans)} scans, {len(part.points):,} points, voxel {earth.folder.voxel:.3g} m. Heights count from "
        f"{VERTICALS[earth.georeference.vertical]}, positive up. Everything is drawn on the water's surface."
    )


def _look_at(document: Element, earth: Georeferenced) -> None:
    """The whole map in view, from above."""
    extent = float(np.ptp(earth.part.points[:, :2], axis=0).max())
    center = earth.part.points.mean(axis=0)[None]
    (latitude, longitude, _) = earth.georeference.geodetic(center)[0].tolist()
    look = SubElement(document, "LookAt")
    _text(look, "longitude", f"{longitude:.7f}")
    _text(look, "latitude", f"{latitude:.7f}")
    _text(look, "altitude", "0")
    _text(look, "range", f"{1.5 * max(extent, _NARROWEST):.0f}")
    _text(look, "altitudeMode", _CLAMPED)


def _overlay(document: Element, href: str, picture: Picture, name: str) -> None:
    overlay = SubElement(document, "GroundOverlay")
    _text(overlay, "name", name)
    icon = SubElement(overlay, "Icon")
    _text(icon, "href", href)
    _text(overlay, "altitudeMode", _CLAMPED)
    box = SubElement(overlay, "LatLonBox")
    for edge in ("north", "south", "east", "west"):
        _text(box, edge, f"{getattr(picture, edge):.10f}")


def _legend(document: Element, href: str) -> None:
    """A picture in the lower left corner of the screen."""
    overlay = SubElement(document, "ScreenOverlay")
    _text(overlay, "name", "heights")
    icon = SubElement(overlay, "Icon")
    _text(icon, "href", href)
    for tag, x, y in (("overlayXY", "0", "0"), ("screenXY", "0.02", "0.06")):
        SubElement(overlay, tag, {"x": x, "y": y, "xunits": "fraction", "yunits": "fraction"})
    SubElement(overlay, "size", {"x": "-1", "y": "-1", "xunits": "fraction", "yunits": "fraction"})  # as it is


def _line(document: Element, earth: Georeferenced) -> None:
    placemark = SubElement(document, "Placemark")
    _text(placemark, "name", "track")
    _text(placemark, "styleUrl", "#track")
    line = SubElement(placemark, "LineString")
    _text(line, "tessellate", "1")
    _text(line, "altitudeMode", _CLAMPED)
    _text(line, "coordinates", "\n".join(_coordinate(place, ",") for place in earth.poses))


def _timed_track(document: Element, earth: Georeferenced) -> None:
    """The same with times, for the time slider; in order of time, which programs expect."""
    placemark = SubElement(document, "Placemark")
    _text(placemark, "name", "track with times")
    _text(placemark, "styleUrl", "#track")
    track = SubElement(placemark, "gx:Track")
    _text(track, "altitudeMode", _CLAMPED)
    stamps = earth.part.trajectory.stamps
    order = np.argsort(stamps, kind="stable")
    for stamp in stamps[order].tolist():
        _text(track, "when", utc_text(stamp))
    for place in earth.poses[order]:
        _text(track, "gx:coord", _coordinate(place, " "))


def _place(document: Element, earth: Georeferenced, name: str, k: int) -> None:
    """Where a scan was taken."""
    part, place = earth.part, earth.poses[k]
    stamp = float(part.trajectory.stamps[k])
    time = utc_text(stamp) if are_times(part.trajectory.stamps) else f"stamp {stamp:g} s"
    placemark = SubElement(document, "Placemark")
    _text(placemark, "name", name)
    words = f"{earth.folder.names[part.scans[k]]}, {time}, {place[0]:.8f}, {place[1]:.8f}, height {place[2]:.2f} m"
    _described(placemark, words)
    point = SubElement(placemark, "Point")
    _text(point, "altitudeMode", _CLAMPED)
    _text(point, "coordinates", _coordinate(place, ","))


def _coordinate(place: np.ndarray, separator: str) -> str:
    """Longitude, latitude [deg] and height [m] of a place (3,): to a tenth of a millimeter."""
    latitude, longitude, height = place.tolist()
    return separator.join((f"{longitude:.10f}", f"{latitude:.10f}", f"{height:.4f}"))
