#!/bin/sh
# Find the Chromium for the tests of pages, or install it as root.
#
#   tools/get_browser.sh
#
# Prints its path; exits 1 if there is none. Then those tests are skipped, unless
# GRAVITY_COMP_BROWSER=required.
set -eu

for name in chromium chromium-browser google-chrome; do
    if command -v "$name"; then
        exit 0
    fi
done
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo 'Installing Chromium for the tests of pages.' >&2
    { timeout 60 apt-get -qq update && DEBIAN_FRONTEND=noninteractive timeout 180 apt-get -qq install -y \
        --no-install-recommends chromium fonts-dejavu-core; } >/dev/null 2>&1 || true
    command -v chromium && exit 0
fi
echo 'No Chromium here: tests of pages are skipped (Debian: apt install chromium;' \
    'elsewhere: any Chrome on PATH as google-chrome)' >&2
exit 1
