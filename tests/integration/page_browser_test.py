"""The page in a real browser, with a real gateway, server and editors."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import pathlib
import re
import shutil
import struct
import types
import zlib

import pytest
import usdlive
from conftest import Peer, run
from page_client import Gateway
from page_screen import CHROMIUM, SOFTWARE, VIEWPORT, Screen
from playwright.sync_api import sync_playwright

# A browser is started once.
pytestmark = pytest.mark.xdist_group("browser")

LAYOUT = """#usda 1.0
(
    defaultPrim = "World"
    upAxis = "Z"
    metersPerUnit = 1
)

def Xform "World"
{
    def Cube "Floor"
    {
        color3f[] primvars:displayColor = [(0.3, 0.32, 0.35)]
        double3 xformOp:scale = (6, 6, 0.1)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }

    def Cube "Box"
    {
        double size = 1.8
        color3f[] primvars:displayColor = [(0.8, 0.05, 0.04)]
        double3 xformOp:translate = (-3, 0, 1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def Sphere "Ball"
    {
        double radius = 1
        color3f[] primvars:displayColor = [(0.03, 0.15, 0.8)]
        double3 xformOp:translate = (0.5, -1, 1.1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def Cone "Cone"
    {
        color3f[] primvars:displayColor = [(0.04, 0.5, 0.08)]
        double3 xformOp:translate = (1, 3.5, 1.1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def Camera "Shot"
    {
        float focalLength = 35
        double3 xformOp:translate = (0, -16, 4)
        float3 xformOp:rotateXYZ = (78, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }
}
"""
ROOT = """#usda 1.0
(
    defaultPrim = "World"
    upAxis = "Z"
    metersPerUnit = 1
    startTimeCode = 1
    endTimeCode = 48
    subLayers = [@anim.usda@, @layout.usda@]
)
"""
ANIM = """#usda 1.0

over "World"
{
    over "Ball"
    {
        double radius = 1.25
    }
}
"""


@pytest.fixture(scope="module")
def tools():
    with sync_playwright() as made:
        yield made


@pytest.fixture(scope="module")
def browser(tools):
    made = tools.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
    yield made
    made.close()


@pytest.fixture
def gateways(tmp_path):
    """gateways(server) starts a gateway that is stopped after the test."""
    made: list[Gateway] = []

    def start(server, *options: str) -> Gateway:
        folder = tmp_path / f"gateway{len(made)}"
        folder.mkdir()
        made.append(Gateway(server.url, folder, *options).start())
        return made[-1]

    yield start
    for one in made:
        if one.process.poll() is None:
            one.stop()


@pytest.fixture
def screens(browser):
    """screens(gateway) opens the page; what it complains about fails the test."""
    made: list[Screen] = []

    def show(gateway: Gateway, **options) -> Screen:
        made.append(Screen(browser, gateway.address, **options))
        return made[-1]

    yield show
    for one in made:
        one.close()


@pytest.fixture
def studio(project, serve):
    """A server with a stage of three layers."""
    for name, text in {"root.usda": ROOT, "anim.usda": ANIM, "layout.usda": LAYOUT}.items():
        (project / name).write_text(text)
    return serve(project)


@contextlib.contextmanager
def ticking(editor, flag: pathlib.Path, code: str):
    """The editor runs the code and ticks until the end of the block: who does not tick is not there."""
    loop = f"{code}\nimport os\nwhile not os.path.exists({str(flag)!r}): live.wait(lambda: False, 0.05)"
    editor.process.stdin.write(json.dumps(loop) + "\n")
    editor.process.stdin.flush()
    yield
    flag.touch()
    editor._answer()
    flag.unlink()


def looking_from(x: float, y: float) -> str:
    """The statement with which an editor shows that it has selected the box, and its camera."""
    return (f"live.show_presence(['/World/Box'], Gf.Matrix4d().SetLookAt(Gf.Vec3d({x}, {y}, 6), Gf.Vec3d(0, 0, 0),"
            " Gf.Vec3d(0, 0, 1)).GetInverse())")


def is_red(color) -> bool:
    return color[0] > 90 and color[0] > 2 * max(color[1], color[2])


def is_green(color) -> bool:
    return color[1] > 70 and color[1] > 1.3 * max(color[0], color[2])


def is_blue(color) -> bool:
    return color[2] > 90 and color[2] > 1.4 * max(color[0], color[1])


def test_the_picture_shows_the_stage_and_follows_an_editor(studio, gateways, screens, editor):
    screen = screens(gateways(studio)).opened()
    assert is_red(screen.color("/World/Box")) and is_blue(screen.color("/World/Ball")) and is_green(screen.color("/World/Cone"))
    before = screen.found("/World/Box")
    ada = editor(studio, "ada", "root.usda")
    ada.run("UsdGeom.XformCommonAPI(stage.GetPrimAtPath('/World/Box')).SetTranslate((-3, 4, 1))")
    ada.flush()
    screen.until(lambda: screen.shift("/World/Box", before) > 40, "the box moved")
    screen.until(lambda: is_red(screen.color("/World/Box")), "the box is red where it is now")
    assert not is_red(screen.color_at(before)), "the box left its place"
    ada.run("stage.GetPrimAtPath('/World/Ball').GetAttribute('primvars:displayColor').Set([(0.8, 0.02, 0.02)])")
    ada.flush()
    screen.until(lambda: is_red(screen.color("/World/Ball")), "the ball became red")
    ada.run("UsdGeom.Imageable(stage.GetPrimAtPath('/World/Cone')).MakeInvisible()")
    ada.flush()
    screen.until(lambda: screen.place("/World/Cone") is None, "the cone went")
    ada.run("stage.RemovePrim('/World/Cone'); UsdGeom.Cylinder.Define(stage, '/World/New')")
    ada.flush()
    screen.until(lambda: screen.place("/World/New") is not None, "a new prim came")


def test_a_selection_and_a_camera_of_an_editor_are_seen_and_followed(studio, gateways, screens, editor, tmp_path):
    screen = screens(gateways(studio)).opened()
    ada = editor(studio, "ada", "root.usda")
    with ticking(ada, tmp_path / "flag", looking_from(9, -9)):
        screen.until("document.querySelectorAll('.scene-label').length === 2", "the selection and the camera have labels")
        assert screen.run("[...document.querySelectorAll('.scene-label')].map(one => one.textContent)") == ["ada", "ada"]
        outline = screen.run("usdlivePage.session.people.value[0].color")
        wanted = [int(outline[at:at + 2], 16) for at in (1, 3, 5)]
        around = screen.around(screen.found("/World/Box"), 180).astype(int)
        assert (abs(around - wanted).max(axis=2) < 24).sum() > 60, f"an outline of {outline}"
        screen.shot("presence")
        screen.tab.click("[aria-label='Follow ada']")
        screen.sees("Following ada")
        before = screen.found("/World/Box")
    with ticking(ada, tmp_path / "flag", looking_from(-9, 9)):
        screen.until(lambda: screen.shift("/World/Box", before) > 40, "the view follows")
        screen.shot("following")
        screen.tab.keyboard.press("Escape")
        screen.until("usdlivePage.followed.value === undefined")


SHOT = """#usda 1.0
(
    defaultPrim = "World"
    upAxis = "Z"
    metersPerUnit = 1
    subLayers = [@anim.usda@, @layout.usda@]
)
"""
SHOT_LAYOUT = """#usda 1.0
(
    upAxis = "Z"
    metersPerUnit = 1
)

def Xform "World"
{
    def Cube "Floor"
    {
        color3f[] primvars:displayColor = [(0.16, 0.18, 0.21)]
        double3 xformOp:translate = (0, 0, -0.06)
        double3 xformOp:scale = (2.3, 1.5, 0.05)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }

    def Xform "Bunny" (
        references = @assets/bunny.usd@
    )
    {
        double3 xformOp:translate = (-1.5, 0.4, 0)
        float3 xformOp:rotateXYZ = (90, 0, 20)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
        color3f[] primvars:displayColor = [(0.72, 0.42, 0.2)] (
            interpolation = "constant"
        )
    }

    def Xform "Drones"
    {
DRONES    }

    def Xform "Humanoid" (
        references = @assets/humanoid.usda@
    )
    {
        double3 xformOp:translate = (1.3, 0.2, 1.29)
        float3 xformOp:rotateXYZ = (0, 0, -60)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
        color3f[] primvars:displayColor = [(0.1, 0.32, 0.62)] (
            interpolation = "constant"
        )
    }
}
"""


def test_a_shot_of_real_stages_is_shown_with_its_people(project, serve, gateways, screens, editor, tmp_path):
    assets = pathlib.Path(importlib.util.find_spec("newton").submodule_search_locations[0]) / "examples" / "assets"
    (project / "assets").mkdir()
    for name in ("bunny.usd", "crazyflie.usd", "humanoid.usda"):
        shutil.copy(assets / name, project / "assets")
    drones = "".join(f'''        def Xform "Drone{number}" (
            references = @assets/crazyflie.usd@
        )
        {{
            double3 xformOp:translate = ({-1.2 + 1.1 * number}, -0.6, {1.5 + 0.25 * number})
            float3 xformOp:rotateXYZ = (90, 0, {25 * number})
            float3 xformOp:scale = (9, 9, 9)
            uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
        }}

''' for number in range(3))
    for name, text in {"root.usda": SHOT, "anim.usda": "#usda 1.0\n", "layout.usda": SHOT_LAYOUT.replace("DRONES", drones)}.items():
        (project / name).write_text(text)
    server = serve(project)
    screen = screens(gateways(server), width=1120, height=640).opened()
    ada, ben = editor(server, "ada", "root.usda"), editor(server, "ben", "root.usda")
    ada.run("prim = stage.GetPrimAtPath('/World/Drones/Drone1')\nprim.GetAttribute('xformOp:translate').Set((0.1, -0.7, 1.9))")
    ada.flush()
    look = ("live.show_presence(['{}'], Gf.Matrix4d().SetLookAt(Gf.Vec3d(*{}), Gf.Vec3d(0, 0, 1),"
            " Gf.Vec3d(0, 0, 1)).GetInverse())")
    with (ticking(ada, tmp_path / "ada", look.format("/World/Drones/Drone1", (2.6, -2.6, 2.6))),
          ticking(ben, tmp_path / "ben", look.format("/World/Bunny", (-2.8, -1.6, 2.2)))):
        screen.until("document.querySelectorAll('.scene-label').length === 4")
        for path in ("/World/Bunny", "/World/Humanoid/torso/visuals/torso"):
            screen.until(lambda one=path: screen.place(one), f"{path} is shown")
        screen.run("usdlivePage.session.select(['/World/Drones/Drone0'])")
        screen.run("usdlivePage.revealed.value = {path: '/World/Drones/Drone0'}")
        screen.until("document.querySelector('[data-property=\"xformOp:translate\"] input')")
        screen.until("document.querySelector(\"[data-path='/World/Drones/Drone0']\")")
        screen.shot("page")


KINDS = """#usda 1.0
(
    defaultPrim = "World"
    upAxis = "Y"
    startTimeCode = 1
    endTimeCode = 25
)

def Xform "World"
{
    def Mesh "Textured" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-7, 0, 0), (-5, 0, 0), (-5, 2, 0), (-7, 2, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "vertex"
        )
        rel material:binding = </World/Painted>
    }

    def Material "Painted"
    {
        token outputs:surface.connect = </World/Painted/Surface.outputs:surface>

        def Shader "Surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/Painted/Texture.outputs:rgb>
            token outputs:surface
        }

        def Shader "Texture"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @tex/halves.png@
            float2 inputs:st.connect = </World/Painted/Reader.outputs:result>
            float3 outputs:rgb
        }

        def Shader "Reader"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
    }

    def PointInstancer "Instances"
    {
        rel prototypes = </World/Instances/Cube>
        int[] protoIndices = [0, 0, 0]
        point3f[] positions = [(-3, 0, 0), (-3, 2, 0), (-3, 4, 0)]

        def Cube "Cube"
        {
            double size = 1
            color3f[] primvars:displayColor = [(0.8, 0.04, 0.04)]
        }
    }

    def Points "Points"
    {
        point3f[] points = [(0, 0, 0), (0, 2, 0), (0, 1, 0)]
        float[] widths = [0.9, 0.9, 0.9]
        color3f[] primvars:displayColor = [(0.04, 0.5, 0.08)]
    }

    def Sphere "Moving"
    {
        color3f[] primvars:displayColor = [(0.03, 0.15, 0.8)]
        double3 xformOp:translate.timeSamples = {
            1: (3, 0, 0),
            25: (3, 4, 0),
        }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def Xform "Chosen" (
        variants = {
            string look = "red"
        }
        prepend variantSets = "look"
    )
    {
        double3 xformOp:translate = (6, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        variantSet "look" = {
            "red" {
                def Cube "Shape"
                {
                    color3f[] primvars:displayColor = [(0.8, 0.04, 0.04)]
                }
            }
            "blue" {
                def Cube "Shape"
                {
                    color3f[] primvars:displayColor = [(0.03, 0.15, 0.8)]
                }
            }
        }
    }

    def Camera "Front"
    {
        double3 xformOp:translate = (0, 1, 30)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def png(width: int, rows: list[list[int]]) -> bytes:
    """A picture with these rows of red, green and blue."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    lines = b"".join(b"\0" + bytes(row) for row in rows)
    header = struct.pack(">IIBBBBB", width, len(rows), 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")


def test_textures_instances_points_times_and_variants_are_drawn(project, serve, gateways, screens):
    (project / "root.usda").write_text(KINDS)
    (project / "tex").mkdir()
    # The upper half is blue, the lower one red.
    (project / "tex" / "halves.png").write_bytes(png(8, [[10, 20, 200] * 8] * 4 + [[200, 10, 10] * 8] * 4))
    server = serve(project)
    screen = screens(gateways(server)).opened()
    screen.tab.select_option("[aria-label='Camera']", "/World/Front")
    screen.until("usdlivePage.stageCamera.value === '/World/Front'")
    x, y = screen.found("/World/Textured")
    screen.until(lambda: is_blue(screen.color_at((x, y - 12))) and is_red(screen.color_at((x, y + 12))), "the texture, V upwards")
    screen.shot("kinds")
    for path, looks in {"/World/Instances": is_red, "/World/Points": is_green, "/World/Moving": is_blue, "/World/Chosen": is_red}.items():
        assert looks(screen.color(path)), path
    left, right = screen.found("/World/Instances"), screen.found("/World/Moving")
    assert left[0] < x + 250 and screen.found("/World/Points")[0] < right[0], "the camera of the stage looks"

    screen.tab.fill("[aria-label='Time code']", "25")
    screen.until(lambda: screen.found("/World/Moving")[1] < right[1] - 40, "the sphere is where it is at this time")
    assert is_blue(screen.color("/World/Moving"))
    screen.shot("kinds")

    screen.select("/World/Chosen")
    screen.tab.select_option("[aria-label=Variants] select", "blue")
    screen.until(lambda: screen.place("/World/Chosen") and is_blue(screen.color("/World/Chosen")), "the other variant")
    screen.tab.keyboard.press("Escape")


def test_the_tree_is_searched_and_walked_with_keys(studio, gateways, screens):
    screen = screens(gateways(studio)).opened()
    tab = screen.tab
    tab.click("[role=treeitem][data-path='/World']")
    tab.keyboard.press("ArrowRight")
    screen.until("document.querySelectorAll('[role=treeitem]').length > 4", "the children are shown")
    for _ in range(2):
        tab.keyboard.press("ArrowDown")
    assert screen.run("usdlivePage.session.selection.value") == ["/World/Box"]
    tab.keyboard.press("ArrowLeft")
    assert screen.run("usdlivePage.session.selection.value") == ["/World"]
    tab.keyboard.press("ArrowLeft")
    screen.until("document.querySelectorAll('[role=treeitem]').length === 1", "the children are hidden")
    tab.fill("[aria-label='Search prims']", "con")
    tab.click(".found-row[data-path='/World/Cone']")
    assert screen.run("usdlivePage.session.selection.value") == ["/World/Cone"]
    tab.fill("[aria-label='Search prims']", "")
    screen.until("document.querySelector(\"[data-path='/World/Cone'][aria-selected=true]\")", "the tree shows what was found")
    x, y = screen.found("/World/Box")
    tab.mouse.click(x, y)
    screen.until("usdlivePage.session.selection.value[0] === '/World/Box'", "a click into the picture selects")
    before = screen.found("/World/Box")
    tab.keyboard.press("f")
    screen.until(lambda: screen.shift("/World/Box", before) > 20, "F frames the selection")


def value_of(editor, path: str):
    return editor.run(f"live.wait(lambda: False, 0.05)\nfound = stage.GetAttributeAtPath('{path}').Get()\n"
                      "result = list(found) if hasattr(found, '__len__') and not isinstance(found, str) else found")


def test_properties_show_each_opinion_and_take_values(studio, gateways, screens, editor):
    screen = screens(gateways(studio)).opened()
    ada = editor(studio, "ada", "root.usda")
    ada.run("layer('anim.usda').GetAttributeAtPath('/World/Ball.radius').default = 1.5")
    ada.flush()
    tab = screen.tab
    screen.select("/World/Ball")
    radius = "[data-property=radius]"
    screen.until(lambda: screen.run(f"document.querySelector('{radius} input')?.value") == "1.5", "the resolved value")
    tab.click(f"{radius} .property-name")
    opinions = f"[...document.querySelectorAll('{radius} .opinion')].map(one => one.innerText)"
    screen.until(lambda: "ada" in "".join(screen.run(opinions)), "the author is told")
    strongest, weaker = screen.run(opinions)
    assert "anim.usda" in strongest and "1.5" in strongest and "ada" in strongest
    assert "layout.usda" in weaker and "1" in weaker
    screen.shot("properties")

    tab.fill(f"{radius} input", "2,25")
    tab.keyboard.press("Enter")
    screen.until(lambda: value_of(ada, "/World/Ball.radius") == 2.25, "the value arrived at the editor")
    assert "2.25" in ada.text("anim.usda"), "the value went to the layer of the strongest opinion"
    screen.until(lambda: screen.run(f"document.querySelector('{radius} input').value") == "2.25", "the page has it, too")
    tab.fill(f"{radius} input", "no number")
    screen.until(f"document.querySelector('{radius} input').getAttribute('aria-invalid') === 'true'")
    ada.run("layer('anim.usda').GetAttributeAtPath('/World/Ball.radius').default = 3.5")
    ada.flush()
    screen.until(lambda: "3.5" in "".join(screen.run(opinions)), "a colleague's value arrived")
    assert screen.run(f"document.querySelector('{radius} input').value") == "no number", "what is typed stays"
    tab.keyboard.press("Escape")
    screen.until(lambda: screen.run(f"document.querySelector('{radius} input').value") == "3.5", "Escape shows the value")
    tab.keyboard.press("Tab")
    tab.locator("[data-property='primvars:displayColor'] .property-name").click()

    tab.locator(f"{radius} .opinion.strongest button").click()
    screen.until(lambda: value_of(ada, "/World/Ball.radius") == 1, "the weaker opinion is left")

    tab.locator("button:has-text('Hide')").click()
    screen.until(lambda: value_of(ada, "/World/Ball.visibility") == "invisible", "the ball was hidden")
    screen.until(lambda: screen.place("/World/Ball") is None, "it left the picture")
    tab.keyboard.press("Control+z")
    screen.until(lambda: value_of(ada, "/World/Ball.visibility") == "inherited", "undo shows it again")
    tab.keyboard.press("Control+Shift+z")
    screen.until(lambda: value_of(ada, "/World/Ball.visibility") == "invisible", "redo hides it again")


def test_a_gizmo_moves_a_prim_with_previews_and_one_commit(studio, gateways, screens, editor):
    screen = screens(gateways(studio)).opened()
    ada = editor(studio, "ada", "root.usda")
    tab = screen.tab
    screen.select("/World/Box")
    tab.focus("canvas")
    tab.keyboard.press("w")
    screen.until(f"usdlivePage.gizmo.value === 'translate' && {VIEWPORT}.isSettled")
    before, revision = value_of(ada, "/World/Box.xformOp:translate"), ada.flush()
    x, y = screen.found("/World/Box")
    # The square in the middle of the handles moves along the plane of the picture.
    tab.mouse.move(x, y)
    screen.until(lambda: drag_begins(tab, x, y, screen), "the pointer is at a handle")
    for step in range(1, 6):
        tab.mouse.move(x + 16 * step, y)
        tab.wait_for_timeout(30)
    screen.until(lambda: value_of(ada, "/World/Box.xformOp:translate") != before, "a preview arrived")
    assert ada.run("result = live.revision") == revision, "a preview is no commit"
    screen.shot("gizmo")
    tab.mouse.up()
    screen.until(lambda: ada.run("live.wait(lambda: False, 0.05)\nresult = live.revision") == revision + 1, "one commit")
    moved = value_of(ada, "/World/Box.xformOp:translate")
    assert max(abs(one - other) for one, other in zip(moved, before)) > 0.3
    screen.until(lambda: screen.shift("/World/Box", (x + 80, y)) < 30, "it is where it was dropped")
    tab.keyboard.press("Control+z")
    screen.until(lambda: max(abs(one - other) for one, other in zip(value_of(ada, "/World/Box.xformOp:translate"), before)) < 1e-6, "undo")


def drag_begins(tab, x: float, y: float, screen: Screen) -> bool:
    tab.mouse.move(x + 1, y)
    tab.mouse.move(x, y)
    if not screen.run(f"{VIEWPORT}.isAtHandle"):
        return False
    tab.mouse.down()
    return True


def test_two_pages_and_an_editor_move_the_same_prim(studio, gateways, screens, editor):
    gateway = gateways(studio)
    one, other = screens(gateway).opened(), screens(gateway, width=800, height=600).opened()
    other.tab.click("#tab-people")
    other.tab.click("text=Change name")
    other.tab.fill("[aria-label='Your name']", "ben")
    other.tab.keyboard.press("Enter")
    other.sees("ben")
    other.opened()
    other.select("/World/Box")
    one.until("[...document.querySelectorAll('.scene-label')].some(label => label.textContent === 'ben')", "the other page's selection")
    ada = editor(studio, "ada", "root.usda")
    x = "[data-property='xformOp:translate'] input >> nth=0"
    one.select("/World/Box")
    other.tab.click("#tab-properties")
    for value, tab in ((-2, one.tab), (1, other.tab), (-1, one.tab)):
        tab.fill(x, str(value))
        tab.keyboard.press("Enter")
        for screen in (one, other):
            screen.until(lambda now=value, at=screen: at.tab.input_value(x) == str(now), f"both show {value}")
        screen.until(lambda now=value: value_of(ada, "/World/Box.xformOp:translate")[0] == now, "and the editor has it")
    ada.run("stage.GetAttributeAtPath('/World/Box.xformOp:translate').Set((4, 0, 1))")
    ada.flush()
    for screen in (one, other):
        screen.until(lambda at=screen: at.tab.input_value(x) == "4", "both follow the editor")
    one.tab.click("#tab-history")
    one.until("[...document.querySelectorAll('.commit-user')].some(user => user.textContent === 'ben')", "ben is an author")


def test_a_lock_of_somebody_else_is_shown_where_it_refuses(studio, gateways, screens, editor):
    screen = screens(gateways(studio)).opened()
    ada = editor(studio, "ada", "root.usda")
    ada.run("live.lock('layout.usda')")
    ada.flush()
    screen.until("document.querySelector(\"[aria-label='Unlock layout.usda']\")", "the lock is shown")
    screen.select("/World/Box")
    size = "[data-property=size]"
    screen.until(f"document.querySelector('{size} input')")
    screen.tab.fill(f"{size} input", "3")
    screen.tab.keyboard.press("Enter")
    screen.until(lambda: "ada" in (screen.run(f"document.querySelector('{size} .refusal')?.innerText") or ""), "who has the lock")
    assert value_of(ada, "/World/Box.size") == 1.8
    screen.shot("refused")
    ada.run("live.unlock('layout.usda')")
    ada.flush()
    screen.until("document.querySelector(\"[aria-label='Lock layout.usda']\")", "the lock went")
    screen.tab.fill(f"{size} input", "3")
    screen.tab.keyboard.press("Enter")
    screen.until(lambda: value_of(ada, "/World/Box.size") == 3, "the value is taken now")
    assert not screen.run(f"document.querySelector('{size} .refusal')")
    screen.tab.click("[aria-label='Lock anim.usda']")
    screen.until(lambda: ada.run("live.wait(lambda: False, 0.05)\nresult = 'anim.usda' in live.layer_states() and "
                                 "live.layer_states()['anim.usda'].holder != ''"), "the page has locked a layer")
    screen.tab.click("[aria-label='Mute anim.usda']")
    screen.until(lambda: value_of(ada, "/World/Ball.radius") == 1, "the page has muted a layer for everybody")


def test_the_past_is_shown_and_a_commit_is_taken_back(studio, gateways, screens, editor):
    screen = screens(gateways(studio)).opened()
    ada = editor(studio, "ada", "root.usda")
    before = screen.found("/World/Box")
    old = ada.flush()
    ada.run("live.create_checkpoint('before lunch')")
    ada.run("UsdGeom.XformCommonAPI(stage.GetPrimAtPath('/World/Box')).SetTranslate((-3, 4, 1))")
    new = ada.flush()
    screen.until(lambda: screen.shift("/World/Box", before) > 40, "the box moved")
    tab = screen.tab
    tab.click("#tab-history")
    screen.until(f"document.querySelector('[data-commit=\"{new}\"]')?.innerText.includes('ada')", "the commit is in the log")
    screen.sees("before lunch")
    tab.click(f"[aria-label='Show revision {old}']")
    screen.until(lambda: screen.shift("/World/Box", before) < 20, "the box is where it was")
    screen.sees(f"You see revision {old}")
    screen.shot("past")
    tab.click("text=Back to live")
    screen.until(lambda: screen.shift("/World/Box", before) > 40, "live again")
    tab.click(f"[aria-label='Revert commit {new}']")
    screen.until("document.querySelector('.dry-run')", "what a revert does is shown first")
    screen.shot("revert")
    label = f"What a revert of {new} does"
    assert screen.run("document.activeElement.ariaLabel") == label, "the keyboard is where the answer is"
    tab.keyboard.press("Escape")
    screen.until("!document.querySelector('.dry-run')", "Escape leaves it")
    assert screen.run("document.activeElement.ariaLabel") == f"Revert commit {new}", "and goes back to the button"
    tab.keyboard.press("Enter")
    screen.until("document.querySelector('.dry-run')", "it is asked again")
    assert abs(value_of(ada, "/World/Box.xformOp:translate")[1] - 4) < 1e-6, "the dry run changes nothing"
    tab.click(".dry-run .primary")
    screen.until(lambda: abs(value_of(ada, "/World/Box.xformOp:translate")[1]) < 1e-6, "the commit was taken back")


def test_the_page_says_when_server_or_gateway_are_away_and_recovers(studio, gateways, screens, editor):
    gateway = gateways(studio)
    screen = screens(gateway).opened()
    studio.kill()
    screen.until("document.querySelector('.line-state')?.dataset.state === 'bad'", "the server is away")
    screen.shot("server-away")
    assert is_red(screen.color("/World/Box")), "the picture stays"
    studio.start()
    screen.until("document.querySelector('.line-state')?.dataset.state === 'good'", "the server is back", timeout=60)
    before = screen.found("/World/Box")
    ada = editor(studio, "ada", "root.usda")
    ada.run("UsdGeom.XformCommonAPI(stage.GetPrimAtPath('/World/Box')).SetTranslate((-3, 4, 1))")
    ada.flush()
    screen.until(lambda: screen.shift("/World/Box", before) > 40, "the page is live again")

    gateway.process.kill()
    gateway.process.wait()
    screen.sees("The gateway does not answer")
    screen.shot("gateway-away")
    gateway.options = ("--port", str(gateway.port))
    gateway.start()
    screen.until("document.querySelector('.line-state')?.dataset.state === 'good'", "the gateway is back", timeout=60)
    screen.opened()
    assert is_red(screen.color("/World/Box"))


def test_a_person_signs_in_and_sees_and_does_what_the_server_allows(studio, project, gateways, screens):
    tokens = {}
    for name, role in (("vera", "viewer"), ("adam", "admin")):
        tokens[name] = re.search(r"usdlive-token://\S+", run("user", "add", name, "--service", "--role", role, str(project))).group()
    studio.stop()
    studio.start()  # with users, who have to sign in
    gateway = gateways(studio)
    screen = screens(gateway)
    screen.sees("Sign in")
    screen.shot("sign-in")
    screen.tab.fill("[aria-label=Token]", "0" * 64)
    screen.tab.keyboard.press("Enter")
    screen.until("document.querySelector('.dialog')?.innerText.includes('does not know this token')", "a wrong token is refused")
    screen.tab.fill("[aria-label=Token]", tokens["vera"])
    screen.tab.keyboard.press("Enter")
    screen.opened()
    screen.tab.click("#tab-people")
    screen.sees("vera")
    assert screen.run("document.querySelector('[aria-label=Move]').disabled"), "a viewer moves nothing"
    assert not screen.run("document.querySelector('#tab-admin')")
    run("session", "create", studio.url, "dusk")
    screen.tab.click("#tab-sessions")
    screen.until(lambda: screen.tab.query_selector("[aria-label='Open dusk']"), "a viewer sees the live sessions")
    assert not screen.run("document.querySelector('.session-form, [aria-label=\"Merge dusk\"], [aria-label=\"End dusk\"]')")
    screen.select("/World/Box")
    screen.tab.click("#tab-properties")
    screen.until("document.querySelector('[data-property=size] .value-text')?.innerText === '1.8'", "the value is a text")
    assert not screen.run("[...Array(localStorage.length).keys()].some(at => localStorage.getItem(localStorage.key(at)).includes('token'))")

    admin = screens(gateway)
    admin.sees("Sign in")
    admin.tab.fill("[aria-label=Token]", tokens["adam"])
    admin.tab.keyboard.press("Enter")
    admin.opened()
    assert not admin.run("document.querySelector('[aria-label=Move]').disabled")
    admin.tab.click("#tab-admin")
    admin.sees("usdlive_sessions")
    admin.sees("may edit")
    admin.until("/vera\\s+viewer/.test(document.querySelector('[aria-label=Users]')?.innerText)", "the users have their roles")
    admin.shot("admin")


SCRIPT = "<img src=x onerror=alert(1)><script>alert(2)</script>"


def test_scripts_in_texts_of_a_stage_stay_text(project, serve, gateways, screens, tmp_path):
    (project / "root.usda").write_text(f'''#usda 1.0
(
    doc = "{SCRIPT}"
    subLayers = [@img src=x onerror=alert(3).usda@]
)

def Cube "World" (
    doc = "{SCRIPT}"
    customData = {{ string note = "{SCRIPT}" }}
    kind = "{SCRIPT}"
)
{{
    custom string note = "{SCRIPT}" (
        doc = "{SCRIPT}"
    )
    custom asset file = @javascript:alert(4)@
}}
''')
    (project / "img src=x onerror=alert(3).usda").write_text("#usda 1.0\n")
    server = serve(project)
    screen = screens(gateways(server)).opened()
    eva = Peer(server.url, f"eva{SCRIPT}", "root.usda", tmp_path / "eva.log")
    with ticking(eva, tmp_path / "flag", "live.show_presence(['/World'])"):
        screen.until("document.querySelector('.scene-label')")
        screen.tab.click("#tab-people")
        screen.sees(f"eva{SCRIPT}")
        screen.tab.click("#tab-properties")
        screen.select("/World")
        screen.until("document.querySelector('[data-property=note]')")
        screen.tab.click("[data-property=note] .property-name")
        screen.sees(SCRIPT)
        screen.tab.click("#tab-history")
        screen.until("document.querySelector('.commit')")
        screen.shot("scripts")
    eva.close()
    assert screen.run("document.querySelectorAll('img').length") == 1, "the page's own picture is the only one"


AXE = pathlib.Path(__file__).resolve().parents[2] / "build" / "web" / "node_modules" / "axe-core" / "axe.min.js"


def violations(screen: Screen) -> list[str]:
    """Returns the serious faults for people with a screen reader. The page's policy does not let axe run: open it with bypass_csp."""
    if not screen.run("typeof axe === 'object'"):
        screen.run(AXE.read_text())
    return screen.run("axe.run(document, {resultTypes: ['violations']}).then(found => found.violations"
                      ".filter(one => ['serious', 'critical'].includes(one.impact))"
                      ".map(one => `${one.id}: ${one.nodes.map(node => node.html).slice(0, 3)}`))")


def test_the_page_can_be_used_with_a_screen_reader_in_both_themes(studio, gateways, screens):
    screen = screens(gateways(studio), bypass_csp=True).opened()
    screen.select("/World/Ball")
    screen.until("document.querySelector('.prim-head')")
    for theme in ("dark", "light"):
        assert screen.run("document.documentElement.dataset.theme") == theme
        for tab in ("properties", "history", "sessions", "people"):
            screen.tab.click(f"#tab-{tab}")
            assert violations(screen) == [], (theme, tab)
        screen.shot(f"people-{theme}")
        if theme == "dark":
            screen.tab.click("[aria-label='Light theme']")


def row_of(name: str) -> str:
    """Finds the row of a live session."""
    return f"[data-session={json.dumps(name)}]"


def test_live_sessions_are_listed_made_and_deleted(studio, gateways, screens):
    script = "<img src=x onerror=alert(5)>"
    screen = screens(gateways(studio), bypass_csp=True, permissions=["clipboard-read", "clipboard-write"]).opened()
    tab = screen.tab
    tab.click("#tab-sessions")
    screen.sees("This page shows the main line.")
    screen.sees("There is no live session yet")
    for name in ("dusk/dawn", script):
        tab.fill("[aria-label='Name of a session']", name)
        tab.keyboard.press("Enter")
        if name != script:
            screen.until("document.querySelector('.session-form .refusal')?.innerText.includes('cannot have the name \"dusk/dawn\"')",
                         "the reason is beside the name")
            screen.shot("session-name")
    screen.until(lambda: tab.query_selector(row_of(script)), "the session is in the list")
    assert tab.inner_text(f"{row_of(script)} .session-name") == script
    # Changes of others are seen without a reload.
    run("session", "create", studio.url, "dusk")
    screen.until(lambda: tab.query_selector(row_of("dusk")), "a session that was made elsewhere is in the list")
    with usdlive.connect(f"{studio.url}?session=dusk", user=script):
        screen.until(lambda: tab.query_selector(f"{row_of('dusk')} .session-users"), "somebody is in the session")
        assert tab.inner_text(f"{row_of('dusk')} .session-users").endswith(f"In it: {script}")
        screen.shot("session-users")
    screen.until(lambda: not tab.query_selector(f"{row_of('dusk')} .session-users"), "nobody is in the session")
    tab.click("[aria-label='Open dusk']")
    tab.click("[aria-label='Copy the command that opens dusk']")
    screen.sees("The command was copied.")
    assert screen.run("navigator.clipboard.readText()") == f"usdlive page --open '{studio.url}?session=dusk'"
    run("session", "end", studio.url, "dusk")
    screen.until(lambda: "ended" in tab.inner_text(f"{row_of('dusk')} .session-head"), "a session that was ended elsewhere says so")
    tab.click(f"[aria-label={json.dumps('End ' + script)}]")
    tab.click(f"[aria-label={json.dumps('Delete ' + script)}]")
    screen.until(lambda: tab.query_selector(f"{row_of(script)} .dry-run"), "a question comes first")
    assert violations(screen) == []
    screen.shot("sessions")
    tab.click(f"{row_of(script)} .dry-run .final")
    screen.until(lambda: not tab.query_selector(row_of(script)), "the session was deleted")
    tab.click("[aria-label='Restore dusk']")
    screen.until(lambda: tab.query_selector("[aria-label='Merge dusk']"), "the session is open again")
    assert screen.run("document.querySelectorAll('img').length") == 1, "the page's own picture is the only one"


def test_a_live_session_is_merged_after_its_conflicts_are_decided(studio, gateways, screens, editor, tmp_path):
    screen = screens(gateways(studio), bypass_csp=True).opened()
    tab = screen.tab
    run("session", "create", studio.url, "dusk")
    bo = Peer(f"{studio.url}?session=dusk", f"bo{SCRIPT}", "root.usda", tmp_path / "bo.log")
    bo.run("for path, value in (('/World/Box.size', 3), ('/World/Ball.radius', 2)): stage.GetAttributeAtPath(path).Set(value)\n"
           "UsdGeom.XformCommonAPI(stage.GetPrimAtPath('/World/Cone')).SetTranslate((3, 2, 1))")
    bo.flush()
    ada = editor(studio, "ada", "root.usda")
    ada.run("for path, value in (('/World/Box.size', 2.5), ('/World/Ball.radius', 1.5)): stage.GetAttributeAtPath(path).Set(value)")
    ada.flush()
    tab.click("#tab-sessions")
    screen.until(lambda: tab.query_selector("[aria-label='Merge dusk']"))
    tab.click("[aria-label='Merge dusk']")
    screen.until(lambda: tab.query_selector("[data-conflict='/World/Box.size']"), "the dry run is shown")
    box = tab.inner_text("[data-conflict='/World/Box.size']")
    assert "was nothing" in box and "main line: 2.5 (ada)" in box and f"session: 3.0 (bo{SCRIPT})" in box
    merge = f"{row_of('dusk')} .dry-run > .primary"
    assert tab.is_disabled(merge), "nothing is merged before each conflict is decided"
    tab.check("[data-conflict='/World/Box.size'] label:has-text('session:') input")
    tab.check("[data-conflict='/World/Ball.radius'] label:has-text('main line:') input")
    assert violations(screen) == []
    screen.shot("session-merge")
    # Somebody goes on meanwhile: what they wrote is decided again, and the other decision stays.
    ada.run("stage.GetAttributeAtPath('/World/Ball.radius').Set(1.75)")
    ada.flush()
    tab.click(merge)
    screen.until(lambda: tab.query_selector(f"{row_of('dusk')} .refusal"), "the merge is refused where it was asked for")
    screen.until(lambda: "1.75" in tab.inner_text("[data-conflict='/World/Ball.radius']"), "the page shows what there is now")
    assert tab.is_disabled(merge) and tab.is_checked("[data-conflict='/World/Box.size'] label:has-text('session:') input")
    screen.shot("session-merge-again")
    tab.click("[aria-label='Light theme']")
    assert violations(screen) == []
    screen.shot("session-merge-light")
    tab.check("[data-conflict='/World/Ball.radius'] label:has-text('main line:') input")
    tab.click(merge)
    screen.until(lambda: value_of(ada, "/World/Box.size") == 3, "the session's value is in the main line")
    assert value_of(ada, "/World/Ball.radius") == 1.75
    screen.until(lambda: "merged in #" in tab.inner_text(f"{row_of('dusk')} .session-head"), "the session was ended by the merge")
    screen.sees("dusk was merged into the main line")
    assert screen.run("document.querySelectorAll('img').length") == 1, "the page's own picture is the only one"
    bo.close()


def test_the_page_of_a_live_session_says_so_and_is_updated(studio, gateways, screens, editor):
    run("session", "create", studio.url, "dusk")
    screen = screens(gateways(types.SimpleNamespace(url=f"{studio.url}?session=dusk"))).opened()
    tab = screen.tab
    before = screen.found("/World/Box")
    ada = editor(studio, "ada", "root.usda")
    ada.run("UsdGeom.XformCommonAPI(stage.GetPrimAtPath('/World/Box')).SetTranslate((-3, 4, 1))")
    ada.flush()
    tab.click("#tab-sessions")
    screen.sees("This page shows the live session dusk.")
    screen.until(lambda: tab.query_selector("[aria-label='Update dusk']"))
    assert screen.shift("/World/Box", before) < 20
    tab.click("[aria-label='Update dusk']")
    tab.click(f"{row_of('dusk')} .dry-run > .primary")
    screen.until(lambda: screen.shift("/World/Box", before) > 40, "the main line's change is in the session")
    screen.shot("session-page")
    tab.click("[aria-label='End dusk']")
    screen.until("document.querySelector('.line-state')?.dataset.state === 'bad'", "an ended session is not live")
    screen.shot("session-ended")
    tab.click("[aria-label='Restore dusk']")
    screen.until("document.querySelector('.line-state')?.dataset.state === 'good'", "the session is live again", timeout=60)


def test_a_phone_shows_the_stage_and_the_overview(studio, gateways, screens):
    screen = screens(gateways(studio), width=390, height=800).opened()
    assert is_red(screen.color("/World/Box"))
    screen.shot("phone")
    screen.tab.click("text=Overview")
    screen.sees("layout.usda")
    screen.shot("phone-overview")
    run("session", "create", studio.url, "dusk")
    for view, text in (("History", "root.usda"), ("Sessions", "dusk")):
        screen.tab.click(f".phone-bar >> text={view}")
        screen.sees(text)
        screen.shot(f"phone-{view.lower()}")
        assert screen.run("document.documentElement.scrollWidth") == 390, "nothing is wider than the screen"
    screen.tab.click(".phone-bar >> text=Stage")
    assert is_red(screen.color("/World/Box"))


def test_a_browser_without_webgl_has_all_but_the_picture(studio, gateways, tools):
    gateway = gateways(studio)
    browser = tools.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu", "--disable-3d-apis"])
    screen = Screen(browser, gateway.address)
    screen.sees("This browser shows no 3D pictures")
    screen.until("document.querySelector(\"[data-path='/World']\")", "the tree is here")
    screen.shot("no-webgl")
    browser.close()
