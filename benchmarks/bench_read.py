"""Reading ILC20 walks against `pandas.read_csv` of the same file, side by side in one run.

Run: `PDRBENCH_DATA=... python benchmarks/bench_read.py [--set ilc20_full] [--walks N] [--repeats N]`. The reader
returns checked, sorted streams in SI units; pandas returns the cells. Either reads the walk as it was published, packed
(`.gz` in `ilc20`, `.xz` in `ilc20_full`) and unpacked, and once more with nothing in it but the rows that the reader
keeps, so that skipping the others cannot be what makes it fast. Unpacking alone, by the standard library, is what no
reader can avoid. Each time is processor time, the best of the repeats, all methods in turn on every walk; medians are
over walks.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import lzma
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from pdrbench.bench import Timing
from pdrbench.datasets import find
from pdrbench_lab.cli.bench import print_timings
from pdrbench_sim.readers import ilc20

UNPACK: dict[str, Callable[[bytes], bytes]] = {".gz": gzip.decompress, ".xz": lzma.decompress}
COLUMNS = 10  # fields of the longest record
KEPT = ("ACCELEROMETER", "GYROSCOPE", "MAGNETIC_FIELD", "ROTATION_VECTOR", "WIFI", "BEACON", "WAYPOINT")
KEPT_LINE = re.compile(rf"^(#|\d{{13}}\tTYPE_({'|'.join(KEPT)})\t).*\n".encode(), re.MULTILINE)


def read_with_pandas(path: Path) -> pd.DataFrame:
    """Every row of a walk, cells as pandas guesses them."""
    return pd.read_csv(path, sep="\t", header=None, names=range(COLUMNS), comment="#", quoting=csv.QUOTE_NONE)


def unpack(path: Path) -> bytes:
    """The text of a walk; of an unpacked one its bytes."""
    return UNPACK.get(path.suffix, bytes)(path.read_bytes())


def seconds(call: Callable[[Path], object], path: Path) -> float:
    """Processor time of one call; both methods keep to one thread, and neighbours on a shared machine do not count."""
    start_s = time.process_time()
    call(path)
    return time.process_time() - start_s


def compare(paths: list[Path], repeats: int) -> np.ndarray:
    """(3, W) best time of our reader, of pandas and of unpacking alone for each walk."""
    best = np.full((3, len(paths)), np.inf)
    for _ in range(repeats):
        for k, path in enumerate(paths):
            for method, call in enumerate((ilc20.read, read_with_pandas, unpack)):
                best[method, k] = min(best[method, k], seconds(call, path))
    return best


def result(name: str, best_s: np.ndarray) -> Timing:
    """One line of the table: medians over walks, how often we are faster, and what unpacking alone takes."""
    ours_s, pandas_s, unpacking_s = best_s
    against = (
        f"pandas.read_csv {np.median(pandas_s) * 1e3:.2f} ms; faster on {(ours_s < pandas_s).mean():.0%} of walks; "
        f"unpacking alone {np.median(unpacking_s) * 1e3:.2f} ms"
    )
    return Timing(name, float(np.median(ours_s) * 1e3), "ms", against, float(np.median(pandas_s / ours_s)))


def main() -> None:
    """Prints both, as text or as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=("ilc20", "ilc20_full"), default="ilc20")
    parser.add_argument("--walks", type=int, default=62)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    packed = sorted(find(arguments.set).glob("*/*/path_data_files/*.txt.?z"))[: arguments.walks]
    suffix = packed[0].suffix
    with tempfile.TemporaryDirectory() as scratch:
        plain = [Path(scratch) / path.name.removesuffix(suffix) for path in packed]
        kept = [path.with_suffix(".kept.txt") for path in plain]
        for source, whole, part in zip(packed, plain, kept, strict=True):
            content = unpack(source)
            whole.write_bytes(content)
            part.write_bytes(b"".join(match[0] for match in KEPT_LINE.finditer(content)))
        results = [
            result(f"read {arguments.set} .txt", compare(plain, arguments.repeats)),
            result(f"read {arguments.set} .txt{suffix}", compare(packed, arguments.repeats)),
            result(f"read {arguments.set} .txt, kept rows only", compare(kept, arguments.repeats)),
        ]
    print_timings(results, arguments.json)


if __name__ == "__main__":
    main()
