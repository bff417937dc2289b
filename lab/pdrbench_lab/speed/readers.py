"""Readers of recordings beside what parses the same bytes into a table, in CPU seconds."""

from __future__ import annotations

import importlib.util
import io
import time
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from pdrbench.io import READERS
from pdrbench_formats.samples import SAMPLES, getsensordata, make_walk
from pdrbench_lab.speed.timing import Timing, median_s

WALK_S: Final = 600.0  # at 100 Hz
LOG_S: Final = 2000.0  # of GetSensorData: 60 MB
QUICK: Final = 0.1  # of both
PANDAS: Final = "pandas.read_csv on the same tables"


def run(quick: bool, report: Callable[[str], None]) -> list[Timing]:
    """All rows; `report` is called with what comes next."""
    part, rounds = (QUICK, 3) if quick else (1.0, 5)
    rows = [_log_row(LOG_S * part, rounds, report)]
    for name, (parse, against) in _PARSERS.items():
        if not SAMPLES[name].needs or importlib.util.find_spec(SAMPLES[name].needs) is not None:
            report(name)
            rows.append(_row(name, WALK_S * part, rounds, parse, against))
    return rows


def _log_row(duration_s: float, rounds: int, report: Callable[[str], None]) -> Timing:
    """A log of GetSensorData in MB/s, against its gyroscope's records in a file of their own."""
    import pandas as pd

    report("writing a log")
    with TemporaryDirectory() as folder:
        log = getsensordata(Path(folder), make_walk(duration_s), scans=True)
        table = Path(folder) / "gyro.csv"
        table.write_bytes(b"".join(line for line in log.open("rb") if line.startswith(b"GYRO")))
        read = READERS["getsensordata"].read
        read(log)  # compiles
        report("a log of GetSensorData")
        taken_s = median_s(
            {"ours": lambda: lambda: read(log), "other": lambda: lambda: pd.read_csv(table, sep=";", header=None)},
            rounds,
            time.process_time,
        )
        ours, other = (file.stat().st_size / taken_s[name] / 1e6 for name, file in (("ours", log), ("other", table)))
    against = "pandas.read_csv on the gyroscope's records alone"
    return Timing("getsensordata", ours, "MB / CPU s", against, ours / other)


def _row(name: str, duration_s: float, rounds: int, parse: Callable[[Path], object], against: str) -> Timing:
    """Seconds for a walk in one format."""
    sample = SAMPLES[name]
    read = READERS[sample.reader].read
    with TemporaryDirectory() as small, TemporaryDirectory() as folder:
        begin = sample.write(Path(small), make_walk(3.0))
        read(begin)
        parse(begin)  # both load their libraries
        path = sample.write(Path(folder), make_walk(duration_s))
        taken_s = median_s(
            {"ours": lambda: partial(read, path), "other": lambda: partial(parse, path)}, rounds, time.process_time
        )
    return Timing(name, taken_s["ours"], "CPU s", against, taken_s["other"] / taken_s["ours"])


def _contents(path: Path) -> Iterator[bytes]:
    """Tables of text in a file, a folder or an archive."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            yield from (archive.read(name) for name in archive.namelist())
    else:
        yield from (file.read_bytes() for file in ([path] if path.is_file() else path.rglob("*.csv")))


def _tables(path: Path, *, skipped_lines: int = 0) -> None:
    import pandas as pd

    for content in _contents(path):
        if content:
            line = content.split(b"\n", skipped_lines + 1)[skipped_lines].decode("latin-1")
            separator = max(",;\t", key=line.count)
            pd.read_csv(io.BytesIO(content), sep=separator, skiprows=skipped_lines, encoding="latin-1")


def _json(path: Path) -> None:
    import msgspec

    msgspec.json.decode(path.read_bytes())


def _bag(path: Path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        for connection, _, raw in bag.messages():
            bag.deserialize(raw, connection.msgtype)


def _mcap(path: Path) -> None:
    import msgspec
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages():
            msgspec.json.decode(message.data)


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path / "data.hdf5", "r") as file:
        for group in file.values():
            for array in group.values():
                array[()]


_PARSERS: Final[dict[str, tuple[Callable[[Path], object], str]]] = {
    **dict.fromkeys(("sensor logger, iOS", "phyphox", "androsensor", "xio", "csv", "ridi"), (_tables, PANDAS)),
    "xsens mt": (partial(_tables, skipped_lines=2), PANDAS),
    "sensor logger, JSON": (_json, "msgspec.json.decode on the same file"),
    "ronin": (_hdf5, "h5py, the same arrays"),
    "ros 1": (_bag, "rosbags, every message"),
    "ros 2": (_bag, "rosbags, every message"),
    "mcap, JSON": (_mcap, "mcap and msgspec, every message"),
}
