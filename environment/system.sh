# What setup.sh and browser.sh share; not run by itself. System packages are installed only where no question is asked.
# shellcheck shell=bash

may_install_system_packages() {
  [ "$(uname -s)" = Linux ] && command -v apt-get >/dev/null || return 1
  [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null
}

install_system_packages() {
  local as_root=
  [ "$(id -u)" = 0 ] || as_root="sudo -n"
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get update -qq >/dev/null || true
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends "$@" >/dev/null
}
