"""Print all speeds as one Markdown table: `python -m benchmarks`."""

import sys

from benchmarks import (
    bench_annotate,
    bench_dataset,
    bench_evaluate,
    bench_infer,
    bench_labels,
    bench_machine,
    bench_many_frames,
    bench_metrics,
    bench_network,
)
from benchmarks.timing import markdown

BENCHES = (
    bench_machine,
    bench_infer,
    bench_many_frames,
    bench_network,
    bench_annotate,
    bench_dataset,
    bench_labels,
    bench_metrics,
    bench_evaluate,
)


def main() -> None:
    """Run every bench, then print."""
    sys.stdout.write(markdown([m for bench in BENCHES for m in bench.measure()]))


if __name__ == "__main__":
    main()
