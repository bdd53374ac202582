#!/usr/bin/env bash
# Make .venv at the root and install sonarmap in it, with the system libraries that it needs.
#
# If everything is installed already, this ends within a second. After an interrupted run the next one starts over.
# PYTHON=/path/to/python3 chooses the interpreter; by default it is the first python3 that is new enough.
set -euo pipefail
cd -P "$(dirname "${BASH_SOURCE[0]}")/../.." # the root of the checkout, also through its link tools
readonly mark=.venv/.sonarmap-setup no_browser=.venv/.sonarmap-no-browser
export PIP_DISABLE_PIP_VERSION_CHECK=1

fail() {
    echo "setup: $*" >&2
    exit 2
}

# stage LABEL COMMAND...: run it and say how long it took.
stage() {
    local label=$1 start=$EPOCHREALTIME
    shift
    echo "setup: $label"
    "$@" || fail "$label: failed, see above"
    awk -v a="$start" -v b="$EPOCHREALTIME" 'BEGIN { printf "setup: done in %.1f s\n", b - a }'
}

# The interpreter to build on: the system's, even if a virtual environment is active.
find_python() {
    local candidate base='import sys; sys.version_info < (3, 11) and sys.exit(1); print(sys._base_executable)'
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
        "$candidate" -c "$base" 2>/dev/null && return
    done
    fail "no Python of at least 3.11 was found; install one, or name one: PYTHON=/path/to/python3 $0"
}

# The missing ones of the Debian packages that open3d and OpenCL on processors need.
missing_packages() {
    "$python" - <<'PYTHON'
import ctypes
from pathlib import Path

libraries = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libX11.so.6": "libx11-6",
}
missing = []
for library, package in libraries.items():
    try:
        ctypes.CDLL(library)
    except OSError:
        missing.append(package)
if not any(Path("/etc/OpenCL/vendors").glob("pocl*.icd")):
    missing.append("pocl-opencl-icd")
print(*missing)
PYTHON
}

as_root() {
    if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo -n "$@"; fi
}

can_install() {
    command -v apt-get >/dev/null && { [ "$(id -u)" -eq 0 ] || sudo -n true 2>/dev/null; }
}

install_packages() {
    as_root env DEBIAN_FRONTEND=noninteractive apt-get update -qq </dev/null || echo "setup: could not update the package lists" >&2
    as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@" </dev/null >/dev/null
}

# What pip installs: more where the system's packages cannot be installed.
extras=dev from_pip=()

system_libraries() {
    local packages
    read -r -a packages <<<"$(missing_packages)"
    [ ${#packages[@]} -eq 0 ] && return
    if can_install; then
        stage "installing system packages: ${packages[*]}" install_packages "${packages[@]}"
        return
    fi
    local package missing=()
    for package in "${packages[@]}"; do
        case $package in
            libusb-1.0-0) from_pip+=(libusb-package) ;;
            pocl-opencl-icd) compgen -G '/etc/OpenCL/vendors/*.icd' >/dev/null || extras=dev,opencl ;;
            *) missing+=("$package") ;;
        esac
    done
    [ ${#missing[@]} -eq 0 ] && return
    echo "setup: these system packages are missing, and this user cannot install them; without them some commands fail:" >&2
    echo "setup:     sudo apt-get install ${missing[*]}" >&2
}

# Chromium, without which the tests of pages are skipped; where it cannot be had, that is tried once.
browser() {
    local name
    for name in chromium chromium-browser google-chrome google-chrome-stable; do
        command -v "$name" >/dev/null && return
    done
    { can_install && [ ! -e "$no_browser" ]; } || return 0
    echo "setup: installing chromium, for tests of pages"
    install_packages chromium && return
    echo "setup: chromium cannot be installed; the tests of pages are skipped" >&2
    mkdir -p .venv && touch "$no_browser"
}

# What the environment depends on. If this differs from what the mark in .venv says, the environment is out of date.
wanted_state() {
    { pwd -P; version_of "$python"; cat pyproject.toml constraints.txt; echo "$extras" "${from_pip[@]}"; } | sha256sum
}

version_of() {
    "$1" -c 'import sys; print(sys.version)' 2>/dev/null
}

# Make the environment, anew if an earlier run was interrupted or its interpreter is gone or was replaced.
make_environment() {
    if [ "$(cat $mark 2>/dev/null)" = unfinished ] || ! version_of .venv/bin/python >/dev/null ||
        { [ -e $mark ] && [ "$(version_of .venv/bin/python)" != "$(version_of "$python")" ]; }; then
        rm -rf .venv
    fi
    mkdir -p .venv
    echo unfinished >$mark
    [ -x .venv/bin/python ] || "$python" -m venv --without-pip .venv
    # Debian without python3-venv has no ensurepip, but its own pip can install a pip into the environment.
    .venv/bin/python -m pip --version >/dev/null 2>&1 ||
        .venv/bin/python -m ensurepip --default-pip >/dev/null 2>&1 ||
        "$python" -m pip --python .venv/bin/python install -q pip ||
        fail "$python has neither ensurepip nor pip; install one, as in 'sudo apt-get install python3-venv'"
}

# What pip would install, by uv, in a sixth of the time and from where pip's settings say.
install_by_uv() {
    .venv/bin/python -m pip install -q uv -c constraints.txt && .venv/bin/python - "$@" <<'PYTHON'
import ast
import subprocess
import sys

listed = subprocess.run([sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True, check=True).stdout
settings = {}
for section in ("global", "install", ":env:"):  # the later ones count
    for name, _, value in (line.partition("=") for line in listed.splitlines()):
        if name.startswith(f"{section}."):
            settings[name.removeprefix(f"{section}.")] = str(ast.literal_eval(value)).split()
command = [sys.executable, "-m", "uv", "pip", "install", "--python", sys.executable]
command += ["--index-strategy", "unsafe-best-match"]  # as pip does
for setting, option in (
    ("index-url", "--default-index"),
    ("extra-index-url", "--index"),
    ("find-links", "--find-links"),
    ("trusted-host", "--allow-insecure-host"),
):
    command += [word for value in settings.get(setting, []) for word in (option, value)]
sys.exit(subprocess.run([*command, *sys.argv[1:]]).returncode)
PYTHON
}

install_sonarmap() {
    local wanted=(-e ".[$extras]" "${from_pip[@]}" -c constraints.txt)
    [ -t 1 ] || wanted+=(-q)
    install_by_uv "${wanted[@]}" || .venv/bin/python -m pip install "${wanted[@]}" || return
    local usb
    for usb in .venv/lib/python*/site-packages/libusb_package/libusb-1.0.so; do
        [ -e "$usb" ] && ln -sf "${usb#.venv/lib/}" .venv/lib/libusb-1.0.so.0 # where open3d looks
    done
    return 0
}

exec 9<tools/setup.sh
flock 9 || fail "cannot lock tools/setup.sh" # two runs at once would break the environment

python=$(find_python)
system_libraries
browser & # while pip downloads
trap wait EXIT
if [ "$(cat $mark 2>/dev/null)" = "$(wanted_state)" ] && .venv/bin/python -c '' 2>/dev/null; then
    echo "setup: .venv is up to date"
    exit 0
fi
stage "making .venv with $python" make_environment
stage "installing sonarmap and what it needs (the first time about 1 GB)" install_sonarmap
wanted_state >$mark.new
mv $mark.new $mark
stage "trying the OpenCL devices" .venv/bin/sonarmap devices
