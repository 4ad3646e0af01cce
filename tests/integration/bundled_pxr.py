"""Makes the `pxr` that is bundled with Blender as a module importable, if this Python has Blender (`bpy`)."""

try:
    import bpy
except ModuleNotFoundError:
    pass
else:
    bpy.utils.expose_bundled_modules()
