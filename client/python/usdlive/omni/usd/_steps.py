"""Runs one operation either blocking or beside the event loop.

An operation is a generator. It uses the stage itself, and yields slow work: a function without arguments that
may run in a thread (the `yield` returns its result or raises its exception), or `Until`.
"""

from __future__ import annotations

import asyncio
import dataclasses
import time
import typing

from usdlive.omni.kit.app import get_app

T = typing.TypeVar("T")
Work = typing.Callable[[], typing.Any]


@dataclasses.dataclass(frozen=True)
class Until:
    """Runs frames until `condition()` is true, for at most `seconds`. The `yield` returns whether it became
    true."""

    condition: typing.Callable[[], bool]
    frame: typing.Callable[[], None]  # runs a frame if no application does
    seconds: float


Steps = typing.Generator[Work | Until, typing.Any, T]


def run(steps: Steps[T]) -> T:
    """Runs the operation to its end, blocking."""
    try:
        step = next(steps)
        while True:
            try:
                answer = _frames(step) if isinstance(step, Until) else step()
            except Exception as error:  # the operation decides
                step = steps.throw(error)
            else:
                step = steps.send(answer)
    except StopIteration as end:
        return end.value


async def run_async(steps: Steps[T]) -> T:
    """Runs the operation beside the event loop. If it is cancelled, the operation fails."""
    try:
        step = next(steps)
        while True:
            try:
                if isinstance(step, Until):
                    answer = await _frames_async(step)
                else:
                    answer = await asyncio.to_thread(step)
            except Exception as error:  # noqa: BLE001
                step = steps.throw(error)
            else:
                step = steps.send(answer)
    except StopIteration as end:
        return end.value
    finally:
        steps.close()


def _frames(until: Until) -> bool:
    end = time.monotonic() + until.seconds
    while not until.condition():
        if time.monotonic() > end:
            return False
        until.frame()
        time.sleep(0.002)
    return True


async def _frames_async(until: Until) -> bool:
    end = time.monotonic() + until.seconds
    while not until.condition():
        if time.monotonic() > end:
            return False
        await get_app().next_update_async()
    return True
