"""Checks that threads start in one place (common/core/Thread.h), where a refusal of the system becomes an error that says
what to do. A thread that a library starts throws std::system_error, which ends the process if nobody expects it."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDERS = ["common", "server", "client", "plugins"]
# Starts a thread: std::thread(...), std::jthread(...), a pool, a resolver of Asio, std::async. With `deferred`,
# std::async() does the work later on the caller's thread if the system refuses one.
STARTS = re.compile(r"std::j?thread\s*[({]|\bthread_pool\b|\basync_resolve\b|std::async\(std::launch::async,|pthread_create")
# GuardedCall returns the refusal as the reason of the call.
ALLOWED = {"common/include/usdlive/common/core/Thread.h", "plugins/edf/format/GuardedCall.cpp"}


def test_threads_start_in_one_place():
    found = []
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix not in (".h", ".cpp") or str(path.relative_to(ROOT)) in ALLOWED:
                continue
            for number, line in enumerate(path.read_text().splitlines(), 1):
                if STARTS.search(line.split("//")[0]):
                    found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not found, "use startThread():\n" + "\n".join(found)
