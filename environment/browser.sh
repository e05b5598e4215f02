#!/usr/bin/env bash
# Bring a Chromium for `make pdf` and for the tests that look at the pages, where none is here and it may: on Debian, as
# root or with a sudo that does not ask. Elsewhere it says how to get one. Run it as often as you like.
#
#   GVP_BROWSER=/path/to/chromium   one that is not found by itself
#   GVP_BROWSER_REQUIRED=1          end with 1 where there is none (so does CI=true); else the tests that want one are skipped
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=environment/system.sh
. environment/system.sh
python=${GVP_VENV:-$PWD/.venv}/bin/python

found() { "$python" book/browser.py >/dev/null 2>&1; }
is_debian() { grep -qx 'ID=debian' /etc/os-release 2>/dev/null; } # Ubuntu's package of that name wants snap

found && exit 0
if [ -z "${GVP_BROWSER:-}" ] && is_debian && may_install_system_packages; then
  echo "browser: installing chromium"
  install_system_packages chromium || echo "browser: apt-get failed"
  found && exit 0
fi
"$python" book/browser.py || true
[ -z "${GVP_BROWSER_REQUIRED:-}${CI:-}" ] || exit 1
echo "browser: without one, the tests of the pages are skipped"
