"""A stage that moves through the history of a project."""

from __future__ import annotations

import typing

from pxr import Sdf, Usd

from . import _usdlive

if typing.TYPE_CHECKING:
    from ._live import Live


class Player:
    """A stage of a project that can be moved through the history (`Live.player()`).

        with live.player("shot.usda") as player:
            player.seek(player.first)
            player.play(speed=60)           # a minute of work in a second
            while player.playing:
                live.tick()
                player.tick()
                draw(player.stage)

    Its layers are not those of now: they refuse edits, and the live ones are not touched. Moving writes only what differs.
    Use it on the thread of its connection. When the connection is closed, the player is, too."""

    def __init__(self, live: "Live", layer: str, revision: int, load: "Usd.Stage.InitialLoadSet"):
        self._live = live
        self._player = _usdlive.Player(live._client, layer, revision)
        self._stage = Usd.Stage.Open(Sdf.Layer.FindOrOpen(self._player.layer), load)

    @property
    def stage(self) -> Usd.Stage:
        """The stage. After `close()` it stays as it is."""
        return self._stage

    def seek(self, revision: int | str) -> None:
        """Moves to a revision, or to the checkpoint of this name, and waits for what is not here. Playing goes on from there.
        Raises an Error: `invalidArgument` (no such checkpoint; a notice handler while layers change), `futureRevision`,
        `historyReplaced`, `notConnected` (also after `close()`). The stage then stays where it was."""
        self._live._notify(self._player.seek(self._live._revision_at(revision)))

    def play(self, speed: float = 1.0) -> None:
        """Lets `tick()` move the stage, `speed` times as fast as the commits were made; a negative speed moves it back, and 0
        stops. A pause between two commits that would last longer than a second lasts one second. A tick passes 128
        commits at most, however high the speed is. It stops at both ends of the history."""
        self._player.play(speed)

    def tick(self) -> bool:
        """Moves the stage on if it is playing. Call it once per frame, beside `Live.tick()`, which receives the commits. Never
        waits for them: the stage stays where it is until they are here. Returns True if it has moved. Raises an Error, and
        stops, if something cannot be read."""
        return self._player.tick()

    @property
    def playing(self) -> bool:
        return self._player.playing

    @property
    def revision(self) -> int:
        """The revision that the stage shows; 0 after `close()`."""
        return self._player.revision

    @property
    def first(self) -> int:
        """The oldest revision that can be read; 0 after `close()`."""
        return self._player.first

    @property
    def last(self) -> int:
        """The newest revision of the project, which grows while others work; 0 after `close()`."""
        return self._player.last

    @property
    def closed(self) -> bool:
        return self._player.closed

    def close(self) -> None:
        """Ends it; the stage stays as it is. Does nothing if it is closed."""
        self._player.close()

    def __enter__(self) -> "Player":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
