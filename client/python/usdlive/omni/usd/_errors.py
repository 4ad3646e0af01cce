"""Converts errors to one sentence for the result tuples of UsdContext."""

from __future__ import annotations

import re

from pxr import Tf

import usdlive

_TF_PREFIX = re.compile(r"\s*Error in '[^\n]*?' at line \d+ in file \S+ : ")


class Failure(Exception):
    """The reason why an operation failed."""


# Exceptions of a library or the system with a cause outside of this program.
OUTSIDE = (Failure, Tf.ErrorException, usdlive.Error, OSError)


def reason(error: BaseException) -> str:
    """Returns the sentence for the user."""
    if isinstance(error, Tf.ErrorException):
        parts = [part.strip().removeprefix("'").removesuffix("'") for part in _TF_PREFIX.split(str(error))]
        return "; ".join(dict.fromkeys(part for part in parts if part))
    if isinstance(error, usdlive.Error):
        return error.message
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)
