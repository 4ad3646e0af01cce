"""The snippets of Kit's guides, verbatim, with `import omni`; and the same as runnable files."""

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
    """`import omni` as with usdlive-omni installed."""
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
    """With top-level await."""
    compiled = compile(code, "<guide>", "exec", flags=ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)

    async def main():
        result = eval(compiled, names)  # noqa: S307 - a guide's text
        if inspect.iscoroutine(result):
            await result

    asyncio.run(main())


# -- the guide to the file system


@functools.cache
def sections():
    """Title -> the Python blocks below it."""
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


TITLES = ["New Stage", "Open stage", "Close stage", "Reopen stage", "Save stage", "Export stage"]


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


def state_after(title, context, path):
    if title == "Close stage":
        assert context.get_stage() is None
    elif title == "New Stage":
        assert context.is_new_stage()
    elif title in ("Open stage", "Reopen stage"):
        assert context.get_stage_url() == path
        assert not context.get_stage().GetPrimAtPath("/Unsaved"), "as it is on disk"
    else:
        saved = path.replace("scene.usd", "saved.usda")
        assert Usd.Stage.Open(saved).GetPrimAtPath("/Unsaved")
        assert context.get_stage_url() == (saved if title == "Save stage" else path)


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
    for index, snippet in enumerate(sections()[title][: form + 1]):  # the second uses names of the first
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
def test_the_snippet_says_what_did_not_open(omni, tmp_path):
    snippet = sections()["Open stage"][0].replace("<your usd file>", str(tmp_path / "missing"))
    names = {}
    execute(sections()["File system"][0], names)
    with pytest.raises(Exception, match=r"Failed to open usd file: .*missing\.usd"):
        execute(snippet, names)
    assert names["success"] is False


# -- the guide to layers


def layer_snippets():
    """The code of its Python part, whose indentation the text has lost: `...` ends what a colon began."""
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
    names = {"usd_context_name": "", "instance_of_usd_context": context, "carb": carb, "heard": []}
    code = "\n".join(layer_snippets()).replace("XXXXXX", "SUBLAYERS_CHANGED")
    code = code.replace("        ...", "        heard.append(payload)")
    execute(code, names)
    for part in ("layers_state", "specs_linking", "specs_locking"):
        assert names[part] is not None
    usdlive.omni.kit.app.get_app().update()
    extra = Sdf.Layer.CreateAnonymous()
    context.get_stage().GetRootLayer().subLayerPaths.append(extra.identifier)
    for _ in range(3):
        usdlive.omni.kit.app.get_app().update()
    assert names["heard"]
    assert context.close_stage()


# -- the same as files


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
        "sublayers: 1 edit target is the new one: True", "undone group and left to others: []",
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
    """usdlive-omni, installed by pip."""
    target = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps",
                    "--no-build-isolation", "--disable-pip-version-check", "--target", str(target),
                    str(SHIM)],
                   check=True, capture_output=True)
    return target


def in_python(code, *folders):
    """With folders of installed packages, as Python finds them when it starts."""
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
    """As `./run python` has it, without anything being installed."""
    monkeypatch.setenv("PYTHONPATH", os.environ["PYTHONPATH"] + os.pathsep + str(SHIM / "tree"))
    in_python(f"{first}\nimport omni, omni.usd, carb, usdlive.omni, usdlive.omni._events\n"
              "assert omni is usdlive.omni and omni.usd.get_context()\n"
              "assert carb.events.IEvent is usdlive.omni._events.IEvent")
