"""Run by wheel_test.py in a bare Linux: a server, an editor that edits, and one that sees the edit. Prints JSON."""

import json
import pathlib
import re
import subprocess
import sys
import time

URL = "ws://127.0.0.1:7447"
PORT_FILE = pathlib.Path("/tmp/port")


def libraries(process) -> list[str]:
    maps = pathlib.Path(f"/proc/{process}/maps").read_text()
    return sorted(set(re.findall(r" (/\S+\.so\S*)$", maps, re.MULTILINE)))


def until(condition, *ticking):
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "the condition did not become true in time"
        for one in ticking:
            one.tick()
        time.sleep(0.01)


def edit() -> dict:
    server = subprocess.Popen(["usdlive", "serve", "/project", "--port", "7447", "--port-file", PORT_FILE])
    until(PORT_FILE.exists)
    import usdlive

    live = usdlive.connect(URL, user="ada")
    stage = live.open_stage("shot.usda")
    other = subprocess.Popen([sys.executable, __file__, "see"], stdout=subprocess.PIPE, text=True)
    stage.GetAttributeAtPath("/A.x").Set(7.0)
    until(lambda: other.poll() is not None, live)
    answer = json.loads(other.stdout.read())
    answer["cat"] = subprocess.run(["usdlive", "cat", f"{URL}/shot.usda"], check=True, text=True, stdout=subprocess.PIPE).stdout
    answer["libraries"] = {"server": libraries(server.pid), "editor": libraries("self")}
    live.close()
    server.terminate()
    assert server.wait(20) == 0
    return answer


def see() -> dict:
    import usdlive
    from pxr import Usd

    live = usdlive.connect(URL, user="bo")
    stage = live.open_stage("shot.usda")
    until(lambda: stage.GetAttributeAtPath("/A.x").Get() == 7.0, live)
    resolved = Usd.Stage.Open(URL.replace("ws:", "usdlive:") + "/shot.usda")
    import omni.usd

    return {"omni": omni.usd.__name__, "seen": stage.GetAttributeAtPath("/A.x").Get(), "resolved": resolved.GetAttributeAtPath("/A.x").Get()}


print(json.dumps(see() if sys.argv[1:] else edit()))
