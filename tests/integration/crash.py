"""Rebuilds what a crash may leave of a folder, from the trace of tests/interpose/interpose.cpp.

A file system keeps everything that was synced. Of the rest it keeps any part. Of a file's content it keeps a
beginning, or any pages. Of the creations, renames and removals of names it keeps a beginning if a journal
keeps them in order and any sync includes everything before it (ext4, XFS); it keeps any of them if only a
sync of the folder covers its names (POSIX). If a sync failed, its data is lost for ever, whatever is synced
later.
"""

from __future__ import annotations

import collections
import pathlib
import struct

HEADER = struct.Struct("<c3xiQII")
PAGE = 4096
CREATES, TRUNCATES = 1, 2

Record = collections.namedtuple("Record", "end did file number first second")


def environment(folder: pathlib.Path, trace: pathlib.Path, library: pathlib.Path, fault: str | None = None):
    """The variables for Server.environment."""
    more = {"USDLIVE_IO_FAULT": fault} if fault else {}
    return {"LD_PRELOAD": str(library), "USDLIVE_IO_FOLDER": str(folder) + "/",
            "USDLIVE_IO_TRACE": str(trace), **more}


def records(trace: pathlib.Path):
    """Reads the records of a trace. Record.end is its end in the file; an incomplete last record is left out."""
    data = trace.read_bytes()
    at = 0
    while at + HEADER.size <= len(data):
        did, file, number, first, second = HEADER.unpack_from(data, at)
        middle = at + HEADER.size + first
        at_next = middle + second
        if at_next > len(data):
            return
        first, second = data[at + HEADER.size:middle], data[middle:at_next]
        if did != b"w":
            first, second = first.decode(), second.decode()
        at = at_next
        yield Record(at, did.decode(), file, number, first, second)


class Change:
    """A change of a file's content or of names; it is certainly kept once it was synced."""

    def __init__(self, content):
        self.content = content
        self.synced = self.lost = False
        self.in_journal = False  # names: something was synced later


class File:
    def __init__(self):
        self.changes = []  # (offset, bytes) or a size

    def sync(self):
        for change in self.changes:
            change.synced |= not change.lost

    def lose(self):
        for change in self.changes:
            change.lost |= not change.synced


class Folder:
    def __init__(self, disk):
        self.disk = disk
        self.names = {}

    def sync(self):
        for change in self.disk.names:
            # A rename from one folder to another is kept if the target folder was synced.
            change.synced |= not change.lost and change.content[-1][0] is self

    def lose(self):
        for change in self.disk.names:
            change.lost |= not change.synced and change.content[-1][0] is self


class Disk:
    """The folder as processes see it, and the part of it that is certainly on the disk."""

    def __init__(self, folder: pathlib.Path):
        """The present content of `folder` is on the disk."""
        self.names = []  # changes of names: a list of (folder, name, new target or None)
        self.in_journal = 0  # how many of these are on the disk if it has a journal
        self.root = Folder(self)
        self.files = {}  # by the process's descriptors
        for path in sorted(folder.rglob("*")):
            made = File() if path.is_file() else Folder(self)
            self._name((str(path.relative_to(folder)), made))
            if path.is_file():
                made.changes.append(Change((0, path.read_bytes())))
                made.sync()
        for change in self.names:
            change.synced = change.in_journal = True

    def _place(self, path):
        at = self.root
        *parents, name = [part for part in path.split("/") if part]
        for parent in parents:
            at = at.names[parent]
        return at, name

    def _find(self, path):
        folder, name = self._place(path) if path.strip("/") else (None, None)
        return folder.names.get(name) if folder else self.root

    def _name(self, *entries):
        entries = [(*self._place(path), what) for path, what in entries]
        for folder, name, what in entries:
            folder.names.pop(name, None)
            if what is not None:
                folder.names[name] = what
        self.names.append(Change(entries))

    def take(self, record: Record) -> None:
        """Takes the next record of the trace."""
        did = record.did
        if did == "b":
            self.files = {}
        elif did == "o":
            found = self._find(record.first)
            if found is None:
                found = File()
                self._name((record.first, found))
            elif record.number & TRUNCATES:
                found.changes.append(Change(0))
            self.files[record.file] = found
        elif did == "w":
            self.files[record.file].changes.append(Change((record.number, record.first)))
        elif did == "t":
            self.files[record.file].changes.append(Change(record.number))
        elif did == "s":
            self.files[record.file].sync()
            for change in self.names[self.in_journal:]:
                change.in_journal = True
            self.in_journal = len(self.names)
        elif did == "l":
            self.files[record.file].lose()
        elif did == "r":
            self._name((record.first, None), (record.second, self._find(record.first)))
        elif did == "u":
            self._name((record.first, None))
        elif did == "m":
            self._name((record.first, Folder(self)))

    def write(self, folder: pathlib.Path, keeps) -> None:
        """Writes the folder as it may be after a crash; `keeps` decides which unsynced changes are kept."""
        entries = {}  # by folder: name -> target
        for change in keeps.names(self.names):
            for owner, name, what in change.content:
                entries.setdefault(owner, {}).pop(name, None)
                if what is not None:
                    entries[owner][name] = what
        self._write(self.root, folder, entries, keeps)

    def _write(self, owner, path, entries, keeps):
        path.mkdir(exist_ok=True)
        for name, what in entries.get(owner, {}).items():
            if isinstance(what, Folder):
                self._write(what, path / name, entries, keeps)
            else:
                with (path / name).open("wb") as file:
                    for content in keeps.content(what.changes):
                        if isinstance(content, int):
                            file.truncate(content)
                        else:
                            file.seek(content[0])
                            file.write(content[1])


class Everything:
    """No crash: everything that the processes see."""

    def names(self, changes):
        return changes

    def content(self, changes):
        return (change.content for change in changes)


class Kept:
    """The choices of a crash. `journal`: names are kept in order; `pages`: the kept pages of a file have no
    order either; `least`: nothing unsynced is kept."""

    def __init__(self, random, journal=True, pages=False, least=False):
        self.random, self.journal, self.pages, self.least = random, journal, pages, least

    def __str__(self):
        flags = [name for name in ("journal", "pages", "least") if getattr(self, name)]
        return " ".join(flags) or "posix"

    def names(self, changes):
        if not self.journal:
            share = 0 if self.least else self.random.choice((0, 0.5, 1))
            return [c for c in changes if c.synced or not c.lost and self.random.random() < share]
        sure = sum(change.in_journal for change in changes)
        return changes[:sure if self.least else self.random.randint(sure, len(changes))]

    def content(self, changes):
        left = sum(not change.synced and not change.lost for change in changes)
        left = 0 if self.least else self.random.choice((0, left, self.random.randint(0, left)))
        for change in changes:
            if change.synced:
                yield change.content
            elif change.lost:
                continue
            elif self.pages and not self.least:
                yield from self._pages(change.content)
            elif left > 0:
                left -= 1
                yield change.content
            elif left == 0:
                left = -1
                if not self.least:
                    yield self._torn(change.content)

    def _torn(self, content):
        if isinstance(content, int):
            return content
        return content[0], content[1][:self.random.randint(0, len(content[1]))]

    def _pages(self, content):
        if isinstance(content, int):
            if self.random.random() < 0.5:
                yield content
            return
        at, data = content
        begin = 0
        while begin < len(data):
            end = min(len(data), begin + PAGE - (at + begin) % PAGE)
            if self.random.random() < 0.5:
                yield at + begin, data[begin:end]
            begin = end
