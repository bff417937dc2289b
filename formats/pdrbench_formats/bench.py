"""Logs of phones, read and checked, beside pandas on the same text as a table."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.bench.timing import Timing, median_s
from pdrbench_formats.recordings import csv_columns, getsensordata

LOG_BYTES: Final = 60_000_000
QUICK_BYTES: Final = 6_000_000
GYRO_PER_ACCEL: Final = 2  # the rates of a phone of IPIN 2023
SEED: Final = 1


def run(quick: bool, report: Callable[[str], None]) -> list[Timing]:
    """All rows; `report` is called with what comes next."""
    import pandas as pd

    rounds = 3 if quick else 5
    with tempfile.TemporaryDirectory() as folder:
        report("writing a log")
        log, table = _write(Path(folder), QUICK_BYTES if quick else LOG_BYTES)
        getsensordata.read(log)  # compiles
        report("GetSensorData")
        rows = [
            _row(
                "getsensordata",
                (log, lambda: getsensordata.read(log)),
                (table, lambda: pd.read_csv(table, sep=";", header=None)),
                "pandas.read_csv on the gyroscope's records alone",
                rounds,
            )
        ]
        report("a table")
        flat = Path(folder) / "flat.csv"
        names = ["t_s", *(f"{s}_{a}_{u}" for s, u in (("accel", "mps2"), ("gyro", "radps")) for a in "xyz")]
        flat.write_text("\n".join([",".join(names), *_table_lines(table), ""]))
        rows.append(
            _row(
                "csv",
                (flat, lambda: csv_columns.read(flat)),
                (flat, lambda: pd.read_csv(flat)),
                "pandas.read_csv on the same file",
                rounds,
            )
        )
    return rows


def _row(
    name: str,
    ours: tuple[Path, Callable[[], object]],
    other: tuple[Path, Callable[[], object]],
    against: str,
    rounds: int,
) -> Timing:
    taken_s = median_s({"ours": lambda: ours[1], "other": lambda: other[1]}, rounds)
    ours_mbps = ours[0].stat().st_size / taken_s["ours"] / 1e6
    other_mbps = other[0].stat().st_size / taken_s["other"] / 1e6
    return Timing(name, ours_mbps, "MB/s", against, ours_mbps / other_mbps)


def _write(folder: Path, num_bytes: int) -> tuple[Path, Path]:
    """A log of a phone that is tilted to and fro, and its gyroscope's records in a file of their own."""
    rng = np.random.default_rng(SEED)
    records, rates = [], []
    size = count = 0
    while size < num_bytes:
        t_s = 0.02 * count
        tilt_rad, rate_radps = 0.5 + 0.4 * np.sin(t_s), 0.4 * np.cos(t_s)
        noise = rng.normal(0.0, 0.02, 9)
        stamp = f"{t_s + 0.004:.4f};{t_s + 5000:.4f}"
        accel = (noise[0], 9.81 * np.sin(tilt_rad) + noise[1], 9.81 * np.cos(tilt_rad) + noise[2])
        lines = [f"ACCE;{stamp};{accel[0]:.5f};{accel[1]:.5f};{accel[2]:.5f};3"]
        for part in range(GYRO_PER_ACCEL):
            later = f"{t_s + 0.004 + part / 100:.4f};{t_s + 5000 + part / 100:.4f}"
            rates.append(f"GYRO;{later};{rate_radps + noise[3]:.5f};{noise[4]:.5f};{noise[5]:.5f};3")
            lines.append(rates[-1])
        lines.append(f"MAGN;{stamp};{noise[6] - 2:.5f};{noise[7] - 34:.5f};{noise[8] - 20:.5f};3")
        if count % 8 == 0:
            lines.append(f"PRES;{stamp};{976.2 + noise[6]:.4f};3")
        if count % 200 == 0:
            address = f"20:23:00:00:00:{count // 200 % 100:02d}"
            lines += [f"WIFI;{stamp};name;{address};2437;-{60 + k}" for k in range(16)]
        records += lines
        size += sum(map(len, lines)) + len(lines)
        count += 1
    log, table = folder / "log.txt", folder / "gyro.csv"
    log.write_text("\n".join([*records, ""]))
    table.write_text("\n".join([*rates, ""]))
    return log, table


def _table_lines(table: Path) -> list[str]:
    """Rows of time, acceleration and rates, made of the gyroscope's records."""
    lines = []
    for count, record in enumerate(table.read_text().split()):
        x, y, z = record.split(";")[3:6]
        lines.append(f"{count / 100},0.1,{0.2 + count % 7 / 100},{9.8 - count % 5 / 100},{x},{y},{z}")
    return lines
