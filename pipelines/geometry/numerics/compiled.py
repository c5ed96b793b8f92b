"""Loops over points that are compiled when first called (numba): what arrays cannot say cheaply.

A loop leaves off as soon as it knows, and keeps nothing in between. It is compiled once a machine
and kept beside this package, or where the user's caches lie; what is kept knows of changes in its
own file alone, so compiled functions call none of another file and read no constant of one. It is
compiled for each kind of argument it meets: arrays come in C order. Sums are taken in the order
that is written, so all machines find the same.
"""

import logging
from collections.abc import Callable
from typing import TypeVar, cast

import numba
from numba.core import event

log = logging.getLogger(__name__)
COMPILING = "numba:compile"  # what numba calls it; what is kept is loaded without

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return `function` compiled for the types that it is called with."""
    try:
        made = numba.njit(function, cache=True, nogil=True, error_model="numpy")
    except RuntimeError:  # nowhere to keep it: each process compiles for itself
        made = numba.njit(function, nogil=True, error_model="numpy")
    return cast(Function, made)


class SayOnce(event.Listener):
    """Says once a process that loops are being compiled: nothing else is heard of it for long."""

    def on_start(self, started: event.Event) -> None:
        """Say it of the first loop of this package."""
        module = started.data["dispatcher"].py_func.__module__ or ""  # none of what has no file
        if module.startswith("pipelines."):
            event.unregister(COMPILING, self)  # type: ignore[no-untyped-call]
            log.warning(
                "inner loops are compiled first; that takes up to a minute, once an installation"
            )

    def on_end(self, ended: event.Event) -> None:
        """Say no more."""


event.register(COMPILING, SayOnce())  # type: ignore[no-untyped-call]
