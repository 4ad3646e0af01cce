"""Generates a project whose files name each other in every way that OpenUSD knows, for resolver_test.py."""

from __future__ import annotations

import pathlib
import random

from pxr import Sdf, Usd, UsdGeom, UsdUtils

GROUPS, PRIMS = 50, 100  # 5,000 prims with a texture each


def write_texture(path: pathlib.Path, seed: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"\x89PNG" + random.Random(seed).randbytes(300))


def write_package(folder: pathlib.Path) -> None:
    """A .usdz with a layer, a layer that it references, and textures, one of them a UDIM."""
    inside = folder.parent / "unpacked"
    inside.mkdir()
    for name in ("wood.png", "tile.1001.png", "tile.1002.png"):
        write_texture(inside / name, "package " + name)
    (inside / "part.usda").write_text('#usda 1.0\n(\n    defaultPrim = "Part"\n)\ndef "Part"\n{\n'
                                      "    asset inner = @./wood.png@\n}\n")
    root = inside / "chair.usda"
    root.write_text('#usda 1.0\n(\n    defaultPrim = "Chair"\n)\ndef "Chair"\n{\n    asset wood = @./wood.png@\n'
                    '    def "Leg" (references = @./part.usda@)\n    {\n    }\n}\n')
    assert UsdUtils.CreateNewUsdzPackage(str(root), str(folder / "chair.usdz"))


def write_group(folder: pathlib.Path, number: int) -> None:
    """A group of prims, in its own folder, in text or binary, with a texture for each prim."""
    name = f"group{number:03}"
    ending = ("usda", "usdc", "usd")[number % 3]
    layer = Sdf.Layer.CreateNew(str(folder / "groups" / name / f"{name}.{ending}"))
    layer.defaultPrim = "Group"
    with Sdf.ChangeBlock():
        root = Sdf.CreatePrimInLayer(layer, "/Group")
        root.specifier = Sdf.SpecifierDef
        for index in range(PRIMS):
            prim = Sdf.PrimSpec(root, f"P{index:03}", Sdf.SpecifierDef, "Cube")
            texture = f"tex/t{index % 7}.png" if index % 2 else f"../../shared/s{index % 11}.png"
            Sdf.AttributeSpec(prim, "inputs:file", Sdf.ValueTypeNames.Asset).default = Sdf.AssetPath(
                texture if index % 3 else "./" + texture)
    layer.Save()
    for index in range(7):
        write_texture(folder / "groups" / name / "tex" / f"t{index}.png", f"{name} {index}")


def make_project(folder: pathlib.Path) -> pathlib.Path:
    """Returns the project's root layer."""
    folder.mkdir()
    (folder / "groups").mkdir()
    for index in range(11):
        write_texture(folder / "shared" / f"s{index}.png", f"shared {index}")
    for number in range(GROUPS):
        write_group(folder, number)
    write_package(folder)
    for tile in (1001, 1002, 1012):
        write_texture(folder / "udim" / f"skin@2x.{tile}.png", f"udim {tile}")
    write_texture(folder / "my tex" / "100% ä@2.png", "odd name")
    (folder / "linked").symlink_to("shared")
    (folder / "same.png").symlink_to("shared/s1.png")
    clips = folder / "clips"
    clips.mkdir()
    (clips / "manifest.usda").write_text('#usda 1.0\ndef "Anim"\n{\n    double x\n}\n')
    for frame in (1, 2):
        (clips / f"clip.{frame}.usda").write_text(
            f'#usda 1.0\ndef "Anim"\n{{\n    double x.timeSamples = {{ {frame}: {frame}0 }}\n}}\n')

    (folder / "look.usda").write_text('''#usda 1.0
over "World"
{
    over "Stronger"
    {
        asset file = @./shared/s2.png@
        asset look = @./shared/s2.png@
    }
}
''')
    groups = "\n".join(
        f'    def "G{number:03}" ({"payload" if number % 2 else "references"} = '
        f'@./groups/group{number:03}/group{number:03}.{("usda", "usdc", "usd")[number % 3]}@)\n    {{\n    }}'
        for number in range(GROUPS))
    root = folder / "shot.usda"
    root.write_text(f'''#usda 1.0
(
    defaultPrim = "World"
    subLayers = [@./look.usda@, @missing.usda@]
    startTimeCode = 1
    endTimeCode = 2
)
def "World" (
    variants = {{ string kind = "two" }}
    prepend variantSets = "kind"
    assetInfo = {{ asset identifier = @./shot.usda@ }}
)
{{
{groups}
    def "Stronger"
    {{
        asset file = @./shared/s1.png@
        asset missing = @./nothing.png@
        asset empty = @@
        asset away = @../outside.png@
        asset elsewhere = @/nowhere/at/all.png@
        asset odd = @./my tex/100% ä@2.png@
        asset link = @./same.png@
        asset linkedFolder = @linked/s3.png@
        asset udim = @./udim/skin@2x.<UDIM>.png@
        asset searched = @s4.png@
        asset[] many = [@./shared/s5.png@, @shared/s6.png@, @./nothing.png@]
        asset animated.timeSamples = {{ 1: @./shared/s7.png@, 2: @./shared/s8.png@ }}
    }}
    def "Chair" (references = @./chair.usdz@)
    {{
    }}
    def "Leg" (references = @./chair.usdz[part.usda]@)
    {{
        asset packed = @./chair.usdz[wood.png]@
        asset tiles = @./chair.usdz[tile.<UDIM>.png]@
    }}
    def "Anim" (
        clips = {{
            dictionary default = {{
                asset manifestAssetPath = @./clips/manifest.usda@
                string primPath = "/Anim"
                asset[] assetPaths = [@./clips/clip.1.usda@, @./clips/clip.2.usda@]
                double2[] active = [(1, 0), (2, 1)]
                double2[] times = [(1, 1), (2, 2)]
            }}
        }}
    )
    {{
    }}
    variantSet "kind" = {{
        "one" {{
            def "Choice" (references = @./groups/group000/group000.usda@)
            {{
            }}
        }}
        "two" {{
            def "Choice" (payload = @./groups/group001/group001.usdc@</Group/P001>)
            {{
            }}
        }}
    }}
}}
'''.replace("@./my tex/100% ä@2.png@", "@@@./my tex/100% ä@2.png@@@")
   .replace("@./udim/skin@2x.<UDIM>.png@", "@@@./udim/skin@2x.<UDIM>.png@@@"))
    return root
