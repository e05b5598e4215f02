#!/usr/bin/env bash
# Bring a Chromium for `make pdf` and for the tests that look at the pages, where none is here and it may: on Debian, as
# root or with a sudo that does not ask; elsewhere the one that Playwright downloads. Where neither comes,
# it says how to get one. Run it as often as you like.
#
#   GVP_BROWSER=/path/to/chromium   one that is not found by itself
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
if [ -z "${GVP_BROWSER:-}" ]; then
  echo "browser: fetching Playwright's chromium"
  "$python" -m playwright install chromium >/dev/null 2>&1 || echo "browser: it could not be fetched"
fi
"$python" book/browser.py # says how to get one, and ends with 1, where there still is none
