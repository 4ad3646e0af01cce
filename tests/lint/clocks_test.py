"""The time of day can jump by years: it is read only where a time of day is shown, stored or compared with that of a file.
Durations use a steady clock."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
WALL_CLOCK = re.compile(r"system_clock|file_time_type::clock|file_clock|utc_clock|CLOCK_REALTIME|CLOCK_TAI|\bgettimeofday\b|"
                        r"\bstd::time\(|(?<![\w.>:])::?time\(|time\(nullptr\)|time\(NULL\)")
# Each file that may read the time of day, and what for.
ALLOWED = {
    "server/src/app/AccessControl.cpp": "the end of an invitation, a day",
    "server/src/app/AccountCommands.cpp": "the end of an invitation, and when tokens were made, for people",
    "server/src/auth/AuditFile.cpp": "the time of a record, for people",
    "server/src/app/ServedProject.cpp": "the project's clock; TimeOfDay leaves out its jumps (CH6)",
    "server/src/files/AssetFiles.cpp": "compares it with the times of files",
    "server/src/transport/DdsServer.cpp": "the start time of the server, which other processes compare (DD1)",
    "client/src/basics/Clocks.h": "times of locks and of unsent work, for people",
    "client/src/values/BlobCache.cpp": "sets and compares the times of files",
    "client/src/work/Journal.cpp": "compares it with the time of a file",
    "client/src/cli/Commands.cpp": "the time of a lock, for people",
    "client/src/history/Moment.cpp": "times as people write them, such as two hours ago",
    "common/src/fetch/IssuerSignIn.cpp": "the end of a token",
    "common/src/fetch/HashCache.cpp": "compares it with the times of files",
    "plugins/edf/museum/Fetcher.cpp": "the time until which an answer is fresh, for a day at most",
}


def test_only_some_files_read_the_time_of_day():
    found = set()
    for folder in ("common", "server", "client", "plugins"):
        for file in (ROOT / folder).rglob("*"):
            if file.suffix not in {".h", ".cpp"}:
                continue
            code = re.sub(r"//.*", "", file.read_text(encoding="utf-8"))
            if WALL_CLOCK.search(code):
                found.add(str(file.relative_to(ROOT)))
    assert found - ALLOWED.keys() == set(), "use std::chrono::steady_clock, or ports::Clock::steadyMs(), for durations"
    assert ALLOWED.keys() - found == set(), "remove it from ALLOWED"
