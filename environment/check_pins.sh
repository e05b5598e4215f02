#!/usr/bin/env bash
# Has every pin of the lock a wheel, so that nothing must be compiled? For each supported system and Python the package
# registry is asked, by uv, as if this were that system; nothing is installed.
#
#   environment/check_pins.sh                              # all
#   environment/check_pins.sh x86_64-manylinux_2_28 3.14   # one, in uv's words
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
uv=${GVP_VENV:-.venv}/bin/uv
[ -x "$uv" ] || uv=$(command -v uv) || { echo "check_pins.sh: no uv; run environment/setup.sh first." >&2; exit 1; }

# manylinux_2_28 is every Linux with glibc 2.28 or later: Debian 10, Ubuntu 20.04, RHEL 8 and what came after them.
if [ $# = 0 ]; then
  for system in x86_64-manylinux_2_28 aarch64-manylinux_2_28 aarch64-apple-darwin; do
    for python in 3.11 3.12 3.13 3.14; do echo "$system" "$python"; done
  done | xargs -n 2 -P 4 environment/check_pins.sh # uv waits for the network most of the time
  exit
fi

system=$1 python=$2
locks=(environment/lock.txt)
case $system in *linux*) locks+=(environment/lock-cuda.txt) ;; esac
export MACOSX_DEPLOYMENT_TARGET=14.0
if found=$("$uv" pip compile --no-python-downloads --system-certs --no-header --no-annotate --no-deps \
  --only-binary :all: --python-platform "$system" --python-version "$python" "${locks[@]}" 2>&1); then
  echo "[OK]   $system, Python $python: $(grep -c == <<<"$found") wheels"
else
  printf '[FAIL] %s, Python %s:\n%s\n' "$system" "$python" "$found"
  exit 1
fi
