#!/usr/bin/env bash
# Build the wheel and use it as a stranger would, in new environments, with this clone out of sight: by plain pip, with
# the newest of what it asks for, alone and then with torch, newer than the lock's; and, with its extras as locked, under
# the notebooks. They lie beside the stored results, as they do for a reader who has downloaded both.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
clone=$(pwd -P)
python=${GVP_VENV:-$clone/.venv}/bin/python
uv=${GVP_VENV:-$clone/.venv}/bin/uv
unset PYTHONPATH VIRTUAL_ENV
say() { echo "wheel: $*"; }
# shellcheck source=environment/packages.sh
. environment/packages.sh

rm -rf dist
"$python" -m build --wheel --no-isolation --outdir dist . >/dev/null
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cp dist/*.whl "$scratch"
wheel=$(ls "$scratch"/*.whl)
stranger=$scratch/newest/bin
reader=$scratch/locked/bin

# For the stranger's processes the clone is an empty folder, where this user may mount one.
for unshare in "unshare --mount" "unshare --map-root-user --mount" ""; do
  if [ -z "$unshare" ] || $unshare mount -t tmpfs none "$clone" 2>/dev/null; then break; fi
done
[ -n "$unshare" ] || say "this system lets nobody hide the clone; it is watched instead"
as_stranger() {
  if [ -z "$unshare" ]; then
    "$@"
  else
    # shellcheck disable=SC2016
    $unshare bash -c 'mount -t tmpfs none "$0" && exec "$@"' "$clone" "$@"
  fi
}

# Anywhere, a process of these environments that looks for a file of the clone fails.
make_environment() { # FOLDER
  "$python" -m venv "$1"
  local site
  site=$("$1/bin/python" -c 'import sysconfig; print(sysconfig.get_paths()["purelib"])')
  cat >"$site/absent.py" <<PYTHON
import os, sys

def refuse(event, args):
    if event in ("open", "os.listdir", "os.scandir") and isinstance(args[0], (str, bytes)):
        if os.path.abspath(os.fsdecode(args[0])).startswith("$clone/"):
            raise RuntimeError(f"{os.fsdecode(args[0])} is in the clone, of which the wheel must know nothing")

sys.addaudithook(refuse)
PYTHON
  echo "import absent" >"$site/absent.pth"
}

make_environment "$scratch/newest"
pip_install "$stranger/python" "$wheel"
mkdir "$scratch/empty"
cd "$scratch/empty"
as_stranger "$stranger/gvp" doctor
as_stranger "$stranger/python" - <<'PYTHON'
import gvp_lib
from gvp_lib.errors import MissingExtraError

extras = []
for name in gvp_lib.__all__:
    try:
        getattr(gvp_lib, name)
    except MissingExtraError as error:
        extras.append(str(error))
core = len(gvp_lib.__all__) - len(extras)
print(f"gvp_lib {gvp_lib.__version__}: {core} public names work without an extra, from {gvp_lib.__path__[0]}")
print(*extras, sep="\n")
assert core > 20, extras
cell = gvp_lib.WorkCell(arm="ur5e", seed=1)
print("the UR5e sees a blob of", gvp_lib.Blob.from_mask(cell.segmenter(cell.arm.capture())).area, "px")
PYTHON
say "$(basename "$wheel"), $(wc -c <"$wheel" | tr -d ' ') bytes, works alone"

# Without an NVIDIA GPU, PyTorch's CPU build spares gigabytes, where its own index can be reached.
if [ "$(torch_for auto)" = any ] && uv_install "$stranger/python" --torch-backend=cpu torch 2>/dev/null; then
  say "the newest torch, in its CPU build"
fi
pip_install "$stranger/python" "${wheel}[learning]"
as_stranger "$stranger/gvp" collect --arm floating --n 64 --rolls 4 --step 10 --quiet set
as_stranger "$stranger/python" - <<'PYTHON'
import torch

import gvp_lib

# One process draws, trains and draws again: what renders in software and a build of torch share libraries.
with gvp_lib.WorkCell(arm="floating", seed=1) as cell:
    cell.arm.capture()
    config = gvp_lib.TrainConfig(network="resnet18_half", size=32, epochs=1)
    training = gvp_lib.train("set", "run", config, progress=False)
    action = gvp_lib.NetworkPolicy(training.trained)(cell.arm.capture())
loss = training.history[0]["loss"]
print(f"torch {torch.__version__}: after an epoch the loss is {loss:.2f}, and the network says {action.name}")
PYTHON
say "it trains with the newest torch"

cd "$clone"
make_environment "$scratch/locked"
if [ "$(uname -s)" = Linux ] && [[ $(torch_build "$python") = *cpu ]]; then
  install_cpu_torch "$reader/python" "$(pinned torch)"
fi
install "$reader/python" --constraint environment/lock.txt --constraint environment/lock-cuda.txt \
  "${wheel}[notebooks,learning]"
mkdir -p "$scratch/reader/notebooks" "$scratch/reader/book/results"
cp notebooks/*.ipynb "$scratch/reader/notebooks"
cp book/results/*.json "$scratch/reader/book/results"
cd "$scratch/reader/notebooks"
as_stranger "$reader/python" -c 'import gvp_lib; [getattr(gvp_lib, name) for name in gvp_lib.__all__]'

# Several at a time, four at most, as the tests; the cores are shared out among them, and to what draws and solves.
cores=$(getconf _NPROCESSORS_ONLN)
jobs=$((cores < 4 ? cores : 4))
threads=$((cores / jobs))
export OMP_NUM_THREADS=$threads OPENBLAS_NUM_THREADS=$threads MKL_NUM_THREADS=$threads LP_NUM_THREADS=$threads
export JUPYTER_PREFER_ENV_PATH=1 # this environment's kernel, not the user's
# shellcheck disable=SC2016
printf '%s\0' *.ipynb | as_stranger xargs -0 -n 1 -P "$jobs" bash -c '
  if log=$("$0" --timeout=600 "$1" 2>&1); then
    echo "wheel: $1: $SECONDS s"
  else
    printf "wheel: %s fails:\n%s\n" "$1" "$log"
    exit 1
  fi' "$reader/jupyter-execute"
say "with its extras it runs every notebook"
