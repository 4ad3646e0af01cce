"""The wire protocol in plain Python, for tests that share no code with the product: FlatBuffers by the schema
of common/protocol/frames.fbs, and a peer over a bare WebSocket."""

from __future__ import annotations

import collections
import hashlib
import json
import os
import pathlib
import re
import struct
import time
import uuid

import compact
from websockets.sync.client import connect

SCHEMA = pathlib.Path(__file__).parents[2] / "common/protocol/frames.fbs"
SCALARS = {"bool": "?", "ubyte": "B", "ushort": "H", "uint": "I", "ulong": "Q", "long": "q",
           "double": "d"}
CHUNK = 256 * 1024  # the size of a chunk of a big value
Member = collections.namedtuple("Member", "name type slot")


def _schema():
    text = re.sub(r"//.*", "", SCHEMA.read_text())
    unions = {name: ["NONE", *re.split(r"\s*,\s*", body.strip())]
              for name, body in re.findall(r"union (\w+) \{(.*?)\}", text, re.S)}
    tables = {}
    for name, body in re.findall(r"table (\w+) \{(.*?)\}", text, re.S):
        members, slot = [], 0
        for member, kind in re.findall(r"(\w+): *(\[?\w+\]?)", body):
            slot += kind in unions  # the slot before contains the kind of the member
            members.append(Member(member, kind, slot))
            slot += 1
        tables[name] = members
    return tables, unions


TABLES, UNIONS = _schema()


def _number(kind, data, at):
    return struct.unpack_from("<" + SCALARS[kind], data, at)[0]


def _value(kind, data, at):
    """Reads the value behind the offset at `at`."""
    at += _number("uint", data, at)
    if kind in TABLES:
        return _table(kind, data, at)
    count = _number("uint", data, at)
    if kind in ("string", "[ubyte]"):
        content = bytes(data[at + 4:at + 4 + count])
        return content.decode() if kind == "string" else content
    return [_value(kind[1:-1], data, at + 4 + 4 * index) for index in range(count)]


def _table(name, data, at):
    vtable = at - struct.unpack_from("<i", data, at)[0]
    slots = (_number("ushort", data, vtable) - 4) // 2

    def place(slot):
        offset = _number("ushort", data, vtable + 4 + 2 * slot) if slot < slots else 0
        return at + offset if offset else None

    values = {}
    for member in TABLES[name]:
        where = place(member.slot)
        if member.type in SCALARS:
            values[member.name] = (
                _number(member.type, data, where) if where else 0.0 if member.type == "double" else 0)
        elif member.type in UNIONS:
            kind = UNIONS[member.type][data[place(member.slot - 1)]] if where else None
            values[member.name] = (kind, _value(kind, data, where)) if where else None
        else:
            missing = [] if member.type[0] == "[" and member.type != "[ubyte]" else None
            values[member.name] = _value(member.type, data, where) if where else missing
    return values


def decode(frame):
    """Returns (kind, members) of a frame: scalars, text, bytes, lists and dictionaries; a union is (kind,
    members)."""
    assert bytes(frame[4:8]) == b"USDL"
    return _table("Frame", frame, _number("uint", frame, 0))["body"]


class _Builder:
    def __init__(self):
        self.data = bytearray(4) + b"USDL"

    def _align(self, size):
        self.data += bytes(-len(self.data) % size)

    def _refer(self, at, target):
        struct.pack_into("<I", self.data, at, target - at)

    def table(self, name, values):
        entries = []  # slot, format or (type, value)
        for member in TABLES[name]:
            value = values.get(member.name)
            if value is None:
                continue
            if member.type in SCALARS:
                entries.append((member.slot, SCALARS[member.type], value))
            elif member.type in UNIONS:
                entries.append((member.slot - 1, "B", UNIONS[member.type].index(value[0])))
                entries.append((member.slot, None, value))
            else:
                entries.append((member.slot, None, (member.type, value)))
        slots = max((entry[0] for entry in entries), default=-1) + 1
        self._align(2)
        vtable = len(self.data)
        self.data += bytes(4 + 2 * slots)
        self._align(8)
        at = len(self.data)
        self.data += struct.pack("<i", at - vtable)
        references = []
        for slot, form, value in entries:
            self._align(struct.calcsize(form or "I"))
            struct.pack_into("<H", self.data, vtable + 4 + 2 * slot, len(self.data) - at)
            if form is None:
                references.append((len(self.data), *value))
            self.data += struct.pack("<" + (form or "I"), 0 if form is None else value)
        struct.pack_into("<HH", self.data, vtable, 4 + 2 * slots, len(self.data) - at)
        for where, kind, value in references:
            self._refer(where, self.value(kind, value))
        return at

    def value(self, kind, value):
        if kind in TABLES:
            return self.table(kind, value)
        self._align(4)
        at = len(self.data)
        if kind in ("string", "[ubyte]"):
            content = value.encode() if kind == "string" else value
            self.data += struct.pack("<I", len(content)) + content + b"\0" * (kind == "string")
            return at
        self.data += struct.pack("<I", len(value)) + bytes(4 * len(value))
        for index, one in enumerate(value):
            self._refer(at + 4 + 4 * index, self.value(kind[1:-1], one))
        return at


def encode(kind, members):
    """Returns a message of one frame."""
    builder = _Builder()
    builder._refer(0, builder.table("Frame", {"body": (kind, members)}))
    return struct.pack("<I", len(builder.data)) + builder.data


def control(kind, **members):
    return encode("Control", {"json": json.dumps({"type": kind, **members})})


def hello(client, user="wire", resume=None, secret=None, features=()):
    more = {"resume": resume} if resume else {}
    if secret:
        more["secret"] = secret.hex()  # ID5
    return control("hello", protocol=2, oldestProtocol=2, features=["history", "log", "previews", *features],
                   client=client, user=user, application="tests", **more)


def split(message):
    """Returns the frames of a message (FR1)."""
    at = 0
    while at < len(message):
        size = _number("uint", message, at)
        yield message[at + 4:at + 4 + size]
        at += 4 + size


def new_client():
    """Returns an id without a secret, as clients of earlier versions have it."""
    return uuid.uuid4().hex


def new_secret() -> bytes:
    return os.urandom(32)


def client_of(secret: bytes) -> str:
    return "k" + hashlib.sha256(secret).hexdigest()[:31]  # ID5


def chain_hash(before: bytes, frame: bytes) -> bytes:
    return hashlib.sha256(before + frame).digest()  # CH1


def stored_zstd(content: bytes) -> bytes:
    """A zstd frame that compresses nothing (RFC 8878)."""
    blocks = [content[at:at + 0x20000] for at in range(0, len(content), 0x20000)] or [b""]
    return struct.pack("<IBI", 0xFD2FB528, 0xA0, len(content)) + b"".join(
        struct.pack("<I", len(block) << 3 | (block is blocks[-1]))[:3] + block for block in blocks)


class Broken(Exception):
    """The server broke a rule."""


class Peer:
    """A session. It checks the rules for the received history: contiguous, chained, epochs that do not fall
    (SE1, SE3, CH1)."""

    def __init__(self, url, client=None, user="wire", resume=None, timeout=10, secret=None, features=()):
        self.client = client or new_client()
        self.reader, self.writer = compact.Reader(), compact.Writer()
        self.sent = {}  # its transactions, by number
        self.socket = connect(f"{url}/live", compression=None, max_size=None, open_timeout=timeout,
                              ping_interval=None, close_timeout=0.5)
        self.waiting = collections.deque()
        try:
            self.socket.send(hello(self.client, user, resume, secret, features))
            self.welcome = self.expect("welcome", timeout)
        except BaseException:
            self.close()
            raise
        place = resume if self.welcome["resumed"] else self.welcome
        self.epoch, self.revision = self.welcome["epoch"], place["revision"]
        self.hash = bytes.fromhex(place["hash"])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self.socket.close()

    def send(self, message):
        self.socket.send(bytes(message))

    def frame(self, timeout=10):
        """Returns the next frame as (kind, members), a control message as (type, members). Raises
        TimeoutError."""
        while not self.waiting:
            self.waiting.extend(split(self.socket.recv(timeout=timeout)))
        raw = bytes(self.waiting.popleft())
        if compact.is_compact(raw):
            return self._compact(*self.reader.read(raw), timeout)
        kind, members = decode(raw)
        if kind == "Control":
            members = json.loads(members["json"])
            return members["type"], members
        if kind == "Commit":
            members["hash"] = members["hash_after"] or chain_hash(members["previous"], raw)
        return kind, members

    def _compact(self, kind, members, timeout):
        """The frame as a session without compact frames would receive it."""
        if kind == "Names":
            return self.frame(timeout)
        if kind == "Acceptance":  # FR11
            members |= {"client": self.client, "dropped": [], "edits": self.sent[members["sequence"]]}
        if kind in ("Commit", "Acceptance"):
            members["hash"] = members["hash_after"]
        return kind, members

    def follow(self, commit):
        """Takes the next commit of the live history, or the acceptance of it."""
        if commit["revision"] != self.revision + 1:
            raise Broken(f"SE1: revision {commit['revision']} after {self.revision}")
        if commit["previous"] != self.hash[:len(commit["previous"])]:
            raise Broken(f"CH1: the chain breaks at revision {commit['revision']}")
        if commit["epoch"] > self.epoch:
            raise Broken(f"SE3: epoch {commit['epoch']} in a session of {self.epoch}")
        self.revision, self.hash = commit["revision"], commit["hash"]

    def expect(self, kind, timeout=10):
        """Returns the next frame of this kind; skips others."""
        return self.expect_one_of({kind}, timeout)[1]

    def expect_one_of(self, kinds, timeout=10):
        """Returns the next frame of one of these kinds, and its kind; skips others."""
        end = time.monotonic() + timeout
        while True:
            seen, members = self.frame(max(0.001, end - time.monotonic()))
            if seen in kinds:
                return seen, members
            if seen == "errorMessage" and members["closing"]:
                raise Broken(f"{members['code']}: {members['message']}")

    def expect_error(self, timeout=10):
        """Returns the next errorMessage, whether it closes the session or not."""
        while True:
            seen, members = self.frame(timeout)
            if seen == "errorMessage":
                return members

    def log(self, first=1, last=0):
        """Returns the stored commits, verified as a chain."""
        self.send(control("requestLog", request=1, **{"from": first, "to": last}))
        self.expect("logBegin")
        commits = []
        while True:
            kind, members = self.frame(30)
            if kind == "logEnd":
                return commits
            if kind != "Commit":
                raise Broken(f"{kind} inside a log")
            if commits and (members["revision"] != commits[-1]["revision"] + 1
                            or members["previous"] != commits[-1]["hash"]):
                raise Broken(f"CH1: the log breaks at revision {members['revision']}")
            commits.append(members)

    def resume_point(self):
        return {"epoch": self.epoch, "revision": self.revision, "hash": self.hash.hex(), "store": self.welcome["store"]}

    def submit(self, sequence, layer, *edits, base=None):
        self.send(encode("Submit", {"client": self.client, "sequence": sequence, "layers": [layer],
                                    "base": self.revision if base is None else base,
                                    "edits": list(edits)}))

    def submit_compact(self, sequence, layer, *edits, base=None):
        """The same as a compact frame (FR9)."""
        self.sent[sequence] = [{"layer": layer, **edit} for edit in edits]
        self.send(self.writer.submit(sequence, self.revision if base is None else base, self.sent[sequence]))

    def upload(self, content):
        """B1: uploads a big value and waits until the server has it."""
        value = hashlib.sha256(content).digest()
        for at in range(0, len(content), CHUNK):
            part = content[at:at + CHUNK]
            self.send(encode("Blob", {"hash": value, "size": len(content), "offset": at,
                                      "raw_bytes": len(part), "data": stored_zstd(part)}))
        while self.expect("blobStored", 30)["hash"] != value.hex():
            pass


# --- edits -------------------------------------------------------------------------------------------

INT64, STRING = 5, 11


def leaf(kind: int, content: bytes) -> bytes:
    """V10, inline."""
    return struct.pack("<HBQ", kind, 0, len(content)) + content


def int64(value: int) -> bytes:
    return leaf(INT64, struct.pack("<q", value))


def string(text: str) -> bytes:
    return leaf(STRING, string_bytes(text))


def string_bytes(text: str) -> bytes:
    content = text.encode()
    return struct.pack("<I", len(content)) + content


def big_string(content: bytes) -> bytes:
    """V10: a text that travels beside the stream, from the result of string_bytes()."""
    return struct.pack("<HBQ", STRING, 1, len(content)) + hashlib.sha256(content).digest()


def set_field(path, field, value, part=None):
    return {"path": path, "action": ("SetField", {"field": field, "value": value, "part": part})}


def set_sample(path, time_code, value):
    return set_field(path, "timeSamples", value, ("SampleTime", {"time": float(time_code)}))


def big_values(commits):
    """The names of the big values (V9) that the commits' edits set whole, also the edits that were dropped."""
    edits = [edit for commit in commits
             for edit in [*commit["edits"], *(dropped["edit"] for dropped in commit["dropped"])]]
    contents = [edit["action"][1].get("value") for edit in edits]
    return {content[11:].hex() for content in contents if content and content[2] == 1}  # V10
