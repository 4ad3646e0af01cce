"""Opens a live layer, adds a prim and saves the layer on the server:

    python live.py usdlive://127.0.0.1:7447/shot.usda ada
"""

import asyncio
import sys

import omni


async def main(url: str, user: str) -> None:
    context = omni.usd.create_context("live", user=user)
    success, error = await context.open_stage_async(url)
    if not success:
        raise SystemExit(f"{url} did not open: {error}")
    prim = context.get_stage().DefinePrim(f"/{user}", "Xform")
    for frame in range(30):  # ordinary frames: receive the edits of others, send own edits
        prim.SetCustomDataByKey("frame", frame)
        await omni.kit.app.get_app().next_update_async()
    (result, err, saved_layers) = await context.save_stage_async()
    print("saved" if result else err, len(saved_layers))
    (result, err) = await context.close_stage_async()
    assert result and not err, err


asyncio.run(main(*sys.argv[1:]))
