"""Run many attacks: `python -m tests.attacks COUNT FOLDER [SEED]`; a JSON line each in FOLDER.

`links` as COUNT: pipes, devices, folders and links in the place of every input of every command.
"""

import json
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from tests.attacks.campaign import attacked, made_world, swept_by_links

LAST = 3000  # characters that are kept of what a command printed


def main() -> None:
    """Write all outcomes to FOLDER/log.jsonl, and print how often each fault occurred."""
    count, folder, first = sys.argv[1], Path(sys.argv[2]), int((sys.argv[3:] or ["0"])[0])
    made = made_world(folder)
    is_sweep = count == "links"
    outcomes = (
        swept_by_links(made, folder) if is_sweep else attacked(made, folder, int(count), first)
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
