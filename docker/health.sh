#!/usr/bin/env bash
# Succeeds if the server answers and accepts edits. (The image has no curl.) An encrypted server only has to answer,
# because nothing in the image could decrypt more.
set -euo pipefail
exec 3<>/dev/tcp/127.0.0.1/7447
printf 'GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n' >&3
grep -e '"status":"ok"' -e 'this server speaks TLS' <&3
