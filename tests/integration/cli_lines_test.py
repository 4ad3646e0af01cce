"""Runs every verb of the command line with an output that cannot be written, and with words that are missing or in the
wrong order. Such a line ends with an error, and never changes anything on the default server."""

import itertools
import os
import pathlib
import re
import stat
import subprocess
import sys
import threading

import pytest

ROOT = '#usda 1.0\n\ndef Xform "World"\n{\n}\n\n'
# The words after the URL of a correct line, and the options that the verb needs. FILE is a file of this machine.
LINES = {"ls": [], "who": [], "cat": ["root.usda"], "tree": ["root.usda"], "dump": ["root.usda"], "flatten": ["root.usda"],
         "log": ["root.usda"], "blame": ["root.usda", "/World"], "diff": ["root.usda", "1"], "revert": ["2"],
         "restore": ["1", "root.usda"], "watch": ["root.usda"], "save": ["root.usda"], "reload": ["root.usda"],
         "upload": ["FILE", "a.png"], "checkpoint": ["lunch"], "checkpoints": [], "compact": [], "stat": [],
         "mute": ["root.usda", "set.usda"], "unmute": ["root.usda", "set.usda"], "lock": ["root.usda"],
         "unlock": ["root.usda"], "session": ["list"]}
OPTIONS = {"dump": ["--composed"]}
# These ask no server, or one that they are told in another way.
LOCAL = {"access": ["--help"], "audit": ["--help"], "backup": ["--help"], "completion": ["bash"], "deny": ["--help"],
         "forget": ["127.0.0.1:1"], "grant": ["--help"], "help": [], "join": [], "login": ["--help"],
         "page": ["--help"], "revoke": ["--help"],
         "serve": ["--help"], "user": ["--help"]}
LEAST = {"cat": 1, "tree": 1, "dump": 1, "flatten": 1, "blame": 2, "diff": 2, "revert": 1, "restore": 1, "upload": 2, "checkpoint": 1, "mute": 2, "unmute": 2, "lock": 1,
         "unlock": 1, "session": 1}


def ended(verb, *words, **options):
    ran = subprocess.run([os.environ["USDLIVE_BIN"], verb, *OPTIONS.get(verb, []), *words], stderr=subprocess.PIPE,
                         text=True, timeout=60, **{"stdout": subprocess.PIPE, **options})
    return ran.returncode, ran.stdout, ran.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("lines")


def make(folder: pathlib.Path) -> pathlib.Path:
    folder.mkdir()
    for name in ("root.usda", "set.usda"):
        (folder / name).write_text(ROOT)
    return folder


@pytest.fixture
def served(serve, tmp_path):
    (tmp_path / "FILE").write_text("a texture")
    return serve(make(tmp_path / "shots"))


def line_of(verb, tmp_path):
    return [str(tmp_path / word) if word == "FILE" else word for word in LINES[verb]]


def test_the_table_has_every_verb():
    verbs = set(re.findall(r"^        (\w+)\) flags=", ended("completion", "bash")[1], re.MULTILINE))
    assert verbs == set(LINES) | set(LOCAL)


def closed_pipe():
    reader, writer = os.pipe()
    os.close(reader)
    return writer


def close_stdout():
    os.close(1)


def test_an_output_that_cannot_be_written_is_an_error(served, tmp_path):
    assert ended("lock", served.url, "root.usda")[0] == 0  # a commit, for `log`
    lines = [(verb, *words) for verb, words in LOCAL.items()] + [("--help",), ("--version",), ("serve", "--version")]
    for verb in LINES:
        if verb == "watch":
            continue
        lines.append((verb, served.url, *line_of(verb, tmp_path)))
        if verb not in ("dump", "flatten"):
            lines.append((verb, "--json", served.url, *line_of(verb, tmp_path)))
    printed = {line: bool(ended(*line)[1]) for line in lines if line[0] not in ("upload", "checkpoint")}
    for number, line in enumerate(lines):
        full, pipe = open("/dev/full", "w"), closed_pipe()
        for options in ({"stdout": full}, {"stdout": pipe}, {"stdout": None, "preexec_fn": close_stdout}):
            words = [word.replace("lunch", f"lunch {number} {len(options)} {options['stdout']}") for word in line]
            code, _, error = ended(*words, **options)
            if not printed.get(line, True):
                continue
            assert code == 1 and "standard output cannot be written" in error, (line, options, code, error)
        full.close()
        os.close(pipe)
    # The commands have done their work on the server.
    assert len(ended("checkpoints", served.url)[1].splitlines()) == 6
    assert (served.folder / "a.png").read_text() == "a texture"


@pytest.mark.parametrize("output", ["full", "pipe"])
def test_watching_ends_when_its_output_cannot_be_written(served, output):
    stdout = open("/dev/full", "w") if output == "full" else os.fdopen(closed_pipe(), "w")
    with stdout, subprocess.Popen([os.environ["USDLIVE_BIN"], "watch", served.url], stdout=stdout, stderr=subprocess.PIPE,
                                  text=True) as watch:
        while watch.poll() is None:
            ended("lock", served.url, "root.usda")
            ended("unlock", served.url, "root.usda")
        assert watch.returncode == 1 and "standard output cannot be written" in watch.stderr.read()


def state_of(url, folder):
    """Returns all that a verb can change on a server."""
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    return files, ended("checkpoints", url)[1], ended("log", url)[1], ended("ls", "--long", url)[1]


def test_missing_and_swapped_words_never_reach_the_default_server(served, serve, tmp_path, monkeypatch):
    default = serve(make(tmp_path / "default"))
    monkeypatch.setenv("USDLIVE_URL", default.url)
    monkeypatch.chdir(tmp_path)
    before = state_of(default.url, default.folder)
    url = served.url.removeprefix("ws://")
    for verb, words in LINES.items():
        words = ["FILE" if word == "FILE" else word for word in words]
        lines = {order for order in itertools.permutations([url, *words]) if order[0] != url}
        for count in range(LEAST.get(verb, 0)):
            lines |= {order for kept in itertools.combinations(words, count)
                      for order in itertools.permutations([url, *kept])}
        lines |= {(url, *words, url), (url, url, *words)}
        for line in lines:
            if verb in ("dump", "flatten") and line[0] != url and len(line) == 1:
                continue
            code, out, error = ended(verb, *line)
            if verb == "checkpoint" and line == (url, url):  # after a URL, a name may look like one
                continue
            if verb == "session" and sorted(line) == sorted((url, *words)):  # its URL may be anywhere
                continue
            assert code == 2 and not out, (verb, line, code, out, error)
            assert "usdlive" in error and f"usdlive help {verb}" in error, (verb, line, error)
    assert state_of(default.url, default.folder) == before


def test_words_that_only_resemble_an_address_have_a_way(served, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "take:2.png").write_text("a texture")
    assert ended("lock", served.url, "root.usda")[0] == 0  # there is a revision to name
    assert ended("upload", served.url, "./take:2.png", "take.png")[0] == 0
    assert ended("checkpoint", served.url, "v2:final")[0] == 0
    monkeypatch.setenv("USDLIVE_URL", served.url)
    assert ended("checkpoint", "dinner: 1")[0] == 0
    code, _, error = ended("checkpoint", "v3:final")
    assert code == 2 and "write the URL before it" in error
    code, _, error = ended("upload", "take:2.png", "take.png")
    assert code == 2 and "./take:2.png" in error


def test_a_pipe_is_written_to_and_not_replaced(served, tmp_path):
    for verb in ("flatten", "dump"):
        pipe = tmp_path / f"{verb}.usda"
        os.mkfifo(pipe)
        got = []
        reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
        reader.start()
        code, _, error = ended(verb, served.url, "root.usda", "--out", str(pipe))
        reader.join(20)
        assert code == 0 and "World" in got[0] and stat.S_ISFIFO(pipe.stat().st_mode), error
    code, _, error = ended("flatten", served.url, "root.usda", "--out", "/dev/full")
    assert code == 1 and "cannot write the file '/dev/full': No space left on device" in error
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


def test_every_program_answers_version():
    programs = ([os.environ["USDLIVE_BIN"]], [os.environ["USDLIVE_BIN"], "serve"], [os.environ["USDLIVE_SERVER_BIN"]],
                [sys.executable, "-m", "usdlive"])
    answers = [subprocess.run([*program, "--version"], capture_output=True, text=True, check=True).stdout.split()
               for program in programs]
    assert [answer[:-1] for answer in answers] == [["usdlive"], ["usdlive", "serve"], ["usdlive-server"], ["usdlive"]]
    assert len({answer[-1] for answer in answers}) == 1
