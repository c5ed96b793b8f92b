"""Refusal of labels that were made of another file than the file that exists now."""

from pathlib import Path

from pipelines.errors import FormatError
from pipelines.storage.provenance import digest_if_there, read_stamp


def refuse_labels_of_another(name: str, source: Path, labels: Path, cure: str) -> None:
    """Refuse `labels` whose stamp names another version of the file `source`.

    Labels written by hand, or by other programs, need not have a stamp. `name`: of the input, in
    the stamp. `cure`: advice in the message.

    Raises:
        FormatError: the labels were made of another file.
    """
    inputs = (read_stamp(labels) or {}).get("inputs")
    made_of = inputs.get(name) if isinstance(inputs, dict) else None
    if made_of is not None and made_of != digest_if_there(source):
        raise FormatError(labels, f"it was made with another file than the present {source}", cure)
