"""New, open, save, export, close and reopen, as in Kit's guide to the file system."""

import asyncio
import os
import tempfile

import omni


async def main() -> None:
    context = omni.usd.get_context()
    with tempfile.TemporaryDirectory() as folder:
        await context.new_stage_async()
        await omni.kit.app.get_app().next_update_async()
        context.get_stage().DefinePrim("/World/Ball", "Sphere")

        path = os.path.join(folder, "ball.usda")
        (result, err, saved_layers) = await context.save_as_stage_async(path)
        assert result, err
        print("saved", [os.path.basename(layer) for layer in saved_layers])

        # An error is returned with its reason; nothing is raised.
        success, error = await context.open_stage_async(os.path.join(folder, "missing.usd"))
        assert not success and "missing.usd" in error
        print("not opened:", os.path.basename(error))

        success, error = await context.open_stage_async(path)
        assert success, error
        context.get_stage().DefinePrim("/World/Unsaved")
        print("unsaved edits:", context.has_pending_edit())
        (result, err) = await context.reopen_stage_async()
        assert result and not context.get_stage().GetPrimAtPath("/World/Unsaved")

        (result, err) = await context.export_as_stage_async(os.path.join(folder, "flat.usdc"))
        assert result, err
        print("files:", sorted(os.listdir(folder)))
        (result, err) = await context.close_stage_async()
        assert result, err


asyncio.run(main())
