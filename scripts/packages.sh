#!/usr/bin/env bash
# Installs the Debian packages of the named groups that are missing; prints each apt line before it runs it.
#   scripts/packages.sh build test ...
set -euo pipefail

packages_build="g++ cmake ninja-build pkg-config libtbb-dev libfmt-dev libeigen3-dev libhwy-dev
  libtiff-dev libpng-dev libopenexr-dev libimath-dev libturbojpeg0-dev libraw-dev libhdf5-dev zlib1g-dev libtomlplusplus-dev nlohmann-json3-dev libcli11-dev"
# Optional modules: camera capture, networks, the Python module.
packages_capture="libaravis-dev libusb-1.0-0-dev"
packages_neural="libtorch-dev libgloo-dev libopenblas0-openmp"
packages_python="pybind11-dev python3-dev python3-numpy"
packages_test="libgtest-dev libgmock-dev python3 python3-numpy python3-scipy python3-h5py python3-pil python3-pytest python3-pytest-xdist
  python3-mypy python3-torch python3-matplotlib python3-setuptools python3-pip python3-venv man-db mandoc dpkg-dev aravis-tools iproute2"
packages_browser="chromium nodejs npm"
packages_develop="ccache clang clang-format clang-tidy"

wanted=""
for group in "$@"; do
  name="packages_$group"
  wanted="$wanted ${!name}"
done

missing=""
for package in $wanted; do
  # A program that is already there by other means (a newer Node.js, say) counts as installed.
  case "$package" in nodejs) command -v node >/dev/null && continue ;; npm) command -v npm >/dev/null && continue ;; esac
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q "install ok installed" || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

as_root=""
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "packages:$missing are missing and neither root nor sudo is here; install them, or pass --no-install" >&2; exit 1; }
  as_root="sudo"
fi
run() { echo "+ $*"; "$@"; }
export DEBIAN_FRONTEND=noninteractive
run $as_root apt-get update -qq
run $as_root apt-get install -y -qq --no-install-recommends $missing >/dev/null
