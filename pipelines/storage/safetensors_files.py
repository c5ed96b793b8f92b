"""Safetensors files, opened; one sentence where that fails."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipelines.errors import FormatError
from pipelines.storage.files import existing


@contextmanager
def open_safetensors(path: Path, framework: str = "np") -> Iterator[Any]:
    """Yield the file, its tensors those of `framework` (`np` needs no torch, `pt` is torch).

    Raises:
        FormatError: it is truncated, or not safetensors.
    """
    from safetensors import SafetensorError, safe_open  # noqa: PLC0415 - few commands need it

    try:
        with safe_open(str(existing(path)), framework=framework) as file:
            yield file
    except (SafetensorError, TypeError, ValueError) as error:
        raise FormatError(
            path, f"this is not a whole safetensors file ({error})", "give weights or train again"
        ) from error
