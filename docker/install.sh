#!/usr/bin/env bash
# docker/install.sh FOLDER UID: what the programs in FOLDER, as docker/build.sh made it, need to run as a user
# of their own. As root on a bare Debian 12; it is the image's second stage.
set -euo pipefail
readonly folder=$1 uid=$2

apt-get update -q
DEBIAN_FRONTEND=noninteractive xargs -a "$folder/apt.txt" \
    apt-get install -y -q --no-install-recommends
rm -rf /var/lib/apt/lists/*

useradd --uid "$uid" --no-create-home --home-dir /nonexistent --shell /usr/sbin/nologin usdlive
install -d -o usdlive -g usdlive /project /project/.usdlive
