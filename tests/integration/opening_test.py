"""Opening layers without waiting, from Python: requests, events, and the event loop's form."""

import asyncio
import time

import pytest
from conftest import connect, wait, without_answers
from pxr import Usd

import usdlive
from usdlive import events

MANY = 500


@pytest.fixture
def server(project, serve):
    (project / "shot.usda").write_text(
        '#usda 1.0\n(\n    subLayers = [@./sub.usda@]\n)\n\ndef "Shot"\n{\n}\n')
    (project / "sub.usda").write_text('#usda 1.0\n\ndef "Sub"\n{\n}\n')
    (project / "many").mkdir()
    for number in range(MANY):
        (project / "many" / f"{number}.usda").write_text(f'#usda 1.0\n\ndef "P{number}"\n{{\n}}\n')
    return serve(project)


@pytest.fixture(params=["fast", "portable"])
def backend(request):
    return request.param


def ends_of(live: usdlive.Live) -> list:
    ends: list = []
    live.add_handler(lambda event: ends.append(event)
                     if isinstance(event, (events.LayerOpened, events.LayerOpenFailed)) else None)
    return ends


def test_many_layers_open_while_the_editor_ticks(server, uncollected):
    with connect(server, "ada") as live:
        ends = ends_of(live)
        requests = {live.request_open_layer(f"many/{number}.usda"): f"many/{number}.usda" for number in range(MANY)}
        assert not ends and live.opened_layer("many/0.usda") is None
        took, limit = [], time.monotonic() + 120
        while len(ends) < MANY:
            start = time.thread_time()  # not the wall's: others use the machine, too
            assert time.monotonic() < limit, len(ends)
            live.tick(4.0)
            took.append(time.thread_time() - start)
        assert {end.request: end.layer for end in ends} == requests
        assert all(isinstance(end, events.LayerOpened) for end in ends)
        assert sorted(took)[len(took) // 2] < 0.012, "half of the ticks kept about their budget"
        assert sum(one > 0.001 for one in took) >= 5, "few ticks did all of the work"
        assert live.opened_layer("many/499.usda").GetPrimAtPath("/P499")


def test_a_stage_opens_when_its_layers_are_there(server, backend):
    with connect(server, "ada", backend=backend) as live:
        ends = ends_of(live)
        live.request_open_layer("shot.usda")
        wait(lambda: ends, live)
        stage = Usd.Stage.Open(live.opened_layer("shot.usda"))
        assert stage.GetPrimAtPath("/Shot") and stage.GetPrimAtPath("/Sub")
        assert [live.layer_name(one) for one in stage.GetLayerStack()] == [None, "shot.usda", "sub.usda"]


def test_close_cancels(server, backend):
    with connect(server, "ada", backend=backend) as live:
        ends = ends_of(live)
        request = live.request_open_layer("shot.usda")
        live.close_layer("shot.usda")
        wait(lambda: ends, live)
        (end,) = ends
        assert isinstance(end, events.LayerOpenFailed) and end.request == request and end.code == "layerNotOpen"


def test_offline_a_request_waits_for_the_server(server, backend):
    with connect(server, "ada", backend=backend) as live:
        ends = ends_of(live)
        server.kill()
        wait(lambda: not live.connected, live)
        live.request_open_layer("shot.usda")
        for _ in range(20):
            live.tick()
        assert not ends
        server.start()
        wait(lambda: ends, live, timeout=30)
        assert isinstance(ends[0], events.LayerOpened) and live.opened_layer("sub.usda")


def test_an_event_handler_opens_layers(server, backend):
    with connect(server, "ada", backend=backend) as live:
        ends = ends_of(live)

        def follow(event):
            if isinstance(event, events.LayerOpened) and event.layer == "sub.usda":
                live.request_open_layer("many/1.usda")
                live.open_layer("many/2.usda")

        live.add_handler(follow)
        live.request_open_layer("sub.usda")
        wait(lambda: len(ends) == 2, live)
        assert live.opened_layer("many/1.usda") and live.opened_layer("many/2.usda")


def test_the_event_loop_keeps_running(server, backend):
    async def count(frames: list) -> None:
        while True:
            frames.append(time.monotonic())
            await asyncio.sleep(0.001)

    async def main(live: usdlive.Live) -> None:
        frames: list = []
        counting = asyncio.get_running_loop().create_task(count(frames))
        with without_answers(server):
            opening = asyncio.gather(live.open_layer_async("shot.usda"),
                                     *(live.open_layer_async(f"many/{number}.usda") for number in range(20)))
            await asyncio.sleep(0.5)
            assert not opening.done() and len(frames) > 5
        layer, *many = await opening
        assert layer.GetPrimAtPath("/Shot") and len(many) == 20
        with pytest.raises(usdlive.Error) as raised:
            await live.open_layer_async("nothing.usda")
        assert raised.value.code == "layerNotFound"
        counting.cancel()

    with connect(server, "ada", backend=backend) as live:
        asyncio.run(main(live))


def test_a_connection_that_is_closed_ends_what_waits_for_it(server, backend):
    """Also where somebody else calls tick()."""
    async def main() -> None:
        live = await usdlive.connect_async(server.url, user="ada", backend=backend)
        assert live.backend == backend
        seen: list = []

        async def watch(interval: float | None) -> None:
            async for event in live.events(interval):
                seen.append(event)

        waiting = [asyncio.ensure_future(one) for interval in (None, 0.01) for one in (
            watch(interval), live.open_layer_async(f"many/{interval or 0:g}.usda", interval=interval))]
        await asyncio.sleep(0)
        live.close()
        *ends, = await asyncio.wait_for(asyncio.gather(*waiting, return_exceptions=True), 10)
        assert [getattr(end, "code", end) for end in ends[::2]] == [None, None], "events() ends"
        for end in ends[1::2]:
            assert isinstance(end, usdlive.Error) and end.code in ("notConnected", "layerNotOpen", "layerNotFound"), end

    asyncio.run(main())


def test_a_stage_is_opened_and_edited_in_the_event_loop(server, backend):
    async def main() -> None:
        ada = await usdlive.connect_async(server.url, user="ada", backend=backend)
        bob = await usdlive.connect_async(server.url, user="bob", backend=backend)
        try:
            stage, other = await asyncio.gather(ada.open_stage_async("shot.usda"), bob.open_stage_async("shot.usda"))
            assert stage.GetPrimAtPath("/Sub")

            async def first_of_bob() -> events.Event:
                async for event in bob.events():
                    if isinstance(event, events.Committed):
                        return event

            watching = asyncio.ensure_future(first_of_bob())
            await asyncio.sleep(0)
            stage.DefinePrim("/Shot/New")
            assert ada.flush()
            assert (await asyncio.wait_for(watching, 20)).user == "ada"
            assert other.GetPrimAtPath("/Shot/New")
            with pytest.raises(usdlive.Error) as raised:
                await usdlive.connect_async("ws://127.0.0.1:1", backend=backend)
            assert raised.value.code == "notConnected"
        finally:
            ada.close()
            bob.close()

    asyncio.run(main())
