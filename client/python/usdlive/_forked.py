"""Stages in a process that `fork()` made."""

import ctypes
import os
import typing
import weakref

_stages: "list[weakref.ref[typing.Any]]" = []


def keep_if_forked(stage: typing.Any) -> None:
    """Keeps the stage for ever in each process that `fork()` makes from now on. Python destroys it there when the process
    ends, and OpenUSD may then wait for ever, for a lock that another thread held during `fork()`."""
    _stages[:] = [one for one in _stages if one() is not None] + [weakref.ref(stage)]


def _keep_all() -> None:
    for one in _stages:
        if (stage := one()) is not None:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(stage))


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_keep_all)
