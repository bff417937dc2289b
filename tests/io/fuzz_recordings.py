"""Coverage-guided fuzzing of the readers of recordings: only `RecordingError` may come out.

    python tests/io/fuzz_recordings.py NAME [--seconds N] [--corpus FOLDER]

NAME is a key of `WRITERS` in `test_recordings.py`, whose file is the first input. Needs atheris.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
import warnings
from pathlib import Path
from types import ModuleType

import atheris
import pandas  # noqa: F401  # loads for longer than an input may take

with atheris.instrument_imports(include=["pdrbench.io", "pdrbench_formats", "zipfile", "msgspec"]):
    from pdrbench.errors import RecordingError
    from pdrbench.io import READERS
    from pdrbench.io.reader import head_of

MAX_BYTES = 1 << 15
MEMORY_MB = 3_000
SECONDS_FOR_ONE = 10
NUM_ROWS = 40


def load(name: str) -> ModuleType:
    """A module beside this script."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> None:
    """Fuzzes one format."""
    parser = argparse.ArgumentParser()
    parser.add_argument("name")
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--corpus", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of numbers that overflow
    walk = {sensor: rows[:NUM_ROWS] for sensor, rows in load("conftest").make_walk().items()}
    kind, write, _ = load("test_recordings").WRITERS[options.name]
    folder = Path(tempfile.mkdtemp())
    sound = write(folder, walk)
    changed = sound if sound.is_file() else max(sound.rglob("*.*"), key=lambda path: path.stat().st_size)
    corpus = options.corpus or Path(tempfile.mkdtemp())
    corpus.mkdir(parents=True, exist_ok=True)
    (corpus / "sound").write_bytes(changed.read_bytes()[:MAX_BYTES])

    def read_one(content: bytes) -> None:
        changed.write_bytes(content)
        try:
            READERS[kind].sniff(head_of(sound))
            READERS[kind].read(sound, strict=False)
        except RecordingError:
            pass

    atheris.Setup(
        [
            sys.argv[0],
            f"-max_total_time={options.seconds}",
            f"-max_len={MAX_BYTES}",
            f"-rss_limit_mb={MEMORY_MB}",
            f"-timeout={SECONDS_FOR_ONE}",
            f"-artifact_prefix={corpus.parent}/",
            str(corpus),
        ],
        read_one,
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main()
