"""One operation, written once, that runs blocking or beside the event loop.

An operation is a generator. It touches the stage itself, and yields what takes long: a function without
arguments that may run in a thread (its result or its exception comes back from the `yield`), or `Until`.
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
    """Frames go by until `condition()`, at most `seconds`; the `yield` gives whether it came true."""

    condition: typing.Callable[[], bool]
    frame: typing.Callable[[], None]  # what lets it come true where no application makes frames
    seconds: float


Steps = typing.Generator[Work | Until, typing.Any, T]


def run(steps: Steps[T]) -> T:
    """To its end, here and now."""
    try:
        step = next(steps)
        while True:
            try:
                answer = _frames(step) if isinstance(step, Until) else step()
            except Exception as error:  # noqa: BLE001 - the operation's to judge
                step = steps.throw(error)
            else:
                step = steps.send(answer)
    except StopIteration as end:
        return end.value


async def run_async(steps: Steps[T]) -> T:
    """The same while the loop goes on. Cancelled, the operation ends as failed."""
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
