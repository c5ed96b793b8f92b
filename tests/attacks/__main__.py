"""Run many attacks: `python -m tests.attacks COUNT FOLDER [SEED [COMMAND]]`, a JSON line each.

The lines are in FOLDER/log.jsonl. `links` as COUNT: pipes, devices, folders and links in the place
of every input of every command; `unharmed`: each command once, with its right inputs.
"""

import json
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from tests.attacks.campaign import attacked, made_world, swept_by_links, unharmed

LAST = 3000  # characters that are kept of what a command printed


def main() -> None:
    """Write all outcomes to FOLDER/log.jsonl, and print how often each fault occurred."""
    count, folder, first, named = (*sys.argv[1:], *("0", "")[len(sys.argv) - 3 :])
    folder = Path(folder)
    made = made_world(folder)
    sweeps = {"links": swept_by_links, "unharmed": unharmed}
    outcomes = (
        sweeps[count](made, folder)
        if count in sweeps
        else attacked(made, folder, int(count), int(first), named=named)
    )
    tally = Counter[str]()
    for outcome in outcomes:
        tally[outcome.fault or "well"] += 1
        content = asdict(outcome)
        content["ended"]["output"] = content["ended"]["output"][-LAST:]
        with (folder / "log.jsonl").open("a") as stream:
            stream.write(json.dumps(content) + "\n")
    sys.stdout.write(f"{dict(tally)}\n")


if __name__ == "__main__":
    main()
