"""One walk as it was recorded: sensor streams, the building it took place in, the surveyed reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench.trajectory import Start, Trajectory

MAX_WALK_S: Final = 86_400.0  # a day; a time beyond it is a clock of another unit


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """What one sensor delivers.

    Attributes:
        name: Key of the stream, as in "accel".
        columns: C names with unit suffix; the first is `t_s`, the time of delivery.
        low: (C,) smallest value each column can take; at most 0, since observations are padded with zeros.
        high: (C,) largest value each column can take; at least 0.
        rate_hz: Nominal rate, or None where rows are events.
        what: One sentence: what is measured, in which frame.
        derived: True where the stream was computed from other streams of the recording, not measured; see
            `pdrbench_formats.derive`.
    """

    name: str
    columns: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    rate_hz: float | None
    what: str
    derived: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", tuple(self.columns))
        object.__setattr__(self, "low", read_only(self.low))
        object.__setattr__(self, "high", read_only(self.high))
        if not self.columns or self.columns[0] != "t_s":
            raise RecordingError(f"sensor {self.name!r}: the first column is t_s; got {self.columns}")
        if len(set(self.columns)) != len(self.columns):
            raise RecordingError(f"sensor {self.name!r}: duplicate column in {self.columns}")
        if self.low.shape != (len(self.columns),) or self.high.shape != (len(self.columns),):
            raise RecordingError(f"sensor {self.name!r}: low and high need one value per column")
        if not (np.isfinite(self.low) & np.isfinite(self.high) & (self.low <= 0) & (self.high >= 0)).all():
            raise RecordingError(f"sensor {self.name!r}: bounds must be finite and include 0")

    def index(self, column: str) -> int:
        """Position of a column.

        >>> from pdrbench.sensors import sensor_spec
        >>> sensor_spec("accel").index("z_mps2")
        3
        """
        try:
            return self.columns.index(column)
        except ValueError:
            raise RecordingError(
                f"sensor {self.name!r} has no column {column!r}; columns: {', '.join(self.columns)}"
            ) from None


@dataclass(frozen=True, slots=True)
class SensorStream:
    """Everything one sensor delivered during a walk.

    Attributes:
        spec: What the columns are.
        rows: (T, C) float64, time non-decreasing, finite, within the bounds of `spec`.
    """

    spec: SensorSpec
    rows: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", read_only(self.rows))
        name, rows = self.spec.name, self.rows
        if rows.ndim != 2 or rows.shape[1] != len(self.spec.columns):
            raise RecordingError(
                f"stream {name!r}: rows have shape {rows.shape}, expected (T, {len(self.spec.columns)}) "
                f"for {', '.join(self.spec.columns)}"
            )
        outside = ~((rows >= self.spec.low) & (rows <= self.spec.high))
        if outside.any():
            row, column = (int(i) for i in np.argwhere(outside)[0])
            raise RecordingError(
                f"stream {name!r}: {self.spec.columns[column]} is {rows[row, column]} at row {row}, outside "
                f"[{self.spec.low[column]:g}, {self.spec.high[column]:g}]; check the unit in the reader"
            )
        back = np.flatnonzero(np.diff(rows[:, 0]) < 0)
        if len(back):
            row = int(back[0]) + 1
            raise RecordingError(
                f"stream {name!r}: t_s goes back at row {row} ({rows[row, 0]:.3f} after {rows[row - 1, 0]:.3f}); "
                f"sort or split the log in the reader"
            )

    @property
    def t_s(self) -> FloatArray:
        """(T,) time of delivery of each row."""
        return self.rows[:, 0]

    def column(self, name: str) -> FloatArray:
        """(T,) one column."""
        return self.rows[:, self.spec.index(name)]


@dataclass(frozen=True, slots=True)
class Recording:
    """One walk.

    Attributes:
        id: Unique within its task; opaque where it belongs to a test split.
        building: Where it took place, or None where it is not known.
        streams: Stream by sensor name.
        reference: Where the pedestrian was.
        subject: Facts on the person (`height_m`, ...); what is not known is left out.
        device: Model of the phone or inertial unit.
        mounting: Where it was carried: "hand", "pocket", "foot".
    """

    id: str
    building: Building | None
    streams: Mapping[str, SensorStream]
    reference: Trajectory
    subject: Mapping[str, float | str] = field(default_factory=dict)
    device: str = ""
    mounting: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "streams", MappingProxyType(dict(self.streams)))
        object.__setattr__(self, "subject", MappingProxyType(dict(self.subject)))
        for name, stream in self.streams.items():
            if stream.spec.name != name:
                raise RecordingError(f"recording {self.id!r}: stream {stream.spec.name!r} is filed under {name!r}")

    @property
    def end_s(self) -> float:
        """Time of the last reference row or sensor row, whichever is later."""
        ends = [float(s.rows[-1, 0]) for s in self.streams.values() if len(s.rows)]
        if len(self.reference):
            ends.append(float(self.reference.t_s[-1]))
        return max(ends, default=0.0)


@dataclass(frozen=True, slots=True)
class RadioMap:
    """Fingerprints: scans at known places, as a radio survey leaves them.

    Attributes:
        xy_m: (S, 2) where each scan was delivered.
        level: (S,) int.
        walk: (S,) int, scans with the same number come from one survey walk and depend on each other.
        first: (S + 1,) int, scan s owns the readings `first[s]:first[s + 1]`.
        access_point: (R,) int, opaque identifier, the same as in the `wifi` stream.
        rssi_dbm: (R,).
        age_s: (R,) how long before the scan was delivered the access point was last heard.
        surveyed: True where `xy_m` was surveyed; False where it is interpolated between surveyed places.
    """

    xy_m: FloatArray
    level: IntArray
    walk: IntArray
    first: IntArray
    access_point: IntArray
    rssi_dbm: FloatArray
    age_s: FloatArray
    surveyed: bool = False

    def __post_init__(self) -> None:
        for name in ("xy_m", "rssi_dbm", "age_s"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("level", "walk", "first", "access_point"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))
        scans, readings = len(self.level), len(self.access_point)
        if self.xy_m.shape != (scans, 2) or self.walk.shape != (scans,) or self.first.shape != (scans + 1,):
            raise RecordingError("radio map: xy_m, level, walk and first disagree on the number of scans")
        if self.rssi_dbm.shape != (readings,) or self.age_s.shape != (readings,):
            raise RecordingError("radio map: access_point, rssi_dbm and age_s disagree on the number of readings")
        if self.first[0] != 0 or self.first[-1] != readings or (np.diff(self.first) < 0).any():
            raise RecordingError("radio map: first must rise from 0 to the number of readings")
        if not (np.isfinite(self.xy_m).all() and np.isfinite(self.rssi_dbm).all() and np.isfinite(self.age_s).all()):
            raise RecordingError("radio map: xy_m, rssi_dbm and age_s must be finite")

    def __len__(self) -> int:
        return len(self.level)

    def middle(self) -> Start:
        """The median of the places on the level that has the most scans, the lower of two alike."""
        levels, counts = np.unique(self.level, return_counts=True)
        level = int(levels[counts.argmax()])
        return Start(np.median(self.xy_m[self.level == level], axis=0), level)


@dataclass(frozen=True, slots=True)
class MagneticMap:
    """The magnetic field at known places, as walks with a phone leave it.

    Attributes:
        xy_m: (S, 2) where each sample was taken; interpolated between surveyed places.
        level: (S,) int.
        walk: (S,) int, samples with the same number come from one survey walk, in its order; what the phone itself adds
            to the field, in its own frame, is the same in all of them.
        field_ut: (S, 3) in a level frame that turns with the phone: to its right, ahead (as its top edge), and up.
    """

    xy_m: FloatArray
    level: IntArray
    walk: IntArray
    field_ut: FloatArray

    def __post_init__(self) -> None:
        for name, kind in (("xy_m", np.float64), ("field_ut", np.float64), ("level", np.int64), ("walk", np.int64)):
            object.__setattr__(self, name, read_only(getattr(self, name), kind))
        shapes = [self.xy_m.shape, self.level.shape, self.walk.shape, self.field_ut.shape]
        samples = len(self.level)
        if shapes != [(samples, 2), (samples,), (samples,), (samples, 3)]:
            raise RecordingError("magnetic map: xy_m, level, walk and field_ut disagree on the number of samples")
        if not (np.isfinite(self.xy_m).all() and np.isfinite(self.field_ut).all()):
            raise RecordingError("magnetic map: xy_m and field_ut must be finite")

    def __len__(self) -> int:
        return len(self.level)
