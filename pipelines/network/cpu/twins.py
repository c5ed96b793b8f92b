"""Pairs of functions that do the same: a plain one in torch, and a fast one where that works."""

import functools
import logging
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar, cast

from pipelines.network import devices

log = logging.getLogger(__name__)

Given = ParamSpec("Given")
Returned = TypeVar("Returned")
# What a release of torch raises that took a private function away, or changed what it takes.
GONE = (AttributeError, ImportError, NotImplementedError, RuntimeError, TypeError)


class Twins(Generic[Given, Returned]):
    """A function with a plain and a fast form.

    Attributes:
        plain: in simple torch, on any device, with gradients.
        fast: the same with less work.
        applies: whether the fast form may be used for these arguments.
    """

    def __init__(
        self,
        plain: Callable[Given, Returned],
        fast: Callable[Given, Returned],
        applies: Callable[Given, bool],
    ) -> None:
        self.plain, self.fast, self.applies = plain, fast, applies
        functools.update_wrapper(self, plain)

    def __call__(self, *args: Given.args, **kwargs: Given.kwargs) -> Returned:
        """Return what either form does."""
        chosen = self.fast if self.applies(*args, **kwargs) else self.plain
        return chosen(*args, **kwargs)


def first_on_cpu(*args: Any, **kwargs: Any) -> bool:  # noqa: ANN401 - of any function
    """Return whether the first argument, a tensor, lies on the CPU."""
    del kwargs
    return devices.on_cpu(args[0])


def faster_by(
    fast: Callable[Given, Returned], applies: Callable[Given, bool] = first_on_cpu
) -> Callable[[Callable[Given, Returned]], Twins[Given, Returned]]:
    """Let `fast` stand in for the decorated function where it `applies`."""

    def pair(plain: Callable[Given, Returned]) -> Twins[Given, Returned]:
        return Twins(plain, fast, applies)

    return pair


@functools.lru_cache
def works(probe: Callable[[], object]) -> bool:
    """Return whether `probe` runs, which tries a private function of torch; once a process.

    Where it does not, the log says so: the plain form takes the fast one's place.
    """
    try:
        probe()
    except GONE as error:
        name = cast(Any, probe).__doc__.partition("\n")[0].rstrip(".")
        log.warning("%s: not with this torch (%s); slower operations take its place", name, error)
        return False
    return True
