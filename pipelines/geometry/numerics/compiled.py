"""Compilation of inner loops by numba, at their first call.

Loops are used where they stop early or avoid arrays of intermediate results. Each loop is compiled
once on a machine and cached next to this package, or in the user's cache folder. The cache notices
changes of the loop's own file only, so a compiled function calls no function and reads no constant
of another file. Each type of argument is compiled separately, so arrays come in C order. Sums are
taken in the written order: all machines give the same result. A loop assigns numbers, not arrays,
since numba compiles the text of an error with every array that it assigns, for a second each.
"""

import logging
from collections.abc import Callable
from functools import partial
from typing import TypeVar, cast

import numba
from numba.core import event

log = logging.getLogger(__name__)
COMPILING = "numba:compile"  # numba's event; loading from the cache does not raise it

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile `function` for the types of its arguments, when it is first called."""
    # An entry for C code would take a twentieth of the time to compile.
    njit = partial(numba.njit, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
    try:
        made = njit(cache=True)(function)
    except RuntimeError:  # no folder for the cache: each process compiles for itself
        made = njit()(function)
    return cast(Function, made)


class CompilationNotice(event.Listener):
    """Log the compilation of loops once per process, since compilation is slow and silent."""

    def on_start(self, started: event.Event) -> None:
        """Log the notice at the first loop of this package."""
        module = started.data["dispatcher"].py_func.__module__ or ""  # None without a file
        if module.startswith("pipelines."):
            event.unregister(COMPILING, self)  # type: ignore[no-untyped-call]
            log.warning(
                "inner loops are compiled at the first use of this command after an installation; "
                "that takes up to a minute"
            )

    def on_end(self, ended: event.Event) -> None:
        """Do nothing."""


event.register(COMPILING, CompilationNotice())  # type: ignore[no-untyped-call]
