"""A stand-in for a full disk: files cannot grow beyond a limit."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def little_space(most: int) -> Iterator[None]:
    """Let this process write files of at most `most` bytes."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
