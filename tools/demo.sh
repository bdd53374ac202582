#!/usr/bin/env bash
# Set up, simulate the survey of a flood gate, make its map, and compare the estimated poses with the true ones.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
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
step evaluate demo-out/map/trajectory.tum demo-out/scans/truth.tum --align first
echo
echo "Simulated, mapped and evaluated in $((SECONDS - started)) s. In demo-out/map:"
ls demo-out/map
