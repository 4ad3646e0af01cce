#!/usr/bin/env bash
# docker/build.sh FOLDER: builds the server and the command line tool into FOLDER, with everything they need except
# system packages; it writes the names of those to FOLDER/apt.txt. This is the image's first stage. Run it as root on
# a bare Debian 12.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
readonly out=$1

./run setup
cmake --preset release -DUSDLIVE_TESTS=OFF -DUSDLIVE_PYTHON=OFF
cmake --build --preset release --target usdlive usdlive-server -j "${USDLIVE_JOBS:-$(nproc)}"
cmake --install build/release --component programs --prefix "$out" --strip

ldd "$out"/bin/* "$out"/lib/usdlive/usd_core.libs/* | awk '$3 ~ /^\/(usr\/)?lib/ {print $3}' |
    xargs realpath | sort -u |
    while read -r library; do dpkg -S "*${library#/usr}"; done |
    cut -d : -f 1 | sort -u >"$out/apt.txt"
