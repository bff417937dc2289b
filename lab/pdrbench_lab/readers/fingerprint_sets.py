"""Published WLAN fingerprints that users get by themselves, read as `fingerprint_sets.toml` says."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pdrbench.errors import RecordingError, unknown_name
from pdrbench_sim.readers.wifi_fingerprints import FingerprintSet, SurveyRows, read


def read_set(name: str, folder: Path | str) -> FingerprintSet:
    """Reads a set that users get by themselves; `fingerprint_sets.toml` says what its files are called.

    Args:
        name: As in that table.
        folder: Where its files are.

    Raises:
        UnknownNameError: The table has no such set.
        RecordingError: A file is not of its layout.
    """
    sets = other_sets()
    if name not in sets:
        raise unknown_name("fingerprint set", name, sets)
    columns = sets[name]
    if columns["train"].endswith(".mat"):
        return read(Path(folder) / columns["train"])
    train, test = (_read_csv(Path(folder) / columns[part], columns) for part in ("train", "test"))
    return FingerprintSet(train, test, ground_scale=1.0)


@functools.cache
def other_sets() -> Mapping[str, Mapping[str, Any]]:
    """`fingerprint_sets.toml`, by name."""
    text = Path(__file__).with_name("fingerprint_sets.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _read_csv(file: Path, columns: Mapping[str, Any]) -> SurveyRows:
    import pandas

    table = pandas.read_csv(file)
    places = [columns[name] for name in ("x", "y", "level")]
    if lacking := [name for name in places if name not in table.columns]:
        raise RecordingError(f"{file}: no column {lacking[0]!r}; columns end with {', '.join(table.columns[-8:])}")
    rssi_dbm = table.filter(regex=f"^(?:{columns['access_point']})$").to_numpy(np.float64)
    rssi_dbm = np.where(rssi_dbm == columns["missing"], np.nan, rssi_dbm)
    xy_m, level = table[places[:2]].to_numpy(np.float64), table[places[2]].to_numpy(np.int64)
    return SurveyRows(rssi_dbm, xy_m, np.full(len(table), np.nan), level, np.zeros(len(table), dtype=np.int64))
