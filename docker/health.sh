#!/usr/bin/env bash
# Succeeds if the server answers and accepts edits. (The image has no curl.)
set -euo pipefail
exec 3<>/dev/tcp/127.0.0.1/7447
printf 'GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n' >&3
grep '"status":"ok"' <&3
