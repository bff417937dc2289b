"""Published fingerprints of WLAN in MATLAB version 5: places on several levels, split into training and test rows.

One structure `database`: `trainingMacs` and `testMacs` (N, A) in dBm, one column an access point; `trainingLabels` and
`testLabels` (N, 5) with x, y, z, level and building.

* +100 stands for "not heard" and becomes NaN. Anything else above 0 dBm is no RSSI.
* The places of UJIIndoorLoc (`UJI1.mat`) are metres of Web Mercator, which are shorter on the ground, by the cosine of
  the latitude: 0.766 there. They are scaled and counted from the south-western corner of the training places. Errors
  that were published with the set are in metres of Web Mercator, see `FingerprintSet.ground_scale`.
* z is the level times a height that is the same everywhere; it is kept, and is not a measurement.
* Levels of different buildings share numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench.io.reader import Reader
from pdrbench.radio import survey_of_table
from pdrbench.recording import RadioMap
from pdrbench_formats.recordings.matfile import MatFile, has_variables, load

NOT_HEARD: Final = 100.0
EARTH_RADIUS_M: Final = 6_378_137.0  # of the sphere of Web Mercator (EPSG:3857)
MERCATOR_FROM_M: Final = 100_000.0  # no building reaches this far from the origin of its own coordinates
MAX_LABEL: Final = 1e9  # what is larger is no place, level or building


@dataclass(frozen=True, slots=True, eq=False)
class SurveyRows:
    """Scans at known places.

    Attributes:
        rssi_dbm: (N, A), NaN where an access point was not heard.
        xy_m: (N, 2) metres on the ground.
        height_m: (N,).
        level: (N,) int.
        building: (N,) int.
    """

    rssi_dbm: FloatArray
    xy_m: FloatArray
    height_m: FloatArray
    level: IntArray
    building: IntArray

    def __post_init__(self) -> None:
        for name in ("rssi_dbm", "xy_m", "height_m"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("level", "building"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    def __len__(self) -> int:
        return len(self.level)

    def radio_map(self) -> RadioMap:
        """As a survey: one scan a row, access points by their column; only the place distinguishes buildings."""
        return survey_of_table(self.xy_m, self.level, np.arange(len(self)), self.rssi_dbm)


@dataclass(frozen=True, slots=True, eq=False)
class FingerprintSet:
    """One set with its split.

    Attributes:
        train: Rows that a localizer may learn from.
        test: Rows that it is scored on.
        ground_scale: Metres on the ground per metre in the file: below 1 for Web Mercator, else 1. An error in metres
            divided by this is in the unit of what was published.
    """

    train: SurveyRows
    test: SurveyRows
    ground_scale: float

    def describe(self) -> dict[str, Any]:
        """What `pdrbench inspect` prints."""
        return {
            "holds": "WLAN fingerprints",
            "access points": self.train.rssi_dbm.shape[1],
            "ground metres per metre of the file": self.ground_scale,
            "parts": [
                {
                    "part": name,
                    "fingerprints": len(part),
                    "heard per fingerprint": float((~np.isnan(part.rssi_dbm)).sum(axis=1).mean()),
                    "levels": len(np.unique(part.level)),
                    "buildings": len(np.unique(part.building)),
                    "extent_m": " × ".join(f"{side:.0f}" for side in np.ptp(part.xy_m, axis=0)),
                }
                for name, part in {"train": self.train, "test": self.test}.items()
            ],
        }


def read(path: Path | str) -> FingerprintSet:
    """Reads one set."""
    file = load(Path(path), tuple(f"database.{part}{kind}" for part in ("training", "test") for kind in _KINDS))
    parts = {part: _checked(file, part) for part in ("training", "test")}
    columns = {part: rssi_dbm.shape[1] for part, (rssi_dbm, _) in parts.items()}
    if columns["training"] != columns["test"]:
        raise file.error(
            "database.testMacs",
            f"has {columns['test']} access points and trainingMacs has {columns['training']}; export both from one set",
        )
    places = parts["training"][1][:, :2]
    is_mercator = float(np.abs(places).max()) > MERCATOR_FROM_M
    scale = 1 / math.cosh(float(np.median(places[:, 1])) / EARTH_RADIUS_M) if is_mercator else 1.0
    origin = places.min(axis=0) if is_mercator else np.zeros(2)
    train, test = (
        SurveyRows(rssi_dbm, (labels[:, :2] - origin) * scale, labels[:, 2], *labels[:, 3:].T.astype(np.int64))
        for rssi_dbm, labels in parts.values()
    )
    return FingerprintSet(train, test, scale)


_KINDS: Final = ("Macs", "Labels")


def _checked(file: MatFile, part: str) -> tuple[FloatArray, FloatArray]:
    """RSSI with NaN (N, A), and labels (N, 5)."""
    macs, places = (f"database.{part}{kind}" for kind in _KINDS)
    rssi_dbm, labels = file.matrix(macs), file.matrix(places, 5)
    if len(rssi_dbm) != len(labels):
        raise file.error(macs, f"has {len(rssi_dbm)} rows and the labels have {len(labels)}; export both from one set")
    rssi_dbm = read_only(np.where(rssi_dbm == NOT_HEARD, np.nan, rssi_dbm))
    highest, lowest = (of.reduce(rssi_dbm, axis=1) for of in (np.fmax, np.fmin))
    wrong = np.flatnonzero((highest > 0) | np.isinf(lowest))
    if len(wrong):
        raise file.error(macs, f"row {wrong[0] + 1} has an RSSI above 0 dBm or an infinite one; not heard is +100")
    wrong = np.flatnonzero(
        ~(np.abs(labels) < MAX_LABEL).all(axis=1) | (np.floor(labels[:, 3:]) != labels[:, 3:]).any(axis=1)
    )
    if len(wrong):
        raise file.error(
            places, f"row {wrong[0] + 1} is not x, y, z, level and building, the last two whole numbers; leave it out"
        )
    return rssi_dbm, labels


READER: Final = Reader(read, lambda head: has_variables(head, {"database"}))
