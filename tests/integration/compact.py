"""Compact frames (FR9-FR11 of PROTOCOL.md) in plain Python, for tests that share no code with the product. The members
have the names of common/protocol/frames.fbs; an edit names its layer itself."""

from __future__ import annotations

import struct

ACTIONS = ["CreateSpec", "DeleteSpec", "MoveSpec", "PlaceSpec", "SetField", "EraseField"]
PARTS = [None, "DictionaryKey", "SampleTime", "ListItem", "MapKey"]
OTHER_LAYER, HAS_CREATION = 0x40, 0x80
HAS_FORM, HAS_BEFORE = 0x40, 0x80
MIN_BYTES = 16


class Malformed(Exception):
    pass


def is_compact(frame):
    return frame[0] % 2 == 1


class Reader:
    """Reads the compact frames that one side of a connection sends, in order."""

    def __init__(self):
        self.names = {}

    def read(self, frame):
        """Returns (kind, members)."""
        self.frame, self.at = bytes(frame), 1
        self.layer, self.path = None, b""
        kinds = {1: self._submit, 3: self._commit, 5: self._acceptance, 7: self._preview, 9: self._told}
        if frame[0] not in kinds:
            raise Malformed(f"a frame of kind {frame[0]}")
        content = kinds[frame[0]]()
        rest = self.frame[self.at:]
        if rest and (len(frame) != MIN_BYTES or any(rest)):
            raise Malformed("it continues after its end")
        return content

    def _take(self, size):
        if self.at + size > len(self.frame):
            raise Malformed("it ends too early")
        self.at += size
        return self.frame[self.at - size:self.at]

    def _byte(self):
        return self._take(1)[0]

    def _number(self):
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    def _text(self, size):
        try:
            return self._take(size).decode()
        except UnicodeDecodeError as error:
            raise Malformed("a text is not UTF-8") from error

    def _name(self, code=None):
        code = self._number() if code is None else code
        if code % 2:
            if code >> 1 not in self.names:
                raise Malformed("a number that was not told")
            return self.names[code >> 1]
        return self._text(code >> 1)

    def _told(self):
        told = []
        for _ in range(self._number()):
            number, size = self._number(), self._number()
            if number >= 2048 or not 1 <= size <= 128:
                raise Malformed("a number or a name out of bounds")
            told.append((number, self._text(size)))
        self.names.update(told)
        return "Names", {"names": told}

    def _submit(self):
        return "Submit", {"sequence": self._number(), "base": self._number(), "gesture": self._number(),
                          "edits": self._edits()}

    def _preview(self):
        return "Preview", {"author": self._name(), "gesture": self._number(), "base": self._number(),
                           "edits": self._edits()}

    def _acceptance(self):
        members = {name: self._number() for name in ("revision", "epoch", "sequence", "time_ms")}
        return "Acceptance", members | {"previous": self._take(8), "hash_after": self._take(32)}

    def _commit(self):
        members = {"revision": self._number(), "epoch": self._number(), "client": self._name(),
                   "sequence": self._number(), "user": self._name(), "time_ms": self._number(),
                   "gesture": self._number(), "edits": self._edits()}
        members["dropped"] = [{"index": self._number(), "reason": self._name(), "edit": self._edit()}
                              for _ in range(self._number())]
        return "Commit", members | {"previous": self._take(8), "hash_after": self._take(32)}

    def _edits(self):
        return [self._edit() for _ in range(self._number())]

    def _edit(self):
        first = self._byte()
        if first & OTHER_LAYER:
            self.layer = self._name()
        if self.layer is None:
            raise Malformed("an edit names no layer")
        edit = {"layer": self.layer}
        edit["sequence"], edit["edit"] = self._creation(first & HAS_CREATION)
        edit["path"] = self._path()
        edit["action"] = self._action(ACTIONS[first & 7], PARTS[first >> 3 & 7])
        return edit

    def _creation(self, follows):
        return (self._number(), self._number()) if follows else (0, 0)

    def _path(self):
        code = self._number()
        if code and code % 2 == 0:
            self.path = self._name(code - 1).encode()
        elif code:
            shared = self._byte()
            if shared > len(self.path):
                raise Malformed("a path shares more than there is")
            self.path = self.path[:shared] + self._take(code - 1 >> 1)
        return self.path.decode()

    def _value(self):
        code, size = self._number(), self._number()
        content = self._take(32 if code % 2 else size)
        return struct.pack("<HBQ", code >> 1, code % 2, size) + content

    def _action(self, kind, part):
        if kind == "CreateSpec":
            return kind, {"kind": self._byte()}
        if kind == "DeleteSpec":
            return kind, {}
        if kind == "MoveSpec":
            sequence, edit = self._creation(self._byte())
            parent = {"path": self._name(), "sequence": sequence, "edit": edit}
            return kind, {"parent": parent, "name": self._name()}
        if kind == "PlaceSpec":
            return kind, {"before": self._name()}
        members = {"field": self._name(), "form": 0}
        members["part"] = self._part(part, members)
        if kind == "SetField" and part != "ListItem":
            members["value"] = self._value()
        return kind, members

    def _part(self, part, members):
        def form(first, value):
            members["form"] = struct.unpack_from("<H", value)[0] if first & HAS_FORM else 0
            return value

        if part is None:
            return None
        if part == "DictionaryKey":
            return part, {"path": [self._name() for _ in range(self._number())]}
        if part == "SampleTime":
            return part, {"time": struct.unpack("<d", self._take(8))[0]}
        first = self._byte()
        if part == "MapKey":
            return part, {"key": form(first, self._value())}
        item = form(first, self._value())
        return part, {"list": first & 0x3F, "item": item,
                      "before": self._value() if first & HAS_BEFORE else None}


class Writer:
    """Writes the compact frames of one side of a connection. It numbers each name at once, and spells all others."""

    def __init__(self):
        self.numbers = {}

    def submit(self, sequence, base, edits, gesture=0):
        """Returns a message: new names, if any, and the transaction."""
        self.data, self.new = bytearray([1]), {}
        self.layer, self.path = None, b""
        for number in (sequence, base, gesture, len(edits)):
            self._number(number)
        for edit in edits:
            self._edit(edit)
        frame = self._frame()
        if not self.new:
            return frame
        self.data = bytearray([9])
        self._number(len(self.new))
        for name, number in self.new.items():
            content = name.encode()
            self._number(number)
            self._number(len(content))
            self.data += content
        return self._frame() + frame

    def _frame(self):
        data = bytes(self.data).ljust(MIN_BYTES, b"\0")
        return struct.pack("<I", len(data)) + data

    def _number(self, value):
        while value > 0x7F:
            self.data.append(value & 0x7F | 0x80)
            value >>= 7
        self.data.append(value)

    def _code(self, name):
        """The number of a name, or None."""
        if not 3 <= len(name.encode()) <= 128 or len(self.numbers) == 2048:
            return self.numbers.get(name)
        if name not in self.numbers:
            self.numbers[name] = self.new[name] = len(self.numbers)
        return self.numbers[name]

    def _name(self, name):
        number = self._code(name)
        if number is not None:
            return self._number(number << 1 | 1)
        self._number(len(name.encode()) << 1)
        self.data += name.encode()

    def _edit(self, edit):
        kind, members = edit["action"]
        part = members.get("part")
        creation = edit.get("sequence", 0)
        first = ACTIONS.index(kind) | PARTS.index(part and part[0]) << 3
        first |= OTHER_LAYER * (edit["layer"] != self.layer) | HAS_CREATION * bool(creation)
        self.data.append(first)
        if first & OTHER_LAYER:
            self._name(edit["layer"])
        self.layer = edit["layer"]
        if creation:
            self._number(creation)
            self._number(edit["edit"])
        path = edit["path"].encode()
        number = self._code(edit["path"])
        if path == self.path:
            self._number(0)
        elif number is not None:
            self._number((number << 1 | 1) + 1)
        else:
            self._number((len(path) << 1) + 1)
            self.data.append(0)
            self.data += path
        self.path = path
        self._action(kind, members)

    def _value(self, encoded):
        kind, form, size = struct.unpack_from("<HBQ", encoded)
        self._number(kind << 1 | form)
        self._number(size)
        self.data += encoded[11:]

    def _action(self, kind, members):
        if kind == "CreateSpec":
            self.data.append(members["kind"])
        elif kind == "MoveSpec":
            parent = members["parent"]
            self.data.append(bool(parent.get("sequence")))
            if parent.get("sequence"):
                self._number(parent["sequence"])
                self._number(parent["edit"])
            self._name(parent["path"])
            self._name(members["name"])
        elif kind == "PlaceSpec":
            self._name(members.get("before") or "")
        elif kind in ("SetField", "EraseField"):
            self._name(members["field"])
            part, content = members.get("part") or (None, {})
            self._part(part, content, HAS_FORM * bool(members.get("form")))
            if kind == "SetField" and part != "ListItem":
                self._value(members["value"])

    def _part(self, part, content, form):
        if part == "DictionaryKey":
            self._number(len(content["path"]))
            for name in content["path"]:
                self._name(name)
        elif part == "SampleTime":
            self.data += struct.pack("<d", content["time"])
        elif part == "ListItem":
            before = content.get("before")
            self.data.append(content["list"] | form | HAS_BEFORE * (before is not None))
            self._value(content["item"])
            if before is not None:
                self._value(before)
        elif part == "MapKey":
            self.data.append(form)
            self._value(content["key"])
