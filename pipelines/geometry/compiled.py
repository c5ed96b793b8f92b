"""Loops over points that are compiled when first called (numba): what arrays cannot say cheaply.

A loop leaves off as soon as it knows, and keeps nothing in between. It is compiled once a machine
and kept beside this package, or where the user's caches lie; what is kept knows of changes in its
own file alone, so compiled functions call none of another file and read no constant of one. It is
compiled for each kind of argument it meets: arrays come in C order. Sums are taken in the order
that is written, so all machines find the same.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return `function` compiled for the types that it is called with."""
    try:
        made = numba.njit(function, cache=True, nogil=True, error_model="numpy")
    except RuntimeError:  # nowhere to keep it: each process compiles for itself
        made = numba.njit(function, nogil=True, error_model="numpy")
    return cast(Function, made)
