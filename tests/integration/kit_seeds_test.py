"""Scripts for the steps of Kit's guides, with `import omni`.

Our own scripts for each step are in this file (OWN, OWN_LAYERS) and in client/examples/kit. The snippets of the
guides themselves are tested verbatim, too, where the guides are beside the repository.
"""

import ast
import asyncio
import functools
import inspect
import os
import pathlib
import re
import subprocess
import sys

import pytest
from pxr import Sdf, Usd

import usdlive.omni.kit.app
import usdlive.omni.usd

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
SEEDS = REPOSITORY.parent / "shared" / "seeds"
SHIM = REPOSITORY / "client" / "python" / "omni_shim"
EXAMPLES = REPOSITORY / "client" / "examples" / "kit"

needs_seeds = pytest.mark.skipif(not SEEDS.is_dir(), reason="the guides are not beside the repository")


@pytest.fixture
def omni(monkeypatch):
    """`import omni` works as with usdlive-omni installed."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(SHIM / "src"))
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    import usdlive_omni

    usdlive_omni.install()
    import omni

    yield omni
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in ("omni", "carb", "usdlive_omni"):
            del sys.modules[name]


def execute(code, names):
    """Executes code that may contain await at its top level."""
    compiled = compile(code, "<guide>", "exec", flags=ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)

    async def main():
        result = eval(compiled, names)  # noqa: S307 - text of a guide or of this file
        if inspect.iscoroutine(result):
            await result

    asyncio.run(main())


# -- operations on files

# The operation, the same in an async and in a blocking form. `context`, `path` and `saved` are defined.
OWN = {
    "New Stage": ("""
result, err = await context.new_stage_async()
assert result is True and err == ""
await omni.kit.app.get_app().next_update_async()
""", "assert context.new_stage() is True"),
    "Open stage": ("""
result, err = await context.open_stage_async(path)
assert result is True and err == ""
""", "assert context.open_stage(path) is True"),
    "Close stage": ("""
result, err = await context.close_stage_async()
assert result is True and err == ""
""", "assert context.close_stage() is True"),
    "Reopen stage": ("""
result, err = await context.reopen_stage_async()
assert result is True and err == ""
""", "assert context.reopen_stage() is True"),
    "Save stage": ("""
result, err, layers = await context.save_as_stage_async(saved)
assert result is True and err == "" and layers == [saved]
""", "assert context.save_as_stage(saved) is True"),
    "Export stage": ("""
result, err = await context.export_as_stage_async(saved)
assert result is True and err == ""
""", "assert context.export_as_stage(saved) is True"),
}
TITLES = list(OWN)


def state_after(title, context, path):
    if title == "Close stage":
        assert context.get_stage() is None
    elif title == "New Stage":
        assert context.is_new_stage()
    elif title in ("Open stage", "Reopen stage"):
        assert context.get_stage_url() == path
        assert not context.get_stage().GetPrimAtPath("/Unsaved"), "the stage is not as it is on disk"
    else:
        saved = path.replace("scene.usd", "saved.usda")
        assert Usd.Stage.Open(saved).GetPrimAtPath("/Unsaved")
        assert context.get_stage_url() == (saved if title == "Save stage" else path)


@pytest.mark.parametrize("title", TITLES)
@pytest.mark.parametrize("form", [0, 1], ids=["async", "blocking"])
def test_each_operation_does_what_it_says(title, form, omni, tmp_path):
    path = str(tmp_path / "scene.usd")
    Usd.Stage.CreateNew(path).Save()
    context = omni.usd.get_context()
    assert context.open_stage(path)
    context.get_stage().DefinePrim("/Unsaved")
    execute(OWN[title][form], {"omni": omni, "context": context, "path": path, "saved": str(tmp_path / "saved.usda")})
    state_after(title, context, path)
    if context.get_stage():
        assert context.close_stage()


def test_a_file_that_does_not_open_is_named(omni, tmp_path):
    names = {"context": omni.usd.get_context(), "path": str(tmp_path / "missing.usd")}
    execute("success, error = await context.open_stage_async(path)", names)
    assert names["success"] is False and "missing.usd" in names["error"]


def test_a_coroutine_runs_beside_the_loop(omni):
    names = {"asyncio": asyncio, "context": omni.usd.get_context(), "opened": []}
    execute("""
task = asyncio.ensure_future(context.new_stage_async())
await context.next_stage_event_async()
await task
opened.append(context.get_stage() is not None)
""", names)
    assert names["opened"] == [True]
    assert names["context"].close_stage()


# -- the guide to the file system


@functools.cache
def sections():
    """Returns the Python blocks below each title."""
    lines = (SEEDS / "usd-context-file-operations.txt").read_text().splitlines()
    found, title, block = {}, "", None
    for previous, line in zip(["", *lines], lines):
        if re.fullmatch(r"[#-]{5,}", line.strip()):
            title = previous.strip()
        elif line.strip() == ".. code-block:: python":
            block = []
            found.setdefault(title, []).append(block)
        elif block is not None and line.strip():
            if line.startswith("    "):
                block.append(line)
            else:
                block = None
    return {title: [inspect.cleandoc("\n" + "\n".join(block)) for block in blocks]
            for title, blocks in found.items()}


@needs_seeds
def test_the_whole_guide_is_read():
    found = sections()
    assert list(found) == ["File system", *TITLES]
    assert found["File system"][0] == "import omni" and all(len(found[title]) == 2 for title in TITLES)


@needs_seeds
def test_the_snippet_for_coroutines(omni):
    names = {"function": usdlive.omni.usd.get_context().new_stage_async, "opened": []}
    code = sections()["File system"][1].replace("<your async function>", "function()")
    execute(sections()["File system"][0], names)
    execute(code + "\nawait omni.usd.get_context().next_stage_event_async()\nopened.append(1)", names)
    assert names["opened"] == [1]


@needs_seeds
@pytest.mark.parametrize("title", TITLES)
@pytest.mark.parametrize("form", [0, 1], ids=["async", "blocking"])
def test_each_snippet_does_what_it_says(title, form, omni, tmp_path):
    path = str(tmp_path / "scene.usd")
    Usd.Stage.CreateNew(path).Save()
    context = usdlive.omni.usd.get_context()
    assert context.open_stage(path)
    names = {"os": os, "tmpdirname": str(tmp_path)}
    execute(sections()["File system"][0], names)
    for snippet in sections()[title][: form + 1]:  # the second snippet uses names of the first
        snippet = snippet.replace("<your usd file>.usd", path).replace("<your save path>", "saved")
        assert "<" not in snippet
        assert context.open_stage(path)
        context.get_stage().DefinePrim("/Unsaved")
        execute(snippet, names)
        if "# Assert result == True" in snippet:
            assert names["result"] is True and names["err"] == ""
        state_after(title, context, path)
    if title == "Save stage":
        assert names["saved_layers"] == [str(tmp_path / "saved.usda")]
    if context.get_stage():
        assert context.close_stage()


@needs_seeds
def test_the_snippet_names_the_file_that_did_not_open(omni, tmp_path):
    snippet = sections()["Open stage"][0].replace("<your usd file>", str(tmp_path / "missing"))
    names = {}
    execute(sections()["File system"][0], names)
    with pytest.raises(Exception, match=r"Failed to open usd file: .*missing\.usd"):
        execute(snippet, names)
    assert names["success"] is False


# -- layers

OWN_LAYERS = """
import carb.events
import omni.kit.usd.layers as layers

for which in ("", context):
    instance = layers.get_layers(which)
    parts = [instance.get_layers_state(), instance.get_specs_linking(), instance.get_specs_locking()]
    assert None not in parts

def on_event(event: carb.events.IEvent):
    payload = layers.get_layer_event_payload(event)
    if payload.event_type == layers.LayerEventType.SUBLAYERS_CHANGED:
        received.append(payload)

subscription = instance.get_event_stream().create_subscription_to_pop(on_event, name="test")
"""


def add_a_sublayer(context):
    """Adds a sublayer and runs the frames that deliver its event."""
    usdlive.omni.kit.app.get_app().update()
    extra = Sdf.Layer.CreateAnonymous()
    context.get_stage().GetRootLayer().subLayerPaths.append(extra.identifier)
    for _ in range(3):
        usdlive.omni.kit.app.get_app().update()


def test_the_interfaces_and_events_of_layers(omni):
    context = omni.usd.get_context()
    assert context.new_stage()
    names = {"context": context, "received": []}
    execute(OWN_LAYERS, names)
    add_a_sublayer(context)
    assert names["received"]
    assert context.close_stage()


# -- the guide to layers


def layer_snippets():
    """Returns the code of the guide's Python part. Its text has lost the indentation: `...` ends a block that a
    colon began."""
    text = (SEEDS / "kit-usd-layers.txt").read_text()
    python = text[text.index("Here are the steps to use Python"):text.rindex("\nC++\n")]
    code, depth = [], 0
    for line in python.splitlines():
        line = line.strip()
        if not re.match(r"(import |def |if |\w+ = |\.\.\.$)", line):
            continue
        code.append("    " * depth + line)
        if line.endswith(":"):
            depth += 1
        elif line == "...":
            depth = max(0, depth - 1)
    return code


@needs_seeds
def test_the_whole_guide_to_layers_is_read():
    code = layer_snippets()
    assert code[0] == "import omni.kit.usd.layers as layers" and code[-2].startswith("subscription = ")
    assert len([line for line in code if line.strip() != "..."]) == 9
    ast.parse("\n".join(code).replace("XXXXXX", "X"))


@needs_seeds
def test_the_snippets_for_layers(omni):
    import carb

    context = usdlive.omni.usd.get_context()
    assert context.new_stage()
    names = {"usd_context_name": "", "instance_of_usd_context": context, "carb": carb, "received": []}
    code = "\n".join(layer_snippets()).replace("XXXXXX", "SUBLAYERS_CHANGED")
    code = code.replace("        ...", "        received.append(payload)")
    execute(code, names)
    for part in ("layers_state", "specs_linking", "specs_locking"):
        assert names[part] is not None
    add_a_sublayer(context)
    assert names["received"]
    assert context.close_stage()


# -- the examples as files


def run_example(name, *arguments):
    code = ("import runpy, sys, usdlive_omni; usdlive_omni.install(); sys.argv = sys.argv[1:]; "
            "runpy.run_path(sys.argv[0], run_name='__main__')")
    folders = [str(SHIM / "src"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    done = subprocess.run([sys.executable, "-c", code, str(EXAMPLES / name), *arguments], text=True,
                          capture_output=True, env=environment, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_example_of_file_operations():
    assert run_example("file_operations.py").splitlines() == [
        "saved ['ball.usda']", "not opened: missing.usd: no such file", "unsaved edits: True",
        "files: ['ball.usda', 'flat.usdc']"]


def test_the_example_of_commands():
    assert run_example("commands.py").splitlines() == [
        "sublayers: 1 edit target is the new one: True", "undone group and not restored: []",
        "flattened: True"]


def test_the_example_of_layers():
    assert run_example("layers.py").splitlines() == ["locked: True writable: False", "links: {} locks: []"]


def test_the_live_example(project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    server = serve(project)
    url = f"usdlive://127.0.0.1:{server.port}/shot.usda"
    assert run_example("live.py", url, "ada") == "saved 1\n"
    assert "int frame = 29" in (project / "shot.usda").read_text()


# -- import omni


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder in which pip has installed usdlive-omni."""
    target = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps",
                    "--no-build-isolation", "--disable-pip-version-check", "--target", str(target),
                    str(SHIM)],
                   check=True, capture_output=True)
    return target


def in_python(code, *folders):
    """Runs code in a new Python that finds the packages in these folders when it starts."""
    begin = "import site\n" + "".join(f"site.addsitedir({str(folder)!r})\n" for folder in folders)
    done = subprocess.run([sys.executable, "-W", "always", "-c", begin + code],
                          text=True, capture_output=True)
    assert done.returncode == 0, done.stderr
    return done


def test_omni_is_usdlives_own(installed):
    in_python("""
import sys
assert not [name for name in sys.modules if name.startswith(("usdlive.", "pxr", "omni"))]
import omni
assert omni.usd.get_context() and omni.kit.app.get_app() and omni.kit.commands.execute
assert omni.kit.undo.can_undo() is False
import omni.usd.commands, omni.kit.usd.layers.commands, carb.events, carb
import usdlive.omni, usdlive.omni.usd.commands, usdlive.omni.kit.usd.layers.commands, usdlive.omni._events
assert omni is usdlive.omni and omni.usd.commands is usdlive.omni.usd.commands
assert sys.modules["omni.kit.usd.layers.commands"] is usdlive.omni.kit.usd.layers.commands
assert omni.usd.__spec__.name == "usdlive.omni.usd"
assert carb.events.IEvent is usdlive.omni._events.IEvent
for name in ("omni.nothing", "omni.kit.nothing", "carb.settings"):
    try: __import__(name)
    except ModuleNotFoundError as error: assert name in str(error), error
    else: raise AssertionError(name)
""", installed)


def test_a_real_kit_is_left_alone(installed, tmp_path):
    (tmp_path / "carb").mkdir()
    (tmp_path / "carb" / "__init__.py").write_text("real = True\n")
    (tmp_path / "omni" / "usd").mkdir(parents=True)
    (tmp_path / "omni" / "usd" / "__init__.py").write_text("real = True\n")
    done = in_python("import omni.usd, carb\nassert omni.usd.real and carb.real\n"
                     "try: import omni.kit.commands\n"
                     "except ModuleNotFoundError: pass\nelse: raise AssertionError", tmp_path, installed)
    assert "Kit is in this Python" in done.stderr and str(tmp_path) in done.stderr
    assert "usdlive-omni leaves" in done.stderr


def test_another_distributions_part_of_omni_stays(installed, tmp_path):
    (tmp_path / "omni").mkdir()
    (tmp_path / "omni" / "client.py").write_text("other = True\n")
    in_python("import omni.client, omni.usd, usdlive.omni.usd\n"
              "assert omni.client.other and omni.usd is usdlive.omni.usd\n"
              "import omni.kit.app, usdlive.omni.kit.app as app\nassert omni.kit.app is app",
              tmp_path, installed)


@pytest.mark.parametrize("first", ["import omni", "import omni.kit.usd.layers", "import carb.events"])
def test_omni_is_there_in_the_source_tree(first, monkeypatch):
    """`./run python` has it in this way, with nothing installed."""
    monkeypatch.setenv("PYTHONPATH", os.environ["PYTHONPATH"] + os.pathsep + str(SHIM / "tree"))
    in_python(f"{first}\nimport omni, omni.usd, carb, usdlive.omni, usdlive.omni._events\n"
              "assert omni is usdlive.omni and omni.usd.get_context()\n"
              "assert carb.events.IEvent is usdlive.omni._events.IEvent")
