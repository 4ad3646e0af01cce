"""The types of the entries of a dictionary. Python's values do not tell a float from a double; the text does."""

from __future__ import annotations

import re
import typing

from pxr import Sdf

from .._session import value_type_of

_TOKEN = re.compile(r"""\s*(?:
    (?P<text>'''(?:\\.|.)*?'''|\"\"\"(?:\\.|.)*?\"\"\"|'(?:\\.|[^'\\])*'|"(?:\\.|[^"\\])*")
    |(?P<asset>@@@(?:.)*?@@@|@[^@]*@)
    |(?P<sign>[{}()\[\]=;,])
    |(?P<word>[^\s{}()\[\]=;,'"@]+)
)""", re.VERBOSE | re.DOTALL)


def dictionary_types(spec: Sdf.Spec, field: str) -> dict:
    """Returns the numbers of the types (V1) by key; a dictionary of them for a nested one."""
    return next(_dictionaries(spec, field, field), {})


def reference_types(spec: Sdf.Spec) -> list[dict]:
    """The same for the custom data of each reference that has some, in the order of the text."""
    return list(_dictionaries(spec, "references", "customData"))


def _dictionaries(spec: Sdf.Spec, field: str, name: str) -> typing.Iterator[dict]:
    """The dictionaries with a name in the text of one field of the spec."""
    scratch = Sdf.Layer.CreateAnonymous(".usda")
    target = Sdf.Path("/P")
    if spec.path == Sdf.Path.absoluteRootPath:
        target = spec.path
    elif isinstance(spec, Sdf.PropertySpec):
        Sdf.PrimSpec(scratch, "P", Sdf.SpecifierDef)
        target = target.AppendProperty(spec.name)
    copied = {field, "specifier", "typeName", "custom", "variability"}
    Sdf.CopySpec(spec.layer, spec.path, scratch, target, lambda _, other, *__: other in copied, lambda *_: False)
    text = scratch.ExportToString()
    for start in re.finditer(rf"^\s*{re.escape(name)} = {{", text, re.MULTILINE):
        yield _dictionary(_tokens(text, start.end()))


def _tokens(text: str, at: int):
    while found := _TOKEN.match(text, at):
        at = found.end()
        yield found.lastgroup, found[found.lastgroup]


def _dictionary(tokens) -> dict:
    types: dict = {}
    for kind, word in tokens:
        if word == "}" and kind == "sign":
            break
        if kind == "sign":  # separates entries
            continue
        name = word
        kind, key = next(tokens)
        if (kind, key) == ("sign", "["):
            next(tokens)
            name += "[]"
            kind, key = next(tokens)
        if kind == "text":
            key = _unquoted(key)
        next(tokens)  # =
        kind, value = next(tokens)
        if name == "dictionary":
            types[key] = _dictionary(tokens)
            continue
        types[key] = value_type_of(name)
        if kind == "sign":
            depth = 1
            while depth:
                kind, value = next(tokens)
                if kind == "sign":
                    depth += (value in "([{") - (value in ")]}")
    return types


def _unquoted(text: str) -> str:
    for quote in ("'''", '"""', "'", '"'):
        if text.startswith(quote):
            inner = text[len(quote):-len(quote)]
            return re.sub(r"\\(x[0-9a-fA-F]{2}|.)", lambda found: _escaped(found[1]), inner)
    return text


def _escaped(code: str) -> str:
    if code[0] == "x" and len(code) == 3:
        return chr(int(code[1:], 16))
    return {"n": "\n", "r": "\r", "t": "\t"}.get(code, code)
