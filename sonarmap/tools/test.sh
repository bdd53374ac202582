#!/usr/bin/env bash
# Set up, then run the tests. Arguments go to pytest, for example: tools/test.sh -m '' tests/kernels/fft
set -euo pipefail
root=$(cd -P "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd) # of the checkout, also through its link tools
"$root/tools/setup.sh"
cd "$root"
# A process for every core and a thread for each: more of them only wait for one another.
export SONARMAP_THREADS=${SONARMAP_THREADS:-1} OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
exec .venv/bin/python -m pytest -n auto --dist loadfile "$@"
