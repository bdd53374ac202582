"""Run by the Python that QGIS belongs to: opens an export's files as layers and prints what QGIS makes of them."""

import json
import os
import sys

# pyrefly: ignore[missing-import]
from qgis.core import (
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsPointXY,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)

# pyrefly: ignore[missing-import]
from qgis.PyQt.QtCore import QSize

COLUMNS = "delimiter=,&detectTypes=yes&zField=height_m"
LAYERS = {
    "grid": "grid.tif",
    "scans": "track.gpkg|layername=scans",
    "track": "track.gpkg|layername=track",
    "loops": "track.gpkg|layername=loops",
    "geojson": "track.geojson|geometrytype=Point",
    "kmz": "map.kmz",
    "csv": f"poses.csv?{COLUMNS}&xField=easting_m&yField=northing_m&crs={{crs}}",
    "csv in degrees": f"poses.csv?{COLUMNS}&xField=lon_deg&yField=lat_deg&crs=EPSG:4326",
}


def opened(folder: str, name: str, crs: str):
    source = f"{folder}/{LAYERS[name]}"
    if name == "grid":
        return QgsRasterLayer(source, name)
    if name.startswith("csv"):
        return QgsVectorLayer("file://" + source.format(crs=crs), name, "delimitedtext")
    return QgsVectorLayer(source, name, "ogr")


def said(layer, to_map: QgsCoordinateTransform) -> dict:
    says = {"valid": layer.isValid(), "crs": layer.crs().authid()}
    if isinstance(layer, QgsRasterLayer):
        extent = layer.extent()
        edges = [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()]
        return {**says, "edges": edges, "renderer": layer.renderer().type(), "bands": layer.bandCount()}
    places = []
    for feature in layer.getFeatures():
        for vertex in feature.geometry().vertices():
            place = to_map.transform(QgsPointXY(vertex.x(), vertex.y()))
            places.append([place.x(), place.y(), vertex.z()])
    types = {field.name(): field.typeName().lower() for field in layer.fields()}
    style = layer.renderer().type()
    return {**says, "count": layer.featureCount(), "places": places, "types": types, "renderer": style}


def drawn(layer, path: str) -> None:
    """The layer alone, 4 pixels for the edge of a cell."""
    settings = QgsMapSettings()
    settings.setDestinationCrs(layer.crs())
    settings.setLayers([layer])
    settings.setExtent(layer.extent())
    settings.setOutputSize(QSize(4 * layer.width(), 4 * layer.height()))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(path)


def main(folder: str, crs: str) -> None:
    application = QgsApplication([], False)
    application.initQgis()
    grid, project = QgsCoordinateReferenceSystem(crs), QgsProject.instance()
    layers = {name: opened(folder, name, crs) for name in LAYERS}
    says = {
        name: said(layer, QgsCoordinateTransform(layer.crs(), grid, project)) if layer.isValid() else {"valid": False}
        for name, layer in layers.items()
    }
    drawn(layers["grid"], f"{folder}/drawn.png")
    print(json.dumps(says), flush=True)
    os._exit(0)  # QGIS's own end crashes now and then where there is no screen


main(*sys.argv[1:])
