#!/usr/bin/env bash
# Write environment/lock.txt and environment/lock-cuda.txt from pyproject.toml: every package, exactly, for every
# supported system at once (markers say which system needs what). Versions already locked stay unless asked otherwise:
#
#   environment/write_lock.sh                         # add what pyproject.toml newly asks for
#   environment/write_lock.sh --upgrade               # take the newest of everything
#   environment/write_lock.sh --upgrade-package numpy
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv="${GVP_VENV:-.venv}/bin/uv"
[ -x "$uv" ] || uv=$(command -v uv) || { echo "write_lock.sh: no uv here; run environment/setup.sh first." >&2; exit 1; }

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# The present locks, joined, are the preferences that hold the versions still.
cat environment/lock.txt environment/lock-cuda.txt >"$scratch/all.txt" 2>/dev/null || true
"$uv" pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 --all-extras --no-header \
  --output-file "$scratch/all.txt" "$@" pyproject.toml

cat >"$scratch/lock.txt" <<'HEADER'
# Every package of gvp_lib and its extras, exactly. Written by environment/write_lock.sh; do not edit.
# torch's own CUDA packages are in lock-cuda.txt.
HEADER
cat >"$scratch/lock-cuda.txt" <<'HEADER'
# What torch's default build for Linux brings for an NVIDIA GPU: installed only beside that build.
# Written by environment/write_lock.sh; do not edit.
HEADER
# An entry is a line that starts with a name, and the indented comments below it.
awk -v base="$scratch/lock.txt" -v cuda="$scratch/lock-cuda.txt" '
  /^[a-z]/ { out = ($0 ~ /^(nvidia-|cuda-|triton==)/) ? cuda : base }
  { print >> out }' "$scratch/all.txt"
mv "$scratch/lock.txt" "$scratch/lock-cuda.txt" environment/
echo "environment/lock.txt: $(grep -c '^[a-z]' environment/lock.txt) packages; lock-cuda.txt: $(grep -c '^[a-z]' environment/lock-cuda.txt)."
