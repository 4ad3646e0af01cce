"""The provider `omniMet` with a museum's service on loopback: content, requests, failures, hosts and the cache."""

import concurrent.futures
import json
import os
import socket
import subprocess
import sys
import time
import types

import pytest
from edf import PRELUDE, fresh, parameters, plugin_path, prim, scene
from museum import Museum


@pytest.fixture
def museum():
    one = Museum().start()
    yield one
    one.stop()


def shown(name, /, **arguments):
    return prim(name, parameters("omniMet", **arguments))


OPEN = """
        stage = Usd.Stage.Open("scene.usda")
        def counts(path="/A"):
            departments = stage.GetPrimAtPath(path).GetAllChildren()
            return [len(departments)] + [len(one.GetAllChildren()) for one in departments]
"""


def ask(folder, museum, code="result = counts()", **environment):
    return fresh(folder, OPEN + "        " + code, USDLIVE_EDF_MUSEUM_URL=museum.url, **environment)


@pytest.mark.parametrize("arguments, counts, requests", [
    ({}, [3, 0, 0, 0], 1),
    ({"dataLodLevel": 0}, [3, 0, 0, 0], 1),
    ({"dataLodLevel": -5}, [3, 0, 0, 0], 1),
    ({"dataLodLevel": 1, "lod1Count": 2}, [3, 2, 2, 2], 1 + 3 + 6),
    ({"dataLodLevel": 1, "lod1Count": 0}, [3, 5, 5, 5], 1 + 3 + 15),
    ({"dataLodLevel": 1, "lod1Count": -3}, [3, 5, 5, 5], 1 + 3 + 15),
    ({"dataLodLevel": 1, "lod1Count": 100}, [3, 5, 5, 5], 1 + 3 + 15),
    ({"dataLodLevel": 2, "lod1Count": 2}, [3, 5, 5, 5], 1 + 3 + 15),
    ({"dataLodLevel": "99999999999999999999"}, [3, 5, 5, 5], 1 + 3 + 15),
    ({"dataLodLevel": 1, "lod1Count": 2, "deferredRead": "true"}, [3, 2, 2, 2], 1 + 3 + 6),
])
def test_levels_and_counts(tmp_path, museum, arguments, counts, requests):
    scene(tmp_path, shown("A", **arguments))
    assert ask(tmp_path, museum).result == counts
    assert sum(museum.requests.values()) == requests and set(museum.requests.values()) == {1}, museum.requests


def test_many_departments_are_read_in_parallel_with_one_request_each(tmp_path):
    museum = Museum(departments=40, objects=3).start()
    museum.delay = 0.05
    scene(tmp_path, shown("A", dataLodLevel=2), shown("B", dataLodLevel=2), shown("C", dataLodLevel="2", lod1Count=9))
    ran = ask(tmp_path, museum, 'result = [counts(), len(edf(stage))]')
    museum.stop()
    assert ran.result == [[40] + 40 * [3], 1], "equal arguments share a layer"
    assert set(museum.requests.values()) == {1} and sum(museum.requests.values()) == 1 + 40 + 120
    assert 2 <= museum.most <= 8
    assert museum.connections <= 1 + 8 + 8, "connections are kept"


def test_deferred_departments_are_requested_when_they_are_needed(tmp_path, museum):
    scene(tmp_path, shown("A", dataLodLevel=1, lod1Count=2, deferredRead="true"))
    ran = fresh(tmp_path, """
        layer = Sdf.Layer.FindOrOpen("anon:edf:content.edf", {"dataProviderId": "omniMet",
            "providerArgs:dataLodLevel": "1", "providerArgs:lod1Count": "2", "providerArgs:deferredRead": "true"})
        opened = [layer.IsDetached(), len(layer.GetPrimAtPath("/Data").nameChildren)]
        result = opened + [len(layer.GetPrimAtPath("/Data/Department_2").nameChildren)]""",
                USDLIVE_EDF_MUSEUM_URL=museum.url)
    assert ran.result == [False, 3, 2]
    assert sorted(museum.requests) == ["/departments", "/objects/2000", "/objects/2001", "/objects?departmentIds=2"]


def test_content_follows_the_schema(tmp_path, museum):
    museum.departments[2] = "Art & Armor"
    museum.departments[3] = "Art   Armor"
    museum.changed["/objects/1000"] = {"objectName": "5 Röm. Cups", "title": 'A "cup"\n\x07', "accessionYear": 1979, "period": None}
    museum.changed["/objects/1001"] = {"artistRole": "", "artistDisplayName": None}
    scene(tmp_path, shown("A", dataLodLevel=2))
    ran = ask(tmp_path, museum, """
        a = stage.GetPrimAtPath("/A")
        first = a.GetChildren()[0].GetChildren()[0]
        second = a.GetChildren()[0].GetChildren()[1]
        value = lambda name: first.GetAttribute(name).Get()
        result = [names(stage), str(first.GetName()), [value(name) for name in ("objectId", "title", "accessionYear",
                  "isPublicDomain", "omni:met:artist:artistDisplayName")], first.GetAttribute("period").IsAuthored(),
                  str(first.GetMetadata("apiSchemas")), str(second.GetMetadata("apiSchemas")),
                  [str(first.GetAttribute(name).GetTypeName()) for name in ("objectId", "isHighlight")],
                  str(first.GetAttribute("title").GetVariability()), first.GetTypeName(), a.GetChildren()[0].GetTypeName(),
                  a.GetChildren()[0].GetAttribute("departmentId").Get()]""".strip())
    names, name, values, has_period, schemas, none, types, variability, kind, department, number = ran.result
    assert names == ["Department_1", "Art___Armor", "Art___Armor_3"]
    assert name == "__R__m__Cups1000"
    assert values == ["1000", 'A "cup"\n ', "1979", True, "Ada"]
    assert not has_period and "ArtistAPI" in schemas and "OmniMet" not in schemas and none == "None"
    assert types == ["string", "bool"] and "Uniform" in variability
    assert (kind, department, number) == ("AmaObject", "AmaDepartment", "1")


def test_schemas_define_all_that_the_provider_writes(tmp_path, museum):
    texts = ("accessionNumber accessionYear primaryImage primaryImageSmall department title culture period dynasty reign "
             "portfolio artistRole artistPrefix artistDisplayName artistDisplayBio artistSuffix artistAlphaSort "
             "artistNationality artistGender artistWikidata_URL artistULAN_URL").split()
    museum.changed["/objects/1000"] = {name: "x" for name in texts}
    scene(tmp_path, shown("A", dataLodLevel=2))
    ran = ask(tmp_path, museum, """
        department = stage.GetPrimAtPath("/A").GetChildren()[0]
        kinds = Usd.SchemaRegistry()
        result = []
        for prim in (department, department.GetChildren()[0]):
            defined = prim.GetPrimDefinition()
            result.append([str(kinds.FindSchemaInfo(prim.GetTypeName()).kind), list(prim.GetAppliedSchemas()),
                           len(prim.GetAuthoredAttributes()), prim.GetAuthoredPropertyNames() == defined.GetPropertyNames(),
                           [name for name in prim.GetAuthoredPropertyNames()
                            if defined.GetSchemaAttributeSpec(name).typeName != prim.GetAttribute(name).GetTypeName()
                            or defined.GetSchemaAttributeSpec(name).variability != prim.GetAttribute(name).GetVariability()]])
        second = department.GetChildren()[1]
        result.append([second.GetAttribute("period").Get(), second.GetAttribute("isHighlight").HasAuthoredValue()])""".strip())
    concrete = "ConcreteTyped"
    assert ran.result == [[concrete, [], 2, True, []], [concrete, ["ArtistAPI"], 24, True, []], ["", True]]


# --- failures ------------------------------------------------------------------------------------------


def test_a_service_that_is_down_is_an_error_and_recovers_on_reload(tmp_path, museum):
    scene(tmp_path, shown("A", dataLodLevel=1, lod1Count=1), prim("B", parameters("generator", size="1x1x1")),
          prim("C", parameters("omniMet", dataLodLevel=0), asset="./file.edf"))
    (tmp_path / "file.edf").touch()
    museum.stop()
    process = subprocess.Popen(
        [sys.executable, "-c", PRELUDE + """
stage = Usd.Stage.Open("scene.usda")
def show():
    print(json.dumps([len(names(stage, "/" + one)) for one in "ABC"] + [len(errors(stage))]), flush=True)
show()
for line in sys.stdin:
    stage.Reload()
    show()
"""], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=(tmp_path / "log").open("w"), cwd=tmp_path,
        env={**os.environ, "PXR_PLUGINPATH_NAME": plugin_path(), "USDLIVE_EDF_MUSEUM_URL": museum.url,
             "USDLIVE_CACHE": str(tmp_path / "cache")})

    def reload():
        process.stdin.write("\n")
        process.stdin.flush()
        return json.loads(process.stdout.readline())

    try:
        assert json.loads(process.stdout.readline()) == [0, 1, 0, 2]
        museum.start()
        assert reload() == [3, 1, 3, 0]
        museum.departments[4] = "New"
        museum.objects[4] = [4000]
        assert reload() == [4, 1, 4, 0], "a reload asks the service again"
        museum.stop()
        assert reload() == [4, 1, 4, 0], "what is known stays"
        museum.start()
    finally:
        process.kill()
        process.wait()
    log = (tmp_path / "log").read_text()
    assert "provider 'omniMet' of the plug-in usdliveEdfMuseum" in log and "Connection refused" in log
    assert "answers are from the cache" in log


@pytest.mark.parametrize("target, body, cause", [
    ("/departments", b"no json", "it is no JSON"),
    ("/departments", b"[]", "it is no JSON object"),
    ("/departments", b'{"departments": {}}', "there is no list 'departments'"),
    ("/departments", b'{"departments": [{"departmentId": "../../x"}]}', "has no number 'departmentId'"),
    ("/departments", b'{"departments": [{"departmentId": 1, "displayName": []}]}', "is no text"),
    ("/departments", b'{"departments": ' + b"[" * 500_000, "it is no JSON"),
    ("/departments", b'{"departments": [{"departmentId": 1, "displayName": "\xff"}]}', "it is no JSON"),
    ("/departments", b" " * (17 << 20), "the answer is too large: it has more than 16777216 bytes"),
    ("/departments", 500, "HTTP 500"),
    ("/departments", 301, "HTTP 301"),
], ids=lambda value: repr(value)[:40])  # pytest writes them into the environment, which has a limit
def test_departments_that_cannot_be_read_are_an_error(tmp_path, museum, target, body, cause):
    if isinstance(body, int):
        museum.statuses[target] = body
    else:
        museum.bodies[target] = body
    scene(tmp_path, shown("A", dataLodLevel=1), prim("B", parameters("generator", size="1x1x1")))
    ran = ask(tmp_path, museum, 'result = [names(stage), names(stage, "/B"), errors(stage)]')
    assert ran.result[:2] == [[], ["Item_0"]]
    assert len(ran.result[2]) == 1 and "</A>" in ran.result[2][0] and "omniMet" in ran.result[2][0]
    assert cause in ran.warnings and "/departments" in ran.warnings


def test_parts_that_cannot_be_read_are_left_out_with_one_warning(tmp_path, museum):
    museum.bodies["/objects?departmentIds=1"] = b'{"objectIDs": [1, "two"]}'
    museum.bodies["/objects?departmentIds=2"] = b'{"total": 0, "objectIDs": null}'
    museum.objects[3] = [3000, 3001, 3000, 3002, 3003, 3004, 3005]
    museum.statuses["/objects/3000"] = 404
    museum.bodies["/objects/3001"] = b'{"objectID": 3002, "objectName": "another"}'
    museum.bodies["/objects/3003"] = b'{"objectID": 3003, "title": {}}'
    museum.bodies["/objects/3004"] = b'{"objectID": 3004, "title": "' + b"x" * (2 << 20) + b'"}'
    scene(tmp_path, shown("A", dataLodLevel=2))
    ran = ask(tmp_path, museum)
    assert ran.result == [3, 0, 0, 2]
    assert "1 department could not be read" in ran.warnings and "an id in 'objectIDs' is no number" in ran.warnings
    assert "4 objects could not be read" in ran.warnings and ran.warnings.count("could not be read") == 2
    assert "omniMet" in ran.warnings


def test_slow_answers_end_at_the_limit(tmp_path, museum):
    museum.drip["/objects/2000"] = 0.2  # a byte now and then
    scene(tmp_path, shown("A", dataLodLevel=2))
    begin = time.monotonic()
    ran = ask(tmp_path, museum, USDLIVE_EDF_REQUEST_SECONDS="0.7")
    assert ran.result == [3, 5, 4, 5]
    assert "no complete answer within 700 ms" in ran.warnings
    assert time.monotonic() - begin < 20


def test_a_service_that_hangs_is_given_up(tmp_path):
    museum = Museum(departments=30, objects=5).start()
    scene(tmp_path, shown("A", dataLodLevel=0), name="first.usda")
    scene(tmp_path, shown("A", dataLodLevel=2))
    fresh(tmp_path, 'Usd.Stage.Open("first.usda")', USDLIVE_EDF_MUSEUM_URL=museum.url)
    museum.delay = 3
    ran = ask(tmp_path, museum, 'result = [names(stage), errors(stage)]', USDLIVE_EDF_REQUEST_SECONDS="0.3")
    museum.stop()
    assert ran.result[0] == [] and len(ran.result[1]) == 1
    assert "30 departments could not be read" in ran.warnings
    assert sum(museum.requests.values()) <= 2 + 2 * 8, "not one time-out for each department"


def test_hosts_that_are_not_allowed_are_not_reached(tmp_path, museum):
    scene(tmp_path, shown("A", baseAddress=museum.url), shown("B", baseAddress="https://example.org"),
          shown("C", baseAddress="file:///etc/passwd"), shown("D", baseAddress="http://user@" + museum.url[7:]))
    ran = fresh(tmp_path, 'result = errors(Usd.Stage.Open("scene.usda"))')
    assert len(ran.result) == 4 and not museum.requests
    assert "127.0.0.1:" in ran.warnings and "is not allowed. Allow it with USDLIVE_EDF_ALLOWED_HOSTS=127.0.0.1" in ran.warnings
    assert "example.org, is not allowed" in ran.warnings and "does not begin with http://" in ran.warnings

    scene(tmp_path, shown("A", baseAddress=museum.url + "/"))
    for allowed, found in {"example.org": [], "example.org, 127.0.0.1": 3, museum.url[7:].partition("/")[0]: 3,
                           "127.0.0.1:1": []}.items():
        ran = fresh(tmp_path, 'result = names(Usd.Stage.Open("scene.usda"))', USDLIVE_EDF_ALLOWED_HOSTS=allowed)
        assert len(ran.result) == (found or 0), allowed
    ran = fresh(tmp_path, 'result = names(Usd.Stage.Open("scene.usda"))', USDLIVE_EDF_MUSEUM_URL=museum.url)
    assert len(ran.result) == 3, "the address of this machine's owner"


def test_without_an_address_the_error_says_what_to_set(tmp_path):
    scene(tmp_path, shown("A"))
    assert "set USDLIVE_EDF_MUSEUM_URL" in fresh(tmp_path, 'Usd.Stage.Open("scene.usda")').warnings


@pytest.mark.parametrize("arguments, cause", [
    ({"dataLodLevel": "high"}, "dataLodLevel is 'high', which is no number"),
    ({"lod1Count": "1.5"}, "lod1Count is '1.5', which is no number"),
    ({"deferredRead": "maybe"}, "it must be true or false"),
])
def test_arguments_that_are_wrong_are_an_error(tmp_path, museum, arguments, cause):
    scene(tmp_path, shown("A", **arguments))
    assert cause in ask(tmp_path, museum, "result = errors(stage)").warnings
    assert not museum.requests


# --- HTTPS ---------------------------------------------------------------------------------------------


def certificate(folder, host):
    """Makes a file with a certificate for the host, which is its own authority, and with its key."""
    file = folder / f"{host.replace(':', '-')}.pem"
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                    "-days", "2", "-subj", "/CN=museum", "-addext", f"subjectAltName={host}",
                    "-keyout", file.with_suffix(".key"), "-out", file], check=True, capture_output=True)
    file.write_text(file.read_text() + file.with_suffix(".key").read_text())
    return file


def test_https_needs_a_certificate_of_the_host_that_is_trusted(tmp_path):
    scene(tmp_path, shown("A", dataLodLevel=1, lod1Count=2))
    trusted = certificate(tmp_path, "IP:127.0.0.1")
    museum = Museum(certificate=trusted).start()
    refused = ask(tmp_path, museum, "result = errors(stage)")
    assert len(refused.result) == 1 and not museum.requests
    assert "is self-signed. Set USDLIVE_CA to a file with this certificate to trust it" in refused.warnings
    ran = ask(tmp_path, museum, USDLIVE_CA=str(trusted), XDG_CONFIG_HOME=str(tmp_path))
    assert not (tmp_path / "usdlive" / "servers.json").exists(), "nothing is remembered of other services"
    assert ran.result == [3, 2, 2, 2] and museum.connections <= 1 + 1 + 3 + 6
    museum.stop()

    other = certificate(tmp_path, "DNS:museum.example")
    museum = Museum(certificate=other).start()
    museum.requests.clear()
    refused = ask(tmp_path, museum, "result = errors(stage)", SSL_CERT_FILE=str(other), USDLIVE_CACHE=str(tmp_path / "new"))
    assert len(refused.result) == 1 and not museum.requests
    assert "is for another host" in refused.warnings, refused.warnings
    museum.stop()


def test_a_service_that_does_not_speak_tls_is_an_error(tmp_path, museum):
    scene(tmp_path, shown("A"))
    secure = types.SimpleNamespace(url=museum.url.replace("http:", "https:"))
    ran = ask(tmp_path, secure, "result = errors(stage)")
    assert len(ran.result) == 1 and "does not speak TLS" in ran.warnings and "ws://" not in ran.warnings, ran.warnings
    with socket.create_server(("127.0.0.1", 0)) as silent:
        secure = types.SimpleNamespace(url=f"https://127.0.0.1:{silent.getsockname()[1]}")
        ran = ask(tmp_path, secure, "result = errors(stage)", USDLIVE_EDF_REQUEST_SECONDS="0.3")
    assert len(ran.result) == 1 and "cannot encrypt the connection to 127.0.0.1:" in ran.warnings


# --- the cache -----------------------------------------------------------------------------------------


def files(folder, part="*"):
    return sorted(file for file in folder.glob(f"{part}/*/*") if file.is_file())


def test_cached_answers_are_revalidated_or_fresh(tmp_path, museum):
    museum.etags = True
    scene(tmp_path, shown("A", dataLodLevel=2))
    assert ask(tmp_path, museum).result == [3, 5, 5, 5]
    assert museum.unchanged == 0 and len(files(tmp_path / "cache", "keys")) == 19
    museum.changed["/objects/1000"] = {"title": "changed"}
    museum.headers = {"Cache-Control": "public, max-age=600"}
    museum.requests.clear()
    title = 'result = stage.GetPrimAtPath("/A/Department_1/Cup1000").GetAttribute("title").Get()'
    assert ask(tmp_path, museum, title).result == "changed"
    assert museum.unchanged == 18 and set(museum.requests.values()) == {1}
    museum.requests.clear()
    assert ask(tmp_path, museum, title).result == "changed"
    assert not museum.requests, "fresh answers are not requested"
    museum.headers = {"Cache-Control": "no-store"}
    assert ask(tmp_path, museum, title, USDLIVE_CACHE=str(tmp_path / "other")).result == "changed"
    assert files(tmp_path / "other", "keys") == []
    assert ask(tmp_path, museum, title, USDLIVE_EDF_CACHE="0", USDLIVE_CACHE=str(tmp_path / "third")).result == "changed"
    assert files(tmp_path / "third") == []


def test_damaged_files_of_the_cache_count_as_absent(tmp_path, museum):
    museum.headers = {"Cache-Control": "max-age=600"}
    scene(tmp_path, shown("A", dataLodLevel=2))
    assert ask(tmp_path, museum).result == [3, 5, 5, 5]
    for number, file in enumerate(files(tmp_path / "cache", "keys")):
        content = file.read_bytes()
        lines = content.split(b"\n")
        lines[1] = b"9" + lines[1]  # fresh for ever
        file.write_bytes([content[:-1], content[:len(content) // 2], b"", b"\n".join(lines), content, content][number % 6])
    museum.requests.clear()
    assert ask(tmp_path, museum).result == [3, 5, 5, 5]
    assert 6 <= sum(museum.requests.values()) < 19  # a third is cut in half or empty, and a third is as it was
    for number, file in enumerate(files(tmp_path / "cache", "files")):
        content = file.read_bytes()
        file.write_bytes([content[:-1], b"", content.replace(b"m", b"n"), content][number % 4])
    museum.requests.clear()
    assert ask(tmp_path, museum).result == [3, 5, 5, 5]
    assert 0 < sum(museum.requests.values()) < 19


def test_a_cache_that_cannot_be_used_costs_only_the_caching(tmp_path, museum):
    (tmp_path / "file").write_text("text")
    scene(tmp_path, shown("A", dataLodLevel=1, lod1Count=1))
    assert ask(tmp_path, museum, USDLIVE_CACHE=str(tmp_path / "file" / "cache")).result == [3, 1, 1, 1]


def test_the_cache_has_a_bound(tmp_path):
    museum = Museum(departments=4, objects=30).start()
    for objects in museum.objects.values():
        for number in objects:
            museum.changed[f"/objects/{number}"] = {"title": "x" * 60_000}
    scene(tmp_path, shown("A", dataLodLevel=2))
    assert ask(tmp_path, museum, USDLIVE_CACHE_MIB="2").result == [4, 30, 30, 30, 30]
    museum.stop()
    sizes = [file.stat().st_size for file in files(tmp_path / "cache")]
    assert 1 << 20 < sum(sizes) <= 2 << 20


def test_processes_share_a_cache_and_may_be_killed(tmp_path):
    museum = Museum(departments=6, objects=20).start()
    museum.etags = True
    scene(tmp_path, shown("A", dataLodLevel=2))
    environment = {**os.environ, "PXR_PLUGINPATH_NAME": plugin_path(), "USDLIVE_EDF_MUSEUM_URL": museum.url,
                   "USDLIVE_CACHE": str(tmp_path / "cache"), "USDLIVE_CACHE_MIB": "4"}
    for delay in (0.25, 0.3, 0.35, 0.4):
        doomed = [subprocess.Popen([sys.executable, "-c", 'from pxr import Usd; Usd.Stage.Open("scene.usda")'],
                                   cwd=tmp_path, env=environment) for _ in range(2)]
        time.sleep(delay)
        for one in doomed:
            one.kill()
            one.wait()
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda _: ask(tmp_path, museum).result, range(3)))
    museum.stop()
    assert found == [[6] + 6 * [20]] * 3
    assert len(files(tmp_path / "cache", "keys")) == 127


def test_without_the_service_cached_answers_are_used(tmp_path, museum):
    scene(tmp_path, shown("A", dataLodLevel=1, lod1Count=1))
    assert ask(tmp_path, museum).result == [3, 1, 1, 1]
    address = museum.url
    museum.stop()
    ran = fresh(tmp_path, OPEN + "        result = counts()", USDLIVE_EDF_MUSEUM_URL=address)
    museum.start()
    assert ran.result == [3, 1, 1, 1]
    assert "from the cache" in ran.warnings and "cannot be reached" in ran.warnings
