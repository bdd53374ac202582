#!/usr/bin/env bash
# Set up, simulate the survey of a flood gate, make its map, and compare poses and map with the truth.
set -euo pipefail
root=$(cd -P "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd) # of the checkout, also through its link tools
"$root/tools/setup.sh"
cd "$root"

step() {
    echo
    echo "\$ sonarmap $*"
    .venv/bin/sonarmap "$@"
}

started=$SECONDS
rm -rf demo-out
step simulate --scene floodgate --scans 8 --seed 1 -o demo-out/scans
step map demo-out/scans -o demo-out/map
limit=$(.venv/bin/python -c 'import json, sys; print(2 * json.load(sys.stdin)["settings"]["grid"]["voxel"])' \
    < demo-out/map/summary.json)
# No pose may be farther off than two voxels and two degrees, else this fails.
step evaluate demo-out/map/trajectory.tum demo-out/scans/truth.tum --align first \
    --map demo-out/map/map.ply --surface demo-out/scans --summary demo-out/map/summary.json \
    --max-error-m "$limit" --max-error-deg 2
echo
echo "Simulated, mapped and evaluated in $((SECONDS - started)) s. In demo-out/map:"
ls demo-out/map
