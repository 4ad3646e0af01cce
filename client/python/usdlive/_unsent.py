"""Work of an earlier connection that was not sent."""

from __future__ import annotations

import typing

from pxr import Sdf

from . import events


class Sent(typing.NamedTuple):
    """The result of sending unsent work, in transactions: committed now, committed before (only the
    acknowledgement was lost), and pieces of work that were refused or dropped."""

    committed: int
    before: int
    lost: int


class UnsentWork:
    """Work of an earlier connection that was not sent. `str()` returns a sentence for its user."""

    def __init__(self, client: typing.Any, about: events.Unsent, as_layer: typing.Callable[[str, str], Sdf.Layer]):
        self._client, self._as_layer = client, as_layer
        self.about = about

    def __str__(self) -> str:
        return str(self.about)

    def send(self, timeout: float = 60.0) -> Sent:
        """Commits the work at the present paths of its specs. Each edit is committed once, also if only its
        acknowledgement was lost and if this is called again after an Error. The work is kept until all of it is
        committed, or lost for a reason that does not pass. The next tick reports refused or dropped work as
        `events.Lost`."""
        return Sent(*self._client.send_unsent(self.about.id, timeout * 1000.0))

    def as_layer(self, layer: str) -> Sdf.Layer:
        """Returns the work's changes of `layer` as an anonymous layer. The work is kept."""
        return self._as_layer(self.about.id, layer)

    def discard(self) -> None:
        """Deletes the work for good."""
        self._client.discard_unsent(self.about.id)
