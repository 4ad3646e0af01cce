"""Stages in a process that `fork()` made."""

import os
import typing
import weakref

from . import _session

_stages: "list[weakref.ref[typing.Any]]" = []


def keep_if_forked(stage: typing.Any) -> None:
    """Keeps the stage for ever in each process that `fork()` makes from now on. Python destroys it there when the process
    ends, and OpenUSD may then wait for ever, for a lock that another thread held during `fork()`."""
    _stages[:] = [one for one in _stages if one() is not None] + [weakref.ref(stage)]


def _keep_all() -> None:
    for one in _stages:
        if (stage := one()) is not None:
            _session.keep_for_ever(stage)


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_keep_all)
