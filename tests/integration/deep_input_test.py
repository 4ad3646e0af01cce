"""Tests that the composed commands and the server survive input that is too deep for OpenUSD, and name layer, path and limit."""

import os
import subprocess

import pytest
from conftest import refused, run

COMMANDS = [("tree", "--composed"), ("dump", "--composed"), ("flatten",)]


def ran(*arguments):
    """Returns the output and the errors of a command that succeeds."""
    done = subprocess.run([os.environ["USDLIVE_BIN"], *arguments], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-300:]
    return done.stdout, done.stderr


def deep(elements):
    return "/d" * elements


def write(path, text):
    path.write_text("#usda 1.0\n" + text)
    return str(path)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: one[0])
def test_prims_that_are_nested_200000_deep_are_refused(command, tmp_path):
    file = write(tmp_path / "deep.usda", 'def "d" {\n' * 200_000 + "}\n" * 200_000)
    message = refused(*command, file)
    assert file in message and "line 4098" in message and "4096 brackets" in message


@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: one[0])
@pytest.mark.parametrize("arc", ["references", "payload", "inherits", "specializes"])
def test_an_arc_to_a_deep_path_leaves_out_its_prim(command, arc, tmp_path):
    file = write(tmp_path / "arc.usda", f'def "A" (\n {arc} = <{deep(60_000)}>\n) {{\n}}\ndef "Other" {{\n}}\n')
    output, errors = ran(*command, file)
    assert "Other" in output
    if command[0] != "dump":
        assert file in errors and "</A>" in errors and "60000 elements" in errors and "at most 512" in errors


@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: one[0])
def test_a_layer_with_a_path_of_a_million_elements_is_left_out(command, tmp_path):
    bad = write(tmp_path / "bad.usda", f'def "A" {{\n rel r = <{deep(1_000_000)}>\n}}\n')
    assert bad in refused(*command, bad)
    output, errors = ran(*command, write(tmp_path / "root.usda", '(\n subLayers = [@./bad.usda@]\n)\ndef "Other" {\n}\n'))
    assert "Other" in output
    if command[0] != "dump":
        assert bad in errors and "65535 elements" in errors


@pytest.mark.parametrize("ending", ["usda", "usd"])
def test_a_server_refuses_a_file_that_is_too_deep_and_serves_the_others(ending, project, serve):
    name = f"deep.{ending}"
    write(project / name, 'def "d" {\n' * 200_000 + "}\n" * 200_000)
    write(project / "parentheses.usda", f'def "A" {{\n pathExpression e = "{"(" * 100_000}"\n}}\n')
    write(project / "other.usda", 'def "Other" {\n}\n')
    server = serve(project)
    message = refused("cat", server.url, name)
    assert name in message and "line 4098" in message and "4096 brackets" in message
    assert "parentheses" in refused("cat", server.url, "parentheses.usda")
    assert "Other" in run("cat", server.url, "other.usda")
    write(project / name, 'def "Mended" {\n}\n')
    assert "Mended" in run("cat", server.url, name)
    assert server.stop() == 0
