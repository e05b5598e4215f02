#!/usr/bin/env bash
# Make this clone ready: a virtual environment in .venv with exactly what environment/lock.txt pins, this project
# in it (editable), and, where they are missing and it may, the system libraries that draw without a screen.
# Run it as often as you like: with nothing changed it ends at once. It never asks a question.
#
#   PYTHON=python3.12       the Python to build on (3.11 or later); default: the first that fits
#   GVP_TORCH=cpu           on Linux, take torch without its gigabytes of CUDA
#   GVP_VENV=/some/folder   where the environment goes; default: .venv beside pyproject.toml
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
cd "$root"
venv=${GVP_VENV:-$root/.venv}
stamp=$venv/gvp-setup.stamp
system_packages="libegl1 libgl1 libgl1-mesa-dri"

say() { echo "setup: $*"; }
stop() { printf 'setup: %s\n' "$@" >&2; exit 1; }

# shellcheck source=environment/system.sh
. environment/system.sh

case "${GVP_TORCH:-}" in
  "" | cpu) ;;
  *) stop "GVP_TORCH is '$GVP_TORCH'; it may be 'cpu', or unset for torch's default build." ;;
esac
# Tools that an active environment or a caller's path would lead astray.
unset PYTHONPATH PYTHONHOME VIRTUAL_ENV CONDA_PREFIX

# What the environment was made from. The places count: scripts in an environment hold its path, and an editable
# install holds the clone's.
fingerprint() {
  echo "$venv"
  echo "$root"
  cat environment/lock.txt environment/lock-cuda.txt environment/setup.sh environment/system.sh pyproject.toml | cksum
}

has_cuda_torch() { # by its metadata, because importing torch takes seconds
  "$venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import PackageNotFoundError, requires
try:
    needs = requires("torch") or []
except PackageNotFoundError:
    sys.exit(1)
sys.exit(not any(need.startswith(("nvidia-", "cuda-")) for need in needs))
PYTHON
}

find_python() {
  local candidate
  for candidate in ${PYTHON:-python3.11 python3.12 python3.13 python3 python}; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
  [ -z "${PYTHON:-}" ] || stop "PYTHON=$PYTHON is not a Python of 3.11 or later."
  stop "no Python of 3.11 or later here. Install one, then run this again:" \
    "  Debian 12, Ubuntu 24.04 and later: sudo apt-get install python3 python3-venv" \
    "  macOS: brew install python@3.12    Fedora: sudo dnf install python3.12" \
    "  or anywhere: https://www.python.org/downloads/" \
    "One that is not on the PATH is named by PYTHON=/path/to/python3.12 environment/setup.sh"
}

make_venv() {
  # One that works, and has not been moved since it was made, is kept.
  # shellcheck disable=SC2016
  if [ "$(bash -c '. "$0/bin/activate" && echo "$VIRTUAL_ENV"' "$venv" 2>/dev/null)" = "$venv" ] &&
    "$venv/bin/python" -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    return
  fi
  if [ -e "$venv" ] && [ ! -e "$venv/pyvenv.cfg" ] && [ -n "$(ls -A "$venv")" ]; then
    stop "$venv exists and is not a virtual environment; move it away, or name another place by GVP_VENV."
  fi
  local python
  python=$(find_python)
  say "making $venv with $("$python" --version)"
  if ! "$python" -m venv --clear "$venv"; then
    stop "'$python -m venv' failed. On Debian and Ubuntu: sudo apt-get install python3-venv"
  fi
}

pinned() { grep -E "^$1==" environment/lock.txt | cut -d' ' -f1; }

pip_install() { "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-input "$@"; }

# uv does in seconds what takes pip a minute. Where it cannot (no build of it for this system, an index or a certificate
# that only pip's configuration knows), pip does.
install() {
  if [ -x "$venv/bin/uv" ]; then
    "$venv/bin/uv" pip install --system-certs --quiet --python "$venv/bin/python" "$@" && return
    say "uv could not; once more by pip, slower"
  fi
  pip_install "$@"
}

# torch goes first and by pip: pip's own configuration knows where this machine keeps its builds.
install_torch() {
  local torch
  torch=$(pinned torch)
  if [ "${GVP_TORCH:-}" = cpu ] && [ "$(uname -s)" = Linux ]; then
    if has_cuda_torch; then
      say "replacing torch's CUDA build"
      "$venv/bin/python" -m pip uninstall --quiet --yes torch -r environment/lock-cuda.txt
    fi
    "$venv/bin/python" -c 'import importlib.metadata as m; m.version("torch")' 2>/dev/null && return
    say "installing $torch, the CPU build"
    # A CPU build that pip can see here; otherwise PyTorch's own index, which uv knows by name.
    pip_install --no-deps "$torch+cpu" 2>/dev/null ||
      "$venv/bin/uv" pip install --system-certs --quiet --python "$venv/bin/python" --no-deps --torch-backend=cpu "$torch" ||
      stop "no CPU build of $torch could be fetched. Is there a network? Without GVP_TORCH the default build is taken."
  else
    say "installing $torch"
    pip_install --no-deps "$torch"
  fi
}

install_packages() {
  make_venv
  pip_install "$(pinned uv)" || say "uv is not to be had here"
  install_torch
  say "installing what environment/lock.txt pins"
  install --no-deps -r environment/lock.txt
  if has_cuda_torch; then
    install --no-deps -r environment/lock-cuda.txt
  fi
  install --no-deps --no-build-isolation --editable .
}

# MuJoCo draws a frame in a process of its own: that, not a package manager's opinion, is the question.
renders() { "$venv/bin/python" -m gvp_lib doctor rendering; }

make_rendering_work() {
  renders >/dev/null 2>&1 && return
  if may_install_system_packages; then
    say "installing $system_packages, to draw without a screen"
    # shellcheck disable=SC2086
    install_system_packages $system_packages || say "apt-get failed"
  fi
  renders || return 1
}

if [ "$(cat "$stamp" 2>/dev/null)" = "$(fingerprint)" ] && { [ "${GVP_TORCH:-}" != cpu ] || ! has_cuda_torch; }; then
  exit 0
fi
rm -f "$stamp"
install_packages
if make_rendering_work; then
  fingerprint >"$stamp"
  say "ready in $SECONDS s: $venv"
else
  # No stamp: the next run looks again. What needs no picture works meanwhile.
  say "the packages are ready in $venv, but drawing without a screen is not: see the line above."
fi
