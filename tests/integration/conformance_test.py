"""F1: the server's WebSocket under the Autobahn cases (kosoku), through an echo server made of the product's
transport."""

import asyncio
import os
import pathlib
import subprocess

import pytest
from kosoku import FailureError, run_fuzzingclient

ECHO_SERVER = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin/echo_server"
# All of RFC 6455; 12 and 13 are about compression, which the server never negotiates.
CASES = [f"{group}.*" for group in (1, 2, 3, 4, 5, 6, 7, 9, 10)]


@pytest.fixture
def echo_url():
    with subprocess.Popen([ECHO_SERVER], stdout=subprocess.PIPE, text=True) as process:
        yield f"ws://127.0.0.1:{int(process.stdout.readline())}/live"
        assert process.poll() is None, "the echo server ended"
        process.kill()


def test_f1_every_autobahn_case_passes(echo_url):
    try:
        results = asyncio.run(run_fuzzingclient(echo_url, CASES, None, concurrency=2))
    except FailureError as failure:
        results = failure.results
    verdicts = {"OK", "INFORMATIONAL"}
    failed = [f"{case.case_id}: {case.behavior.value}, close {case.behavior_close.value}: "
              f"{case.result} {case.result_close}" for case in results
              if {case.behavior.value, case.behavior_close.value} - verdicts]
    assert not failed
    assert len(results) == 301
