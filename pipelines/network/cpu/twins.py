"""Pairs of equivalent functions: a plain form in torch, and a fast form where it works."""

import functools
import logging
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar, cast

from pipelines.network import devices

log = logging.getLogger(__name__)

Given = ParamSpec("Given")
Returned = TypeVar("Returned")
# Errors of a release of torch that removed a private function, or changed its arguments.
GONE = (AttributeError, ImportError, NotImplementedError, RuntimeError, TypeError)


class Twins(Generic[Given, Returned]):
    """A function with a plain and a fast form.

    Attributes:
        plain: the form in simple torch, on any device, with gradients.
        fast: the equivalent form with less work.
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
        """Return the result of the form that applies."""
        chosen = self.fast if self.applies(*args, **kwargs) else self.plain
        return chosen(*args, **kwargs)


def first_on_cpu(*args: Any, **kwargs: Any) -> bool:  # noqa: ANN401 - of any function
    """Return whether the first argument, a tensor, is on the CPU."""
    del kwargs
    return devices.on_cpu(args[0])


def faster_by(
    fast: Callable[Given, Returned], applies: Callable[Given, bool] = first_on_cpu
) -> Callable[[Callable[Given, Returned]], Twins[Given, Returned]]:
    """Let `fast` replace the decorated function where it `applies`."""

    def pair(plain: Callable[Given, Returned]) -> Twins[Given, Returned]:
        return Twins(plain, fast, applies)

    return pair


@functools.lru_cache
def works(probe: Callable[[], object]) -> bool:
    """Return whether `probe`, which tries a private function of torch, runs; once per process.

    If it fails, the log has a warning, and the plain form replaces the fast form.
    """
    try:
        probe()
    except GONE as error:
        name = cast(Any, probe).__doc__.partition("\n")[0].rstrip(".")
        log.warning(
            "%s do not work with this torch (%s); slower operations replace them", name, error
        )
        return False
    return True
