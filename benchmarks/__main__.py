"""Print all or the named speeds as one Markdown table: `python -m benchmarks [NAME ...]`."""

import argparse
import sys
from collections.abc import Sequence

from benchmarks import (
    bench_annotate,
    bench_api,
    bench_dataset,
    bench_evaluate,
    bench_infer,
    bench_labels,
    bench_machine,
    bench_many_frames,
    bench_metrics,
    bench_network,
    bench_serve,
)
from benchmarks.timing import markdown
from pipelines.errors import errors_as_sentences

BENCHES = {
    "machine": bench_machine,
    "infer": bench_infer,
    "api": bench_api,
    "serve": bench_serve,
    "many-frames": bench_many_frames,
    "network": bench_network,
    "annotate": bench_annotate,
    "dataset": bench_dataset,
    "labels": bench_labels,
    "metrics": bench_metrics,
    "evaluate": bench_evaluate,
}


@errors_as_sentences()
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the named benches, or all, then print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Print all or the named speeds as one Markdown table.",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(BENCHES)}")
    names = parser.parse_args(arguments).names
    if unknown := [name for name in names if name not in BENCHES]:
        parser.error(f"no bench is called {unknown[0]}; there are {', '.join(BENCHES)}")
    chosen = [bench for name, bench in BENCHES.items() if name in names or not names]
    sys.stdout.write(markdown([m for bench in chosen for m in bench.measure()]))


if __name__ == "__main__":
    main()
