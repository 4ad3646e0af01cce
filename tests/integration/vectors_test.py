"""Reads the samples of tests/vectors with code that shares nothing with the product."""

import json
import os
import pathlib
import re

import compact
import pytest
import usdlive
import wire

VECTORS = pathlib.Path(__file__).parents[1] / "vectors"
FRAMES = VECTORS / "frames.json"
COMPACT = VECTORS / "compact.json"


def as_json(value):
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, (list, tuple)):
        return [as_json(one) for one in value]
    if isinstance(value, dict):
        return {name: as_json(one) for name, one in value.items()}
    return value


def as_now(kind, members):
    """The members of a sample; members that the schema got later are absent."""
    if kind in wire.UNIONS and members:
        return [members[0], as_now(members[0], members[1])]
    if isinstance(members, list):
        return [as_now(kind, one) for one in members]
    if kind not in wire.TABLES or members is None:
        return members
    types = {one.name: one.type for one in wire.TABLES[kind]}
    absent = {name: 0 if of in wire.SCALARS else [] if of[0] == "[" and of != "[ubyte]" else None
              for name, of in types.items()}
    return {name: as_now(types[name].strip("[]"), value) for name, value in (absent | members).items()}


def test_frames_have_their_meaning():
    samples = json.loads(FRAMES.read_text())
    for sample in samples["frames"]:
        frame = bytes.fromhex(sample["bytes"])
        kind, members = wire.decode(frame)
        after = None
        if kind == "Commit":
            after = (members["hash_after"] or wire.chain_hash(members["previous"], frame)).hex()
        if os.environ.get("USDLIVE_WRITE_VECTORS") and "kind" not in sample:
            sample |= {"kind": kind, "members": as_json(members)} | ({"after": after} if after else {})
        assert (sample["kind"], as_now(kind, sample["members"])) == (kind, as_json(members)), sample["name"]
        assert sample.get("after") == after, sample["name"]
        # Another writer's layout has the same meaning.
        again = wire.decode(wire.encode(kind, members)[4:])
        assert as_json(again) == as_json((kind, members)), sample["name"]
    if os.environ.get("USDLIVE_WRITE_VECTORS"):
        FRAMES.write_text(json.dumps(samples, indent=1, ensure_ascii=False) + "\n")


def test_every_kind_of_frame_has_a_sample():
    kinds = {sample["kind"] for sample in json.loads(FRAMES.read_text())["frames"]}
    assert kinds == {kind for kind in wire.UNIONS["Body"] if kind != "NONE"}


def test_compact_frames_have_their_meaning():
    samples = json.loads(COMPACT.read_text())
    reader, writer, again = compact.Reader(), compact.Writer(), compact.Reader()
    for sample in samples["frames"]:
        kind, members = reader.read(bytes.fromhex(sample["bytes"]))
        if os.environ.get("USDLIVE_WRITE_VECTORS") and "kind" not in sample:
            sample |= {"kind": kind, "members": as_json(members)}
        assert (sample["kind"], sample["members"]) == (kind, as_json(members)), sample["name"]
        if kind == "Submit":  # another writer's numbers have the same meaning
            message = writer.submit(members["sequence"], members["base"], members["edits"], members["gesture"])
            contents = [again.read(frame) for frame in wire.split(message)]
            assert as_json(contents[-1]) == as_json((kind, members)), sample["name"]
    if os.environ.get("USDLIVE_WRITE_VECTORS"):
        COMPACT.write_text(json.dumps(samples, indent=1, ensure_ascii=False) + "\n")
    assert {sample["kind"] for sample in samples["frames"]} == {
        "Submit", "Commit", "Acceptance", "Preview", "Names"}


def test_damaged_compact_frames_are_refused():
    for sample in json.loads(COMPACT.read_text())["refused"]:
        if sample["code"] == "invalidLayerName":
            continue  # the reader does not know LN1
        with pytest.raises(compact.Malformed):
            compact.Reader().read(bytes.fromhex(sample["bytes"]))


def test_error_codes_are_the_same_in_every_language():
    table = json.loads((VECTORS.parents[1] / "common/protocol/errors.json").read_text())["errors"]
    codes = [error["code"] for error in table]
    assert [code.value for code in usdlive.ErrorCode] == codes
    assert [code.passes for code in usdlive.ErrorCode] == [error.get("passes", False) for error in table]
    assert usdlive.ErrorCode.LAYER_NOT_FOUND == "layerNotFound" and usdlive.ErrorCode.STORAGE_FULL.passes
    script = pathlib.Path(os.environ["USDLIVE_BUILD"]) / "typescript/errorCodes.ts"
    texts = re.findall(r"^  (\w+): (\".*\"),$", script.read_text(), re.M)
    assert [(code, json.loads(text)) for code, text in texts] == [(e["code"], e["text"]) for e in table]
    passing = re.findall(r'^  "(\w+)",$', script.read_text(), re.M)
    assert passing == [error["code"] for error in table if error.get("passes")]
