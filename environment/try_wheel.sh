#!/usr/bin/env bash
# Build the wheel and use it as a stranger would: a new environment, only the wheel and what pip brings for it,
# an empty folder, no clone in sight.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=${GVP_VENV:-$PWD/.venv}/bin/python
unset PYTHONPATH VIRTUAL_ENV

rm -rf dist
"$python" -m build --wheel --no-isolation --outdir dist . >/dev/null
wheel=$(ls "$PWD"/dist/*.whl)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

"$python" -m venv "$scratch/env"
"$scratch/env/bin/python" -m pip install --quiet --disable-pip-version-check "$wheel"
mkdir "$scratch/empty"
cd "$scratch/empty"
"$scratch/env/bin/gvp" doctor
"$scratch/env/bin/python" - <<'PYTHON'
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
echo "$(basename "$wheel"): $(wc -c <"$wheel" | tr -d ' ') bytes, works alone."
