#!/usr/bin/env bash
# Make this clone ready: a virtual environment in .venv with exactly what environment/lock.txt pins, this project
# in it (editable), and, where they are missing and it may, the system libraries that draw without a screen.
# Run it as often as you like: with nothing changed it ends at once. It never asks a question.
#
#   PYTHON=python3.12       the Python to build on (3.11 or later); default: the first that fits
#   GVP_TORCH=cpu           on Linux, torch without its gigabytes of CUDA; `cuda`: with them; `auto`, the default: with
#                           them only where an NVIDIA GPU is found
#   GVP_VENV=/some/folder   where the environment goes; default: .venv beside pyproject.toml
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
cd "$root"
venv=${GVP_VENV:-$root/.venv}
uv=$venv/bin/uv
stamp=$venv/gvp-setup.stamp
choice=$venv/gvp-torch # what GVP_TORCH last asked for
system_packages="libegl1 libgl1 libgl1-mesa-dri"

steps=0
say() { echo "setup: $*"; }
step() { steps=$((steps + 1)) && say "$steps of 4: $*"; }
stop() { printf 'setup: %s\n' "$@" >&2; exit 1; }

# shellcheck source=environment/system.sh
. environment/system.sh
# shellcheck source=environment/packages.sh
. environment/packages.sh

case "${GVP_TORCH:-auto}" in
  auto | cpu | cuda) ;;
  *) stop "GVP_TORCH is '$GVP_TORCH'; it may be 'cpu', 'cuda' (torch's default build) or 'auto'." ;;
esac
asked=${GVP_TORCH:-$(cat "$choice" 2>/dev/null || echo auto)}
wanted=$(torch_for "$asked")
# Tools that an active environment or a caller's path would lead astray.
unset PYTHONPATH PYTHONHOME VIRTUAL_ENV CONDA_PREFIX

# What the environment was made from. The places count: scripts in an environment hold its path, and an editable
# install holds the clone's.
fingerprint() {
  echo "$venv"
  echo "$root"
  cat environment/{lock,lock-cuda}.txt environment/{setup,system,packages}.sh pyproject.toml | cksum
}

is_ready() {
  local stamped
  stamped=$(cat "$stamp" 2>/dev/null) || return 1
  [ "${stamped#*$'\n'}" = "$(fingerprint)" ] || return 1
  [ "$wanted" = any ] || [ "${stamped%%$'\n'*}" = "torch: $asked, $wanted" ] ||
    [ "$(torch_build "$venv/bin/python")" = "$(pinned torch) $wanted" ]
}

# A choice stays with the environment, so that later calls need not repeat it.
remember_choice() { [ -z "${GVP_TORCH:-}" ] || echo "$GVP_TORCH" >"$choice"; }

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
  say "making it with $("$python" --version)"
  if ! "$python" -m venv --clear "$venv"; then
    stop "'$python -m venv' failed. On Debian and Ubuntu: sudo apt-get install python3-venv"
  fi
}

install_torch() {
  local python=$venv/bin/python version had
  version=$(pinned torch)
  had=$(torch_build "$python")
  case "$wanted: $had" in
    "any: $version "* | "$wanted: $version $wanted")
      step "torch $version stays as it is"
      return
      ;;
  esac
  if [ "$(uname -s)" = Linux ] && [ "$wanted" != cuda ]; then
    step "torch $version, the CPU build (200 MB)"
    if install_cpu_torch "$python" "$version"; then
      [ "${had#* }" != cuda ] || "$python" -m pip uninstall --quiet --yes -r environment/lock-cuda.txt
      return
    fi
    [ "$wanted" = any ] ||
      stop "no CPU build of torch $version could be fetched. Is there a network? GVP_TORCH=cuda takes the default one."
    say "no CPU build could be fetched; taking the default one, which brings gigabytes of CUDA"
  else
    step "torch $version, the default build for this system ($([ "$(uname -s)" = Linux ] && echo 530 || echo 110) MB)"
  fi
  install "$python" --force-reinstall --no-deps "torch==$version" && return
  [ "$asked $had" = "auto $version cpu" ] || stop "torch $version could not be fetched. Is there a network?"
  say "there is an NVIDIA GPU, but the build for it could not be fetched: the CPU build stays." \
    "'GVP_TORCH=cuda environment/setup.sh' tries again"
}

install_packages() {
  local python=$venv/bin/python
  step "a Python environment in $venv, with uv (20 MB)"
  make_venv
  pip_install "$python" "uv==$(pinned uv)" || say "uv is not to be had here"
  install_torch
  step "what is not here yet of the $(grep -c '^[a-z]' environment/lock.txt) packages of environment/lock.txt (450 MB)"
  install "$python" --no-deps -r environment/lock.txt
  case $(torch_build "$python") in
    *cuda)
      say "and of NVIDIA's, of environment/lock-cuda.txt (2200 MB)"
      install "$python" --no-deps -r environment/lock-cuda.txt
      ;;
  esac
  step "gvp_lib itself, from this folder, and a first picture by MuJoCo"
  install "$python" --no-deps --no-build-isolation --editable .
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

if is_ready; then
  remember_choice
  exit 0
fi
rm -f "$stamp"
install_packages
remember_choice
if make_rendering_work; then
  { echo "torch: $asked, $wanted" && fingerprint; } >"$stamp"
  say "ready in $SECONDS s: $venv"
else
  # No stamp: the next run looks again. What needs no picture works meanwhile.
  say "the packages are ready in $venv, but drawing without a screen is not: see the line above."
fi
