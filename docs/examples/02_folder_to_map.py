"""Map a folder of scans: python 02_folder_to_map.py SCANS MAP.ply"""

import sys

import sonarmap
from sonarmap.tools.files.writers.points import write_ply

folder, map_file = sys.argv[1:]
result = sonarmap.map_scans(folder, edge=64, progress=lambda done, planned, text: print(f"{done}/{planned} {text}"))

for pair in result.pairs:
    print(f"{pair.i} - {pair.j} {pair.role}: {pair.reason}")
for stamp, position in zip(result.trajectory.stamps, result.trajectory.T_world_sensor.translation, strict=True):
    print(f"at {stamp:g} s the sensor was at {position.round(2)} m")

largest = max(result.maps, key=lambda point_map: len(point_map.points))
write_ply(map_file, largest.points, {"count": largest.count, "sigma": largest.sigma})
print(f"{len(largest.points)} points written to {map_file}")
