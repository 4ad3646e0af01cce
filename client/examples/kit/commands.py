"""Layer commands and undo."""

import omni

context = omni.usd.get_context()
context.new_stage()
stage = context.get_stage()
stage.DefinePrim("/World/Ball", "Sphere")
root = stage.GetRootLayer()

# Moves the content of the root layer to a new sublayer, and undoes both commands as one.
with omni.kit.undo.group():
    ok, sublayer = omni.kit.commands.execute(
        "CreateSublayer", layer_identifier=root.identifier, sublayer_position=0, new_layer_path="",
        transfer_root_content=True, create_or_insert=True, layer_name="content")
    omni.kit.commands.execute("SetEditTarget", layer_identifier=sublayer)
assert ok and not root.rootPrims and stage.GetPrimAtPath("/World/Ball")
print("sublayers:", len(root.subLayerPaths), "edit target is the new one:",
      stage.GetEditTarget().GetLayer().identifier == sublayer)

result = omni.kit.undo.undo()
assert result and root.GetPrimAtPath("/World/Ball")
print("undone", result.name, "and not restored:", list(result.kept))
omni.kit.undo.redo()
omni.kit.commands.execute("FlattenLayers")
print("flattened:", not root.subLayerPaths and bool(root.GetPrimAtPath("/World/Ball")))
context.close_stage()
