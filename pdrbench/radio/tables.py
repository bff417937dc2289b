"""Fingerprint tables: a row a scan, a column an access point, and columns `x_m`, `y_m`, `level` where places are known.

Access points are known by the name of their column: those of a survey and of scans belong together where names agree.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio.surveys import survey_of_table
from pdrbench.recording import MAX_WALK_S, RadioMap

if TYPE_CHECKING:
    import pandas as pd

    ScanTable: TypeAlias = "pd.DataFrame | Path | str | tuple[Any, Any]"

PLACE: Final = ("x_m", "y_m", "level")
NOT_HEARD: Final = 100.0  # as UJIIndoorLoc and its like have it, beside NaN
PAUSE_S: Final = 600.0  # between scans without a time: whoever walks can be anywhere at the next


def survey_of(table: RadioMap | ScanTable) -> RadioMap:
    """The survey that a table makes; a pair is places (S, 2) or (S, 3), with the level, and RSSI (S, A).

    >>> survey_of(([[0.0, 0.0], [4.0, 0.0]], [[-50.0, 100.0], [-70.0, -60.0]])).first.tolist()
    [0, 1, 3]
    """
    if isinstance(table, RadioMap):
        return table
    if isinstance(table, tuple):
        places, rssi_dbm = (np.asarray(part, dtype=np.float64) for part in table)
        names = [f"{column}" for column in range(rssi_dbm.shape[-1])]
        if places.ndim != 2 or places.shape[1] not in (2, 3) or rssi_dbm.shape[:-1] != places.shape[:1]:
            raise RecordingError(f"radio map: places are (S, 2) or (S, 3) and RSSI (S, A); got {places.shape}, "
                                 f"{rssi_dbm.shape}")  # fmt: skip
        level = places[:, 2] if places.shape[1] == 3 else np.zeros(len(places))
    else:
        frame, names, rssi_dbm = _columns(table)
        if lacking := [name for name in PLACE[:2] if name not in frame.columns]:
            raise RecordingError(f"radio map: the table has no column {lacking[0]!r}; places are {', '.join(PLACE)}")
        places = frame[list(PLACE[:2])].to_numpy(np.float64)
        level = frame["level"].to_numpy(np.float64) if "level" in frame.columns else np.zeros(len(frame))
    number = np.arange(len(places))
    return survey_of_table(places[:, :2], level.astype(np.int64), number, _heard(rssi_dbm, names), _identifiers(names))


def wifi_rows(table: ScanTable | FloatArray) -> tuple[FloatArray, float | None]:
    """Rows (n, 5) of the sensor `wifi` that the scans of a table make, and the time between two without a `t_s`.

    Scans without a column `t_s` lie `PAUSE_S` apart, or less, so that all of them fit into a day.
    """
    if isinstance(table, np.ndarray):
        names, rssi_dbm, t_s = [f"{column}" for column in range(table.shape[1])], table, None
    else:
        frame, names, rssi_dbm = _columns(table)
        t_s = frame["t_s"].to_numpy(np.float64) if "t_s" in frame.columns else None
    pause_s = None
    if t_s is None:
        pause_s = min(PAUSE_S, MAX_WALK_S / max(len(rssi_dbm), 1))
        t_s = np.arange(len(rssi_dbm)) * pause_s
    heard = _heard(rssi_dbm, names)
    scan, column = np.nonzero(~np.isnan(heard))
    none = np.zeros(len(scan))  # of frequency and age
    return np.column_stack([t_s[scan], _identifiers(names)[column], heard[scan, column], none, none]), pause_s


def _columns(table: Any) -> tuple[pd.DataFrame, list[str], FloatArray]:
    """The table, names of its access points, and RSSI (S, A)."""
    if isinstance(table, str | Path):
        import pandas

        table = pandas.read_csv(table)
    names = [name for name in table.columns if name not in (*PLACE, "t_s")]
    return table, [str(name) for name in names], table[names].to_numpy(np.float64)


def _heard(rssi_dbm: FloatArray, names: list[str]) -> FloatArray:
    """(S, A) NaN where nothing was received."""
    heard = np.where(rssi_dbm == NOT_HEARD, np.nan, rssi_dbm)
    wrong = np.flatnonzero((heard > 0).any(axis=0) | np.isinf(heard).any(axis=0))
    if len(wrong):
        raise RecordingError(
            f"fingerprints: column {names[wrong[0]]!r} is no RSSI in dBm, it has values above 0; places are called "
            f"{', '.join(PLACE)}, times t_s, what was not received is NaN or 100; leave out all other columns"
        )
    return heard


def _identifiers(names: list[str]) -> IntArray:
    """(A,) numbers below 2**48 that follow from the names."""
    digests = [hashlib.blake2b(name.encode(), digest_size=6).digest() for name in names]
    return np.array([int.from_bytes(digest, "big") for digest in digests], dtype=np.int64)
