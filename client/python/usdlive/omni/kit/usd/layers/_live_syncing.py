"""Kit's `LiveSyncing` and `LiveSession`.

A live project has no sessions to join and to merge: its layers are live. So every question here is answered with
"there is no session", and whatever would start one does nothing and returns None or False, with a warning. Scripts
that ask before they act then work as on a stage without a session.
"""

from __future__ import annotations

import logging
import typing

if typing.TYPE_CHECKING:
    from ._layers import Layers

_log = logging.getLogger(__name__)


class LiveSession:
    """A session, as annotations and `isinstance` need it. There is none."""

    def __init__(self) -> None:
        raise TypeError("a live project has no sessions; its layers are live when the stage is open")


class LiveSyncing:
    """The sessions of a stage. A layer of None is the root layer."""

    def __init__(self, layers: Layers):
        self._layers = layers

    @property
    def layers_instance(self) -> Layers:
        return self._layers

    @property
    def usd_context(self) -> typing.Any:
        return self._layers.usd_context

    # -- questions

    def get_all_live_sessions(self, layer_identifier: str | None = None) -> list[LiveSession]:
        return []

    def get_current_live_session(self, layer_identifier: str | None = None) -> LiveSession | None:
        return None

    def get_all_current_live_sessions(self, prim_path: typing.Any = None) -> list[LiveSession]:
        return []

    def get_live_session_for_live_layer(self, live_layer_identifier: str) -> LiveSession | None:
        return None

    def get_live_session_by_url(self, session_url: str) -> LiveSession | None:
        return None

    def find_live_session_by_name(self, layer_identifier: str, session_name: str) -> LiveSession | None:
        return None

    def is_stage_in_live_session(self) -> bool:
        return False

    def is_in_live_session(self) -> bool:
        return False

    def is_layer_in_live_session(self, layer_identifier: str | None = None, live_prim_only: bool = False) -> bool:
        return False

    def is_prim_in_live_session(self, prim_path: typing.Any, layer_identifier: str | None = None,
                                from_reference_or_payload_only: bool = False) -> bool:
        return False

    def is_live_session_layer(self, layer_identifier: str) -> bool:
        return False

    def is_live_session_merge_notice_muted(self, layer_identifier: str) -> bool:
        return False

    # -- actions

    def create_live_session(self, name: str, layer_identifier: str | None = None) -> LiveSession | None:
        return self._none("create_live_session")

    def join_live_session(self, live_session: LiveSession, prim_path: typing.Any = None) -> bool:
        return bool(self._none("join_live_session"))

    def join_live_session_by_url(self, layer_identifier: str, live_session_url: str,
                                 create_if_not_existed: bool = False) -> bool:
        return bool(self._none("join_live_session_by_url"))

    def try_cancelling_live_session_join(self, layer_identifier: str) -> LiveSession | None:
        return None

    def stop_live_session(self, layer_identifier: str | None = None, prim_path: typing.Any = None) -> None:
        """Does nothing."""

    def stop_all_live_sessions(self) -> None:
        """Does nothing."""

    def merge_live_session_changes(self, layer_identifier: str, stop_session: bool) -> bool:
        return bool(self._none("merge_live_session_changes"))

    def merge_live_session_changes_to_specific_layer(self, layer_identifier: str, target_layer_identifier: str,
                                                     stop_session: bool, clear_target_layer: bool) -> bool:
        return bool(self._none("merge_live_session_changes_to_specific_layer"))

    async def merge_and_stop_live_session_async(self, target_layer: str | None = None, comment: str = "",
                                                pre_merge: typing.Any = None, post_merge: typing.Any = None,
                                                layer_identifier: str | None = None) -> bool:
        return bool(self._none("merge_and_stop_live_session_async"))

    async def broadcast_merge_started_message_async(self, layer_identifier: str | None = None) -> None:
        """Does nothing."""

    async def broadcast_merge_done_message_async(self, destroy: bool = True,
                                                 layer_identifier: str | None = None) -> None:
        """Does nothing."""

    def mute_live_session_merge_notice(self, layer_identifier: str) -> None:
        """Does nothing."""

    def unmute_live_session_merge_notice(self, layer_identifier: str) -> None:
        """Does nothing."""

    async def open_stage_with_live_session_async(self, stage_url: str,
                                                 session_name: str | None = None) -> tuple[bool, str]:
        """Opens nothing. `UsdContext.open_stage_async("usdlive://HOST:PORT/LAYER")` opens a live stage."""
        return False, ("there are no live sessions: open usdlive://HOST:PORT/LAYER with open_stage_async(); its layers "
                       "are live")

    @staticmethod
    def _none(what: str) -> None:
        _log.warning("%s: there are no live sessions. The layers of a stage that was opened at usdlive://HOST:PORT/LAYER "
                     "are live at once", what)
