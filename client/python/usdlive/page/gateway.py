"""The gateway: the pictures, and who looks at them. On the thread of the event loop."""

from __future__ import annotations

import asyncio
import concurrent.futures
import itertools
import logging
import typing

import usdlive

from . import wire
from .access import Person, Server
from .blobs import Blobs
from .editing import Editor
from .history import Reader
from .owned import Owner
from .picture import Picture
from .presence import APPLICATION, People
from .viewer import Viewer

_log = logging.getLogger("usdlive.page")

MOST_VIEWERS = 200
MOST_PICTURES = 16  # other stages and the past take memory each
_CHECK_SECONDS = 5.0
_PEOPLE_SECONDS = 0.1
_LAYERS_SECONDS = 0.5


class TooMany(Exception):
    """A bound was reached; the text says which."""


class Gateway:
    """Holds the picture of the stage that was asked for, and others while somebody looks at them."""

    def __init__(self, url: str, stage: str, user: str = ""):
        self.server = Server(url)
        self.url, self._user = url, user
        self.blobs = Blobs()
        self.viewers: dict[int, Viewer] = {}
        self.workers = concurrent.futures.ThreadPoolExecutor(8, "usdlive page worker")
        # Wrong tokens are answered slowly (AC5), which must not delay other work.
        self._sign_ins = concurrent.futures.ThreadPoolExecutor(4, "usdlive page sign-in")
        # A merge of a live session reads all commits of two lines.
        self._for_sessions = concurrent.futures.ThreadPoolExecutor(8, "usdlive page live sessions")
        self._stage = stage
        self._numbers = itertools.count(1)
        self._pictures: dict[typing.Hashable, Picture] = {}
        self._loop: asyncio.AbstractEventLoop
        self._tasks: set[asyncio.Task] = set()
        self.people = People()
        self._reader: Reader | None = None
        self._owners: set[Owner] = set()  # all that run
        self._layers_text = ""
        self.main: Picture  # from start() on

    # -- its life

    async def start(self) -> None:
        """Connects and opens the stage. Raises a usdlive.Error."""
        self._loop = asyncio.get_running_loop()
        if self.server.secure:
            await self.in_worker(self._meet)
        await self.in_worker(self.server.find_out)
        if not self._stage:
            self._stage = await self.in_worker(self._choose_stage)
        self.main = await self._open(("live", self._stage), self._stage, None)
        for job, seconds in ((self._check_people, _CHECK_SECONDS), (self._tell_people, _PEOPLE_SECONDS),
                             (self._tell_layers, _LAYERS_SECONDS)):
            self.spawn(self._repeat(job, seconds))

    async def stop(self) -> None:
        for task in tuple(self._tasks):
            task.cancel()
        for viewer in tuple(self.viewers.values()):
            viewer.leave()
        for owner in self._owners:
            owner.close()
        # The interpreter must not end while a thread is within a connection.
        await asyncio.to_thread(lambda: [owner.join(10) for owner in self._owners])
        for workers in (self.workers, self._sign_ins, self._for_sessions):
            workers.shutdown(wait=False, cancel_futures=True)

    def spawn(self, job: typing.Coroutine) -> None:
        task = self._loop.create_task(job)
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            _log.error("an error of the gateway: %r", task.exception(), exc_info=task.exception())

    def in_worker(self, function: typing.Callable, *arguments: typing.Any) -> asyncio.Future:
        return asyncio.get_running_loop().run_in_executor(self.workers, function, *arguments)

    def with_sessions(self, function: typing.Callable, person: Person, *arguments: typing.Any) -> asyncio.Future:
        """Calls a function of `lines` in the name of a viewer."""
        return asyncio.get_running_loop().run_in_executor(self._for_sessions, lambda: function(self.server, person, *arguments))

    def connect(self) -> usdlive.Live:
        return usdlive.connect(self.url, user=self._user, application=APPLICATION)

    def _meet(self) -> None:
        """Connects once, so that this user's programs know the certificate, or refuse it, before tokens are sent."""
        self.connect().close(timeout=0)

    def _choose_stage(self) -> str:
        """A layer near the top of the project whose name says that it is the stage."""
        with self.connect() as live:
            layers = live.layers()
        if not layers:
            raise usdlive.Error("layerNotFound", "the project has no layer yet; add one, or name it with --stage")
        known = ("root", "main", "stage", "shot", "scene", "world")

        def rank(layer: str) -> tuple:
            name = layer.rsplit("/", 1)[-1].rsplit(".", 1)[0].lower()
            return layer.count("/"), known.index(name) if name in known else len(known), layer

        return min(layers, key=rank)

    # -- pictures

    async def _open(self, key: typing.Hashable, layer: str, past: int | None) -> Picture:
        picture = self._pictures.get(key)
        if picture is None:
            if len(self._pictures) >= MOST_PICTURES:
                raise TooMany(f"{MOST_PICTURES} stages are open already; try again when somebody has closed one")
            picture = self._pictures[key] = Picture(self.connect, layer, self.blobs, self, past)
            self._begin(picture)
        try:
            await asyncio.shield(asyncio.wrap_future(picture.ready))
        except Exception:
            self._pictures.pop(key, None)
            raise
        return picture

    async def look_at(self, viewer: Viewer, layer: str | None = None, past: int | None = None) -> Picture:
        """Shows a viewer another stage, or the past of one. Each viewer has a past of their own."""
        layer = layer or viewer.picture.layer
        key = ("live", layer) if past is None else ("past", layer, viewer.number)
        before = viewer.picture
        if past is not None and self._pictures.get(key) is before:
            await asyncio.wrap_future(before.call(before.seek, past))
            return before
        picture = await self._open(key, layer, past)
        if viewer.is_gone:
            self._close_unwatched()
            return picture
        if picture is not before:
            viewer.picture = picture
            viewer.restart()
            await self.welcome(viewer)
            self._close_unwatched()
        return picture

    def _close_unwatched(self) -> None:
        watched = {viewer.picture for viewer in self.viewers.values()} | {self.main}
        for key, picture in tuple(self._pictures.items()):
            if picture not in watched and picture.ready.done():
                del self._pictures[key]
                picture.close()

    # -- other connections

    def reader(self) -> Reader:
        """The connection that asks about the history. It begins when it is first needed."""
        if self._reader is None or not self._reader.is_alive():
            self._reader = Reader("history", self.connect)
            self._begin(self._reader)
        return self._reader

    def editor(self, viewer: Viewer) -> Editor:
        """Begins a connection with which a viewer edits."""
        person = viewer.person

        def connect() -> usdlive.Live:
            return usdlive.connect(self.url, user=person.name, application="page", token=person.token)

        editor = Editor(person.name, connect, lambda message: self._soon(viewer.tell, message))
        self._begin(editor)
        return editor

    def _begin(self, owner: Owner) -> None:
        self._owners = {one for one in self._owners if one.is_alive()} | {owner}
        owner.start()

    # -- viewers

    def person(self, token: str, name: str) -> asyncio.Future:
        """Asks the server who somebody is. Its result is a Person; it raises Refused."""
        return asyncio.get_running_loop().run_in_executor(self._sign_ins, self.server.person, token, name)

    async def enter(self, person: Person) -> Viewer:
        if len(self.viewers) >= MOST_VIEWERS:
            raise TooMany(f"{MOST_VIEWERS} pages are open already")
        viewer = Viewer(next(self._numbers), person, self.main)
        self.viewers[viewer.number] = viewer
        try:
            await self.welcome(viewer)
        except Exception:
            self.leave(viewer)
            raise
        viewer.tell_latest("presence", self.people.text_without(viewer.id))
        if self._layers_text:
            viewer.tell_latest("layers", self._layers_text)
        return viewer

    async def welcome(self, viewer: Viewer) -> None:
        picture = viewer.picture
        about, state = await asyncio.wrap_future(picture.call(lambda: (picture.welcome(), picture.state())))
        viewer.tell({"type": "welcome", "project": self.server.project or self.server.host, "session": self.server.session, **about,
                     "you": {"id": viewer.id, "user": viewer.person.name, "role": viewer.person.role, "mayEdit": viewer.person.may_edit,
                             "mayAdminister": viewer.person.may_administer}})
        viewer.tell(state)

    def leave(self, viewer: Viewer) -> None:
        viewer.leave()
        self.viewers.pop(viewer.number, None)
        if viewer.editor is not None:
            viewer.editor.close()
        self._close_unwatched()

    # -- what pictures tell: on their threads

    def show(self, picture: Picture, frames: list[wire.Frame], version: int) -> None:
        self._soon(self._show, picture, frames, version)

    def show_one(self, viewer: Viewer, frames: list[wire.Frame], begins: bool) -> None:
        self._soon(self._show_one, viewer, frames, begins)

    def _soon(self, function: typing.Callable, *arguments: typing.Any) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:
            pass  # the loop has ended

    def _show(self, picture: Picture, frames: list[wire.Frame], version: int) -> None:
        for viewer in self.viewers.values():
            if viewer.picture is picture:
                viewer.show(frames, version)

    @staticmethod
    def _show_one(viewer: Viewer, frames: list[wire.Frame], begins: bool) -> None:
        if begins:
            viewer.begin_scene()
        viewer.show(frames)

    # -- jobs that repeat

    @staticmethod
    async def _repeat(job: typing.Callable[[], typing.Awaitable[None]], seconds: float) -> None:
        last = ""
        while True:
            await asyncio.sleep(seconds)
            try:
                await job()
            except Exception as failed:
                if str(failed) != last:
                    last = str(failed)
                    _log.exception("an error of the gateway, which goes on")

    async def _check_people(self) -> None:
        """Ends the pages of users whose tokens have ended."""
        for viewer in tuple(self.viewers.values()):
            if viewer.person.token and not await self.in_worker(self.server.still_in, viewer.person):
                viewer.expel("your sign-in has ended")

    async def _tell_people(self) -> None:
        others = await asyncio.wrap_future(self.main.call(self.main.live.presences))
        if self.people.update(others, self.viewers.values()):
            for viewer in self.viewers.values():
                viewer.tell_latest("presence", self.people.text_without(viewer.id))

    async def _tell_layers(self) -> None:
        text = wire.text(await asyncio.wrap_future(self.main.call(self.main.layers)))
        if text != self._layers_text:
            self._layers_text = text
            for viewer in self.viewers.values():
                viewer.tell_latest("layers", text)
