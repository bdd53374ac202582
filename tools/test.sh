#!/usr/bin/env bash
# Set up, then run the tests. Arguments go to pytest, for example: tools/test.sh -m '' tests/kernels/fft
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
"$root/tools/setup.sh"
cd "$root"
exec .venv/bin/python -m pytest -n auto --dist loadfile "$@"
