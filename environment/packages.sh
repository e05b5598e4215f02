# How packages are fetched: what setup.sh and try_wheel.sh share; not run by itself. They set `uv`, the place of that
# program, and have a `say`.
# shellcheck shell=bash disable=SC2154

# Progress only where somebody watches.
quiet=--quiet
if [ -t 1 ] && [ -t 2 ]; then quiet=; fi

pinned() { sed -n "s/^$1==\([^ ]*\).*/\1/p" environment/lock.txt; } # the version

pip_install() { # PYTHON ARGUMENT...
  local python=$1
  shift
  # shellcheck disable=SC2086
  "$python" -m pip install $quiet --disable-pip-version-check --no-input "$@"
}

uv_install() { # PYTHON ARGUMENT...
  local python=$1
  shift
  # shellcheck disable=SC2086
  # Compiled once, as pip does, and not by every process that imports it first.
  [ -x "$uv" ] && "$uv" pip install $quiet --system-certs --compile-bytecode --python "$python" "$@"
}

# uv does in seconds what takes pip a minute. Where it cannot (no build of it for this system, an index or a certificate
# that only pip's configuration knows), pip does.
install() { # PYTHON ARGUMENT...
  uv_install "$@" && return
  say "uv could not; once more by pip, slower"
  pip_install "$@"
}

# A CPU build that pip finds by its own configuration; otherwise PyTorch's own index, which uv knows by name.
install_cpu_torch() { # PYTHON VERSION
  pip_install "$1" --force-reinstall --no-deps "torch==$2+cpu" 2>/dev/null ||
    uv_install "$1" --reinstall-package torch --no-deps --torch-backend=cpu "torch==$2"
}

# "2.13.0 cpu" or "2.13.0 cuda"; nothing where there is none. By its metadata, because importing torch takes seconds.
torch_build() { # PYTHON
  "$1" - <<'PYTHON'
from importlib.metadata import PackageNotFoundError, distribution
try:
    torch = distribution("torch")
except PackageNotFoundError:
    raise SystemExit
cuda = any(need.startswith(("nvidia-", "cuda-")) for need in torch.requires or [])
print(torch.version.partition("+")[0], "cuda" if cuda else "cpu")
PYTHON
}

# Whether an NVIDIA GPU can be used here: by its device, which a container is given or not, whatever driver its host
# has; and by NVIDIA's own program under WSL, which has no such device, and where the device appears with its first use.
nvidia_devices='/dev/nvidia[0-9]*'
has_nvidia_gpu() {
  compgen -G "$nvidia_devices" >/dev/null && return
  case $(PATH=$PATH:/usr/lib/wsl/lib nvidia-smi --list-gpus 2>/dev/null) in
    GPU*) ;;
    *) return 1 ;;
  esac
}

# What torch is to be, by `auto`, `cpu` or `cuda`: `cpu`, `cuda` (the default build), or `any`, where whatever is there
# stays, and otherwise the CPU build is taken. So a folder that machines with and without a GPU share is not installed
# anew at every change between them. (uv's own `--torch-backend=auto` also takes builds for Intel's and AMD's cards, and
# the CUDA of the driver: neither is in the lock.)
torch_for() { # CHOICE
  case "$(uname -s) $1" in
    "Linux cpu" | "Linux cuda") echo "$1" ;;
    "Linux auto") if has_nvidia_gpu; then echo cuda; else echo any; fi ;;
    *) echo any ;; # there is only one build
  esac
}
