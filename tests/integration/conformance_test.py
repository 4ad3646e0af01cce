"""F1: runs the Autobahn cases (kosoku) against the server's WebSocket, in an echo server that uses the
product's transport."""

import asyncio
import concurrent.futures
import multiprocessing
import os
import pathlib
import subprocess

import pytest

ECHO_SERVER = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "bin/echo_server"
# All groups of RFC 6455; 12 and 13 test compression, which the server never negotiates.
CASES = [f"{group}.*" for group in (1, 2, 3, 4, 5, 6, 7, 9, 10)]


@pytest.fixture
def echo_url():
    with subprocess.Popen([ECHO_SERVER], stdout=subprocess.PIPE, text=True) as process:
        yield f"ws://127.0.0.1:{int(process.stdout.readline())}/live"
        assert process.poll() is None, "the echo server ended"
        process.kill()


def run_cases(url):
    """Returns how many cases ran and which failed. Runs in its own process, because kosoku replaces its
    import path and binascii."""
    from kosoku import FailureError, run_fuzzingclient

    try:
        results = asyncio.run(run_fuzzingclient(url, CASES, None, concurrency=2))
    except FailureError as failure:
        results = failure.results
    verdicts = {"OK", "INFORMATIONAL"}
    failed = [f"{case.case_id}: {case.behavior.value}, close {case.behavior_close.value}: "
              f"{case.result} {case.result_close}" for case in results
              if {case.behavior.value, case.behavior_close.value} - verdicts]
    return len(results), failed


def test_f1_every_autobahn_case_passes(echo_url):
    spawn = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn) as executor:
        count, failed = executor.submit(run_cases, echo_url).result()
    assert not failed
    assert count == 301
