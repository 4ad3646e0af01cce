"""A stage's connection to its project."""

from __future__ import annotations

import logging
import typing

from pxr import Sdf, Usd

import usdlive
from usdlive import events

from ._errors import Failure
from ._projects import LiveAddress
from ._steps import Steps, Until

_log = logging.getLogger("usdlive.omni.usd")

_SAVE_SECONDS = 60.0  # a server that has not answered by then is not waited for
_LEAVE_SECONDS = 5.0  # so long are edits of one's own waited for that are not confirmed


class LiveStage:
    """Ticks a `usdlive.Live`, and asks and waits in the way of _steps."""

    def __init__(self, live: usdlive.Live, owned: bool):
        self.live = live
        self._owned = owned  # closed with the stage

    def tick(self) -> None:
        try:
            self.live.tick()
        except usdlive.Error as error:
            if error.code != "notConnected":
                raise
            _log.error("%s", error.message)

    def name_of(self, layer: Sdf.Layer) -> str | None:
        """The layer's name in the project, if it is live."""
        return self.live.layer_name(layer)

    def is_dirty(self, layers: typing.Iterable[Sdf.Layer]) -> bool:
        """Does the server have, or will it get, what is not in the layers' files?"""
        names = {name for layer in layers if (name := self.name_of(layer))}
        if names and self.live.pending:
            return True
        states = self.live.layer_states()
        return any(states[name].dirty for name in names if name in states)

    def save(self, layers: list[Sdf.Layer], unsaved_only: bool) -> Steps[tuple[list[Sdf.Layer], list[str]]]:
        """Those that the server has written, and reasons for those it has not."""
        named = {name: layer for layer in layers if (name := self.name_of(layer))}
        if not named:
            return [], []
        answers: list[events.Saved | events.ServerError] = []
        committed: set[str] = set()  # their layers' states may come a little later

        def hear(event: events.Event) -> None:
            if isinstance(event, (events.Saved, events.ServerError)):
                answers.append(event)
            elif isinstance(event, events.Committed):
                committed.update(edit.layer for edit in event.edits)

        self.live.add_handler(hear)
        try:
            self.tick()  # what was authored since the last frame is to be saved, too
            yield Until(lambda: not self.live.pending or not self.live.connected, self.tick, _SAVE_SECONDS)
            states = self.live.layer_states()
            if unsaved_only and self.live.connected:
                named = {name: layer for name, layer in named.items()
                         if name in committed or name in states and states[name].dirty}
                if not named:
                    return [], []
            answers.clear()
            self.live.request_save(*named)
            answered = yield Until(lambda: bool(answers), self.tick, _SAVE_SECONDS)
        finally:
            self.live.remove_handler(hear)
        if not answered:
            return [], [f"the server did not say within {_SAVE_SECONDS:.0f} s that it has saved"]
        if isinstance(answers[0], events.ServerError):
            return [], [answers[0].message]
        failed = [f"{layer}: {message}" for layer, _, message in answers[0].failed]
        return [named[name] for name in answers[0].saved if name in named], failed

    def checkpoint(self, comment: str, force: bool) -> Steps[str]:
        """Names what the project is now: by the comment, with a number where that is taken. Unless `force`,
        a revision that has a name gets no other. Returns why it could not be done, or ""."""
        self.tick()
        yield Until(lambda: not self.live.pending or not self.live.connected, self.tick, _SAVE_SECONDS)
        listed = yield from self._ask(self.live.request_checkpoints)
        if not isinstance(listed, events.CheckpointsListed):
            return listed.message
        if not force and any(one.revision == self.live.revision for one in listed.checkpoints):
            return ""
        taken = {one.name for one in listed.checkpoints}
        name = wanted = _checkpoint_name(comment)
        number = 1
        while True:
            while name in taken:
                number += 1
                name = f"{wanted} ({number})"
            made = yield from self._ask(lambda: self.live.request_checkpoint(name))
            if isinstance(made, events.CheckpointMade):
                return ""
            if made.code != "checkpointExists":
                return made.message
            taken.add(name)  # by somebody else, just now

    def _ask(self, request: typing.Callable[[], int]) -> Steps[events.Event]:
        """The event that answers it."""
        heard: list[events.Event] = []
        self.live.add_handler(heard.append)
        try:
            number = request()

            def answers() -> list[events.Event]:
                return [event for event in heard if getattr(event, "request", None) == number]

            yield Until(lambda: bool(answers()), self.tick, _SAVE_SECONDS)
            told = answers()
        finally:
            self.live.remove_handler(heard.append)
        return told[0] if told else events.ServerError(
            "notConnected", f"the server did not answer within {_SAVE_SECONDS:.0f} s", number)

    def leave(self, discard: bool) -> Steps[str]:
        """Leaves the project when what was authored is confirmed. A Failure when it is not after a while,
        unless it may be discarded: then the text says so."""
        if not self._owned:
            return ""
        self.tick()
        if self.live.connected:
            yield Until(lambda: not self.live.pending or not self.live.connected, self.tick, _LEAVE_SECONDS)
        pending = self.live.pending
        if pending and not discard:
            raise Failure(f"{pending} transactions of yours were not confirmed by the server. The stage stays "
                          "open: wait for the server, write a copy with export_as_stage(), or call "
                          "set_pending_edit(False) and close again: they are then kept as unsent work")
        self.live.close(timeout=0)
        if not pending:
            return ""
        text = f"{pending} transactions were not confirmed by the server; they are kept as unsent work"
        _log.warning("%s", text)
        return text


def _checkpoint_name(comment: str) -> str:
    """One that the server takes, with room for a number."""
    printable = " ".join("".join(c if c.isprintable() else " " for c in comment).split())
    return printable.encode()[:180].decode(errors="ignore") or "checkpoint"


def join(address: LiveAddress, user: str, timeout: float) -> Steps[LiveStage]:
    """Connects; waiting for an answer needs no stage."""
    server = address.server.replace("usdlive://", "ws://", 1)
    live = yield lambda: usdlive.connect(server, user=user, application="usdlive.omni", timeout=timeout)
    return LiveStage(live, owned=True)


def make_live(connection: LiveStage, address: LiveAddress, stage: Usd.Stage) -> None:
    """A stage that was read from an attached folder becomes live. What is muted for everybody is the affair
    of the context's layers (`set_muteness_scope`)."""
    live = connection.live
    if address.folder and address.layer not in live.attach(stage, address.folder, follow_muteness=False):
        raise Failure(f"{address.layer} is no layer of the project at {address.server}")
