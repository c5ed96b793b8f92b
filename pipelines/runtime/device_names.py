"""Names of devices, which are checked without loading torch."""

import re

from pipelines.errors import UnknownNameError

NAME = re.compile("auto|cpu|cuda(:(0|[1-9][0-9]*))?")  # torch also takes cpu:1, and fails later


def check_device_name(name: str, argument: str) -> None:
    """Check that `name`, given as `argument`, may be a device; its GPU need not be there.

    Raises:
        UnknownNameError: `name` is unknown.
    """
    if not NAME.fullmatch(name):
        raise UnknownNameError(argument, name, ["auto", "cpu", "cuda", "cuda:N"])
