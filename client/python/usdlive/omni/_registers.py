"""What is written in a layer, register by register, and taking back what one wrote without what others did.

A register is the smallest thing that can be written: a field, one key of a dictionary, one time sample, one
item of a list; and that a spec is there at all.
"""

from __future__ import annotations

import bisect
import contextlib
import dataclasses
import typing

from pxr import Sdf, Tf

ABSENT: typing.Any = type("Absent", (), {"__repr__": lambda _: "nothing"})()
_LISTS = ("explicitItems", "prependedItems", "appendedItems", "deletedItems", "addedItems", "orderedItems")
_LIST_EDITORS = {"targetPaths": "targetPathList", "connectionPaths": "connectionPathList"}

Fields = dict[str, typing.Any]
Part = tuple[str, ...] | float | None


@dataclasses.dataclass(frozen=True)
class Kept:
    """What an undo left as it is, because another one has written it since."""

    layer: str
    path: str
    field: str | None
    part: Part
    reason: str

    def __str__(self) -> str:
        where = f"{self.layer} <{self.path}>" + (f" {self.field}" if self.field else "")
        if self.part is not None:
            where += f" {':'.join(self.part) if isinstance(self.part, tuple) else self.part}"
        return f"{where}: {self.reason}"


def hold(layer: Sdf.Layer) -> Sdf.Layer:
    """A reference that keeps the layer: what a stage gives, and Sdf.Layer.Find(), does not."""
    return Sdf.Layer.FindOrOpen(layer.identifier) or layer


# -- reading


def paths_below(layer: Sdf.Layer, root: Sdf.Path) -> list[Sdf.Path]:
    """Of all specs from `root` down, parents first; none when it is not there."""
    found: list[Sdf.Path] = []
    if layer.GetObjectAtPath(root):
        layer.Traverse(root, lambda path: found.append(path) if not path.IsTargetPath() else None)
    return found[::-1]


def _spec(layer: Sdf.Layer, path: Sdf.Path) -> Sdf.Spec | None:
    if path == Sdf.Path.absoluteRootPath:
        return layer.pseudoRoot
    is_variant = path.IsPrimVariantSelectionPath() and path.GetVariantSelection()[1]
    return layer.GetPrimAtPath(path) if is_variant else layer.GetObjectAtPath(path)


def _owner(path: Sdf.Path) -> Sdf.Path:
    """What a spec is in; of a variant, its set, which has the path `/A{set=}`."""
    parent = path.GetParentPath()
    if path.IsPrimVariantSelectionPath() and path.GetVariantSelection()[1]:
        return parent.AppendVariantSelection(path.GetVariantSelection()[0], "")
    return parent


def read_fields(layer: Sdf.Layer, path: Sdf.Path) -> Fields:
    """The fields of a spec; sublayers with their offsets, as `subLayers`."""
    spec = _spec(layer, path)
    fields: Fields = {}
    if not isinstance(spec, Sdf.Spec):
        return fields
    for field in spec.ListInfoKeys():
        if field == "subLayers":
            fields[field] = list(zip(layer.subLayerPaths, layer.subLayerOffsets))
        elif field != "subLayerOffsets":
            fields[field] = spec.GetInfo(field)
    return fields


def _flat(value: dict, keys: tuple[str, ...] = ()) -> dict[tuple[str, ...], typing.Any]:
    leaves: dict[tuple[str, ...], typing.Any] = {}
    for key, item in value.items():
        if isinstance(item, dict) and item:
            leaves.update(_flat(item, (*keys, key)))
        else:
            leaves[(*keys, key)] = item
    return leaves


def _parts(field: str, value: typing.Any) -> dict[Part, typing.Any]:
    """A field's value as registers."""
    if value is ABSENT:
        return {}
    if field == "timeSamples":
        return dict(value)
    return dict(_flat(value)) if isinstance(value, dict) else {None: value}


def same(a: typing.Any, b: typing.Any) -> bool:
    if a is b or type(a) is not type(b):
        return a is b
    return bool(a == b) or bool(a != a) and repr(a) == repr(b)  # with NaN in it


@dataclasses.dataclass(frozen=True)
class Change:
    path: Sdf.Path
    field: str
    part: Part
    old: typing.Any
    new: typing.Any


def changes_between(path: Sdf.Path, old: Fields, new: Fields) -> list[Change]:
    changes = []
    for field in dict.fromkeys((*old, *new)):
        before, after = (_parts(field, fields.get(field, ABSENT)) for fields in (old, new))
        for part in dict.fromkeys((*before, *after)):
            values = before.get(part, ABSENT), after.get(part, ABSENT)
            if not same(*values):
                changes.append(Change(path, field, part, *values))
    return changes


def _read(layer: Sdf.Layer, path: Sdf.Path, field: str, part: Part) -> typing.Any:
    value = read_fields(layer, path).get(field, ABSENT)
    return value if part is None else _parts(field, value).get(part, ABSENT)


# -- writing


def _write_sublayers(layer: Sdf.Layer, entries: list[tuple[str, Sdf.LayerOffset]]) -> None:
    layer.subLayerPaths = [path for path, _ in entries]
    for index, (_, offset) in enumerate(entries):
        if layer.subLayerOffsets[index] != offset:
            layer.subLayerOffsets[index] = offset


def _write_list(editor: typing.Any, op: typing.Any) -> None:
    if op is ABSENT:
        editor.ClearEdits()
        return
    if op.isExplicit:
        editor.ClearEditsAndMakeExplicit()
        editor.explicitItems = op.explicitItems
        return
    editor.ClearEdits()
    for name in _LISTS[1:]:
        if items := getattr(op, name):
            setattr(editor, name, items)


def _with_key(value: dict, keys: tuple[str, ...], item: typing.Any) -> dict:
    value = dict(value)
    if len(keys) > 1:
        inner = value.get(keys[0])
        item = _with_key(inner if isinstance(inner, dict) else {}, keys[1:], item)
        if not item:
            item = ABSENT
    if item is ABSENT:
        value.pop(keys[0], None)
    else:
        value[keys[0]] = item
    return value


def write(layer: Sdf.Layer, path: Sdf.Path, field: str, part: Part, value: typing.Any) -> None:
    """One register; ABSENT takes it away."""
    spec = _spec(layer, path)
    if field == "timeSamples" and part is not None:
        if value is ABSENT:
            layer.EraseTimeSample(path, part)
        else:
            layer.SetTimeSample(path, part, value)
    elif part is not None:
        current = spec.GetInfo(field) if spec.HasInfo(field) else {}
        changed = _with_key(current, part, value)
        spec.SetInfo(field, changed) if changed else spec.ClearInfo(field)
    elif field == "subLayers":
        _write_sublayers(layer, [] if value is ABSENT else value)
    elif field == "primOrder":
        spec.nameChildrenOrder = [] if value is ABSENT else value
    elif field in _LIST_EDITORS:
        _write_list(getattr(spec, _LIST_EDITORS[field]), value)
    elif value is ABSENT:
        spec.ClearInfo(field)
    else:
        spec.SetInfo(field, value)


def remove_spec(layer: Sdf.Layer, path: Sdf.Path) -> None:
    if path.IsPropertyPath():
        owner, spec = layer.GetPrimAtPath(path.GetParentPath()), layer.GetPropertyAtPath(path)
        if owner and spec:
            owner.RemoveProperty(spec)
    elif path.IsPrimVariantSelectionPath():
        name, variant = path.GetVariantSelection()
        owner = layer.GetPrimAtPath(path.GetParentPath())
        variants = owner.variantSets.get(name) if owner else None
        if variants is None:
            return
        if not variant:
            del owner.variantSets[name]
        elif variant in variants.variants:
            variants.RemoveVariant(variants.variants[variant])
    elif layer.GetPrimAtPath(path):
        del _spec(layer, path.GetParentPath()).nameChildren[path.name]


def children_of(layer: Sdf.Layer, path: Sdf.Path) -> list[str]:
    spec = _spec(layer, path)
    return list(spec.nameChildren.keys()) if isinstance(spec, Sdf.PrimSpec) else []


def arrange(layer: Sdf.Layer, parent: Sdf.Path, order: list[str], names: typing.Collection[str]) -> None:
    """Puts each of `names` that is there after the ones it followed in `order`."""
    siblings, names = children_of(layer, parent), set(names)
    places = {name: index for index, name in enumerate(siblings)}
    last = -1  # where the one before is
    for name in order:
        if name not in places:
            continue
        if name in names and not last < places[name] <= last + 1:
            _reorder(layer, parent.AppendChild(name), last + 1)
            siblings = children_of(layer, parent)
            places = {name: index for index, name in enumerate(siblings)}
        last = max(last, places[name])


def _misplaced(names: list[str], order: list[str]) -> set[str]:
    """The fewest that have to be moved for `names` to be in `order`: all but a longest part that is."""
    places = {name: index for index, name in enumerate(order)}
    known = [name for name in names if name in places]
    tails: list[int] = []  # of the part of each length, the least last place; and who stands there
    ends: list[str] = []
    before: dict[str, str | None] = {}
    for name in known:
        length = bisect.bisect_left(tails, places[name])
        tails[length:length + 1], ends[length:length + 1] = [places[name]], [name]
        before[name] = ends[length - 1] if length else None
    stays, name = set(), ends[-1] if ends else None
    while name is not None:
        stays.add(name)
        name = before[name]
    return set(known) - stays


def _reorder(layer: Sdf.Layer, path: Sdf.Path, index: int) -> None:
    edit = Sdf.BatchNamespaceEdit()
    edit.Add(Sdf.NamespaceEdit.Reorder(path, index))
    with contextlib.suppress(Tf.ErrorException):  # 26.8 does it, and says that the paths overlap
        layer.Apply(edit)


# -- lists that several have edited


def _merged_back(current: list, new: list, old: list) -> list:
    """`current` without what came from `old` to `new`, and with what others did to it."""
    added = [item for item in new if item not in old]
    kept = [item for item in current if item not in added]
    common = [item for item in new if item in old]
    if [item for item in kept if item in common] == common:
        order = iter([item for item in old if item in new])
        kept = [next(order) if item in common else item for item in kept]
    for index, item in enumerate(old):
        if item in new or item in kept:
            continue
        behind = [kept.index(earlier) for earlier in old[:index] if earlier in kept]
        kept.insert(behind[-1] + 1 if behind else 0, item)
    return kept


def _merged_op(current: typing.Any, new: typing.Any, old: typing.Any) -> typing.Any:
    """The same for a list op; ABSENT when others made it explicit, or no longer so."""
    made = type(next(op for op in (current, new, old) if op is not ABSENT))
    current, new, old = (made() if op is ABSENT else op for op in (current, new, old))
    if current.isExplicit != new.isExplicit or new.isExplicit != old.isExplicit:
        return ABSENT
    for name in _LISTS[:1] if current.isExplicit else _LISTS[1:]:
        merged = _merged_back(*(list(getattr(op, name)) for op in (current, new, old)))
        if merged != list(getattr(current, name)):
            setattr(current, name, merged)
    return current


def _is_list_op(value: typing.Any) -> bool:
    return hasattr(value, "prependedItems") and hasattr(value, "isExplicit")


def _take_back(layer: Sdf.Layer, change: Change, force: bool) -> Kept | None:
    def keep(reason: str) -> Kept:
        return Kept(layer.identifier, str(change.path), change.field, change.part, reason)

    if _spec(layer, change.path) is None:
        return keep("it is no longer there")
    current = _read(layer, change.path, change.field, change.part)
    if force or same(current, change.new):
        write(layer, change.path, change.field, change.part, change.old)
        return None
    if same(current, change.old):
        return None
    if change.field == "subLayers":
        lists = [[] if value is ABSENT else value for value in (current, change.new, change.old)]
        write(layer, change.path, change.field, None, _merged_back(*lists))
        return None
    if any(_is_list_op(value) for value in (current, change.new)):
        merged = _merged_op(current, change.new, change.old)
        if merged is not ABSENT:
            write(layer, change.path, change.field, None, merged)
            return None
    return keep("it was written by another one since")


# -- recording


class _Scope:
    """What a layer had at a path, and below when `deep`, at some time."""

    def __init__(self, layer: Sdf.Layer, root: Sdf.Path, deep: bool):
        self.root, self.deep = root, deep
        paths = paths_below(layer, root) if deep else [root] if _spec(layer, root) else []
        self.fields = {path: read_fields(layer, path) for path in paths}
        self.order = {path: children_of(layer, path) for path in paths if not path.IsPropertyPath()}
        self.order[root.GetParentPath()] = children_of(layer, root.GetParentPath())
        self.copy = Sdf.Layer.CreateAnonymous(".usda")
        if deep:
            self._copy(layer, root)

    def _copy(self, layer: Sdf.Layer, root: Sdf.Path) -> None:
        if root == Sdf.Path.absoluteRootPath:
            for prim in layer.rootPrims:
                Sdf.CopySpec(layer, prim.path, self.copy, prim.path)
        elif root in self.fields:
            if root.GetParentPath() != Sdf.Path.absoluteRootPath:
                Sdf.CreatePrimInLayer(self.copy, root.GetPrimOrPrimVariantSelectionPath().GetParentPath()
                                      if not root.IsPropertyPath() else root.GetPrimPath())
            Sdf.CopySpec(layer, root, self.copy, root)


class _Recorded:
    """The difference between a scope before and after."""

    def __init__(self, layer: Sdf.Layer, before: _Scope, after: _Scope):
        self.layer, self.before, self.after = layer, before, after
        self.created = [path for path in after.fields if path not in before.fields]
        gone = before.fields.keys() - after.fields.keys()
        self.deleted = [path for path in before.fields if path in gone and _owner(path) not in gone]
        self.changes = [change for path, fields in after.fields.items() if path in before.fields
                        for change in changes_between(path, before.fields[path], fields)]

    def is_empty(self) -> bool:
        return not (self.created or self.deleted or self.changes)

    def undo(self, force: bool) -> list[Kept]:
        kept = [k for change in self.changes if (k := _take_back(self.layer, change, force))]
        if force:
            created = set(self.created)
            for path in self.created:
                if _owner(path) not in created:
                    remove_spec(self.layer, path)
        else:
            kept += self._remove_created()
        return kept + self._restore_deleted(force)

    def _remove_created(self) -> list[Kept]:
        """From the leaves up: one that others have added to stays."""
        kept = []
        for path in reversed(self.created):
            spec = _spec(self.layer, path)
            if spec is None:
                continue
            changed = changes_between(path, self.after.fields[path], read_fields(self.layer, path))
            filled = len(paths_below(self.layer, path)) > 1
            if changed or filled:
                reason = "another one has written it since" if changed else "another one's work is below it"
                kept.append(Kept(self.layer.identifier, str(path), None, None, reason))
            else:
                remove_spec(self.layer, path)
        return kept

    def _restore_deleted(self, force: bool) -> list[Kept]:
        kept, restored = [], set()
        for path in reversed(self.deleted):  # siblings in their order
            reason = ""
            if _spec(self.layer, path) is not None and not force:
                reason = "another one has made it anew"
            elif _spec(self.layer, _owner(path)) is None:
                reason = "what it was in is no longer there"
            if reason:
                kept.append(Kept(self.layer.identifier, str(path), None, None, reason))
                continue
            Sdf.CopySpec(self.before.copy, path, self.layer, path)
            restored.add(path)
        for parent, order in self.before.order.items():
            if children_of(self.layer, parent) != order:
                names = order if force or self._is_order_ours(parent) else {
                    path.name for path in restored if path.GetParentPath() == parent}
                arrange(self.layer, parent, order, names)
        return kept

    def _is_order_ours(self, parent: Sdf.Path) -> bool:
        """Nobody has moved since what was there all the time."""
        written = self.after.order.get(parent, [])
        common = set(written).intersection(self.before.order[parent])
        now = [name for name in children_of(self.layer, parent) if name in common]
        return now == [name for name in written if name in common]


class Record:
    """What was written, and the way back."""

    def __init__(self, parts: list[_Recorded]):
        self._parts = parts

    def is_empty(self) -> bool:
        return not self._parts

    def layers(self) -> list[Sdf.Layer]:
        return list(dict.fromkeys(part.layer for part in self._parts))

    def undo(self, is_shared: typing.Callable[[Sdf.Layer], bool] = lambda _: False) -> list[Kept]:
        """In a layer that is shared, only what is still as it was written goes back; the rest is returned.
        In others the state before comes back, whatever was done since."""
        return [kept for part in reversed(self._parts) for kept in part.undo(not is_shared(part.layer))]


class Recorder:
    """Told before something is written: `touch()` keeps what is there. Costs what the touched parts hold."""

    def __init__(self) -> None:
        self._scopes: list[tuple[Sdf.Layer, _Scope]] = []

    def touch(self, layer: Sdf.Layer, path: Sdf.Path | str = "/", deep: bool = False) -> None:
        """The fields of the spec at `path`, whether it is there or not; with `deep`, everything below."""
        path = Sdf.Path(path)
        for known, scope in self._scopes:
            if known == layer and (scope.root == path and scope.deep >= deep
                                   or scope.deep and path.HasPrefix(scope.root)):
                return
        self._scopes.append((hold(layer), _Scope(layer, path, deep)))

    def touch_with_ancestors(self, layer: Sdf.Layer, path: Sdf.Path | str) -> None:
        """For a spec that is going to be made with the ancestors it lacks: all from the first of those on."""
        path = Sdf.Path(path)
        for prefix in path.GetPrefixes():
            if _spec(layer, prefix) is None:
                path = prefix
                break
        self.touch(layer, path, deep=True)

    def finish(self) -> Record:
        parts = [_Recorded(layer, scope, _Scope(layer, scope.root, scope.deep))
                 for layer, scope in self._scopes]
        self._scopes = []
        return Record([part for part in parts if not part.is_empty()])


def make_like(layer: Sdf.Layer, wanted: Sdf.Layer, root: Sdf.Path | str = "/") -> None:
    """Writes what differs at `root` and below, and nothing else: what others do beside it stays, and a live
    layer sends only that. (Sdf.Layer.TransferContent writes past a layer's delegate.)"""
    root = Sdf.Path(root)
    with Sdf.ChangeBlock():
        have, want = set(paths_below(layer, root)), paths_below(wanted, root)
        extra = have.difference(want)
        for path in extra:
            if _owner(path) not in extra:
                remove_spec(layer, path)
        for path in want:
            if path not in have:
                if _owner(path) in have:
                    Sdf.CopySpec(wanted, path, layer, path)
                continue
            for change in changes_between(path, read_fields(layer, path), read_fields(wanted, path)):
                write(layer, path, change.field, change.part, change.new)
        for path in want:
            if not path.IsPropertyPath() and (order := children_of(wanted, path)) != children_of(layer, path):
                arrange(layer, path, order, _misplaced(children_of(layer, path), order))
