#!/usr/bin/env bash
# docker/install.sh FOLDER UID: installs the system packages for the programs in FOLDER, which docker/build.sh
# created, and adds the user that runs them. This is the image's second stage. Run it as root on a bare Debian 12.
set -euo pipefail
readonly folder=$1 uid=$2

apt-get update -q
DEBIAN_FRONTEND=noninteractive xargs -a "$folder/apt.txt" \
    apt-get install -y -q --no-install-recommends
rm -rf /var/lib/apt/lists/*

useradd --uid "$uid" --no-create-home --home-dir /nonexistent --shell /usr/sbin/nologin usdlive
install -d -o usdlive -g usdlive /project /project/.usdlive
