"""A stage's connection to its project."""

from __future__ import annotations

import logging
import math
import time
import typing

from pxr import Sdf, Usd

import usdlive
from usdlive import events

from ._errors import Failure
from ._projects import LiveAddress
from ._steps import Steps, Until

_log = logging.getLogger("usdlive.omni.usd")

_SAVE_SECONDS = 60.0  # the longest wait for the server's answer
_LEAVE_SECONDS = 5.0  # the longest wait for the confirmation of own edits


class LiveStage:
    """Ticks a `usdlive.Live`. Sends requests and waits for answers with the steps of _steps."""

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

    def open_layer(self, layer: str, payloads: bool, timeout: float) -> Steps[Sdf.Layer]:
        """Opens a layer of the project while frames go on. Raises an error if the server refuses it, and a Failure
        after `timeout` seconds without a connection."""
        ends: list[events.LayerOpened | events.LayerOpenFailed] = []
        connected = time.monotonic()

        def receive(event: events.Event) -> None:
            if isinstance(event, (events.LayerOpened, events.LayerOpenFailed)) and event.request == request:
                ends.append(event)

        def ended() -> bool:
            nonlocal connected
            self.tick()
            if self.live.connected:
                connected = time.monotonic()
            return bool(ends) or time.monotonic() - connected > timeout

        request = self.live.request_open_layer(layer, payloads)
        self.live.add_handler(receive)
        try:
            yield Until(ended, lambda: None, math.inf)
        finally:
            self.live.remove_handler(receive)
        if not ends:
            raise Failure(f"cannot open {layer}: no connection to its server for {timeout:.0f} s")
        if isinstance(ends[0], events.LayerOpenFailed):
            raise usdlive.Error(ends[0].code, ends[0].message)
        return self.live.opened_layer(layer)

    def name_of(self, layer: Sdf.Layer) -> str | None:
        """Returns the layer's name in the project, if it is live."""
        return self.live.layer_name(layer)

    def is_dirty(self, layers: typing.Iterable[Sdf.Layer]) -> bool:
        """Returns True if the server has, or will get, edits that are not in the layers' files."""
        names = {name for layer in layers if (name := self.name_of(layer))}
        if names and self.live.pending:
            return True
        states = self.live.layer_states()
        return any(states[name].dirty for name in names if name in states)

    def save(self, layers: list[Sdf.Layer],
             unsaved_only: bool) -> Steps[tuple[list[Sdf.Layer], list[str], list[str]]]:
        """Returns the layers that the server has saved, the reasons for the others, and sentences about those that it has
        skipped: with `unsaved_only`, the layers that somebody else has locked."""
        named = {name: layer for layer in layers if (name := self.name_of(layer))}
        if not named:
            return [], [], []
        answers: list[events.Saved | events.ServerError] = []
        committed: set[str] = set()  # their states may arrive a little later

        def receive(event: events.Event) -> None:
            if isinstance(event, (events.Saved, events.ServerError)):
                answers.append(event)
            elif isinstance(event, events.Committed):
                committed.update(edit.layer for edit in event.edits)

        self.live.add_handler(receive)
        try:
            self.tick()  # includes the edits since the last frame
            yield Until(lambda: not self.live.pending or not self.live.connected, self.tick, _SAVE_SECONDS)
            states = self.live.layer_states()
            if unsaved_only and self.live.connected:
                named = {name: layer for name, layer in named.items()
                         if name in committed or name in states and states[name].dirty}
                if not named:
                    return [], [], []
            answers.clear()
            self.live.request_save(*named)
            answered = yield Until(lambda: bool(answers), self.tick, _SAVE_SECONDS)
        finally:
            self.live.remove_handler(receive)
        if not answered:
            return [], [f"the server did not confirm the save within {_SAVE_SECONDS:.0f} s"], []
        if isinstance(answers[0], events.ServerError):
            return [], [answers[0].message], []
        failed, skipped = [], []
        for layer, code, message in answers[0].failed:
            if unsaved_only and code == "locked":
                skipped.append(f"{layer} was skipped: {message}")
            else:
                failed.append(f"{layer}: {message}")
        return [named[name] for name in answers[0].saved if name in named], failed, skipped

    def checkpoint(self, comment: str, force: bool) -> Steps[str]:
        """Creates a checkpoint named after the comment, with a number if that name is used. A revision that has
        a name gets a second one only with `force`. Returns the reason for a failure, or ""."""
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
            taken.add(name)  # somebody else has just used it

    def _ask(self, request: typing.Callable[[], int]) -> Steps[events.Event]:
        """Sends a request and returns the event that answers it."""
        received: list[events.Event] = []
        self.live.add_handler(received.append)
        try:
            number = request()

            def answers() -> list[events.Event]:
                return [event for event in received if getattr(event, "request", None) == number]

            yield Until(lambda: bool(answers()), self.tick, _SAVE_SECONDS)
            answer = answers()
        finally:
            self.live.remove_handler(received.append)
        return answer[0] if answer else events.ServerError(
            "notConnected", f"the server did not answer within {_SAVE_SECONDS:.0f} s", number)

    def leave(self, discard: bool) -> Steps[str]:
        """Leaves the project when all own edits are confirmed. Raises a Failure if that takes too long. If they
        may be discarded, returns a text about them instead."""
        if not self._owned:
            return ""
        self.tick()
        if self.live.connected:
            yield Until(lambda: not self.live.pending or not self.live.connected, self.tick, _LEAVE_SECONDS)
        pending = self.live.pending
        if pending and not discard:
            raise Failure(f"{pending} of your transactions were not confirmed by the server. The stage stays "
                          "open: wait for the server, write a copy with export_as_stage(), or call "
                          "set_pending_edit(False) and close again: they are then kept as unsent work")
        self.live.close(timeout=0)
        if not pending:
            return ""
        text = f"{pending} transactions were not confirmed by the server; they are kept as unsent work"
        _log.warning("%s", text)
        return text


def _checkpoint_name(comment: str) -> str:
    """Returns a name that the server accepts, with space for a number."""
    printable = " ".join("".join(c if c.isprintable() else " " for c in comment).split())
    return printable.encode()[:180].decode(errors="ignore") or "checkpoint"


def join(address: LiveAddress, user: str, timeout: float) -> Steps[LiveStage]:
    """Connects to the project. Waiting for the answer needs no stage."""
    live = yield lambda: usdlive.connect(address.server, user=user, application="usdlive.omni", timeout=timeout)
    return LiveStage(live, owned=True)


def make_live(connection: LiveStage, address: LiveAddress, stage: Usd.Stage) -> None:
    """Makes a stage live that was read from an attached folder. The context's layers handle muteness
    (`set_muteness_scope`)."""
    live = connection.live
    if address.folder and address.layer not in live.attach(stage, address.folder, follow_muteness=False):
        raise Failure(f"{address.layer} is not a layer of the project at {address.server}, or its server cannot read it now")
