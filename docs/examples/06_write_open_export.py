"""Map scans, write the map, open it, and export it: python 06_write_open_export.py SCANS MAP"""

import sys

import sonarmap

folder, out = sys.argv[1:]
result = sonarmap.map_scans(folder, edge=64)
print(result)

# The same files as of `sonarmap map`: the verbs `view`, `locate`, `section`, `volume` and `compare` take the folder.
place = sonarmap.Georeference(latitude=60.3913, longitude=5.3221)
sonarmap.write_map(result, out, inputs=folder, georeference=place)

finished = sonarmap.Map.open(out)
print(finished)
for part in finished.parts:
    sure = part.columns["sigma"] < 0.1
    last = part.trajectory.T_world_sensor.translation[-1]
    print(f"{sure.sum()} of {len(part.points)} points are sure to 0.1 m; the last scan was at {last.round(2)} m")

exported = sonarmap.export_map(finished, f"{out}/gis", ["laz", "geotiff"])
print("exported:", *(path.name for path in exported.files))
for note in exported.notes:
    print("note:", note)
