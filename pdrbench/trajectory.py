"""Where a pedestrian was, and where the estimates put the pedestrian."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from pdrbench.errors import EstimateError, RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only


@dataclass(frozen=True, slots=True)
class Start:
    """What is known of where a walk begins: the centre of a disc.

    Attributes:
        xy_m: (2,) building frame.
        level: IMDF ordinal, 0 ground.
        heading_rad: Heading of travel, counter-clockwise from +x; None where it was not measured.
        radius_m: The walk begins within this distance of `xy_m`; 0 where the place is surveyed.
    """

    xy_m: FloatArray
    level: int
    heading_rad: float | None = None
    radius_m: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy_m", read_only(self.xy_m))
        if self.xy_m.shape != (2,) or not np.isfinite(self.xy_m).all():
            raise RecordingError(f"a start needs two finite coordinates; got {self.xy_m!r}")
        if self.radius_m < 0:
            raise RecordingError(f"a start radius is 0 m or more; got {self.radius_m}")


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Reference positions of one walk.

    Attributes:
        t_s: (T,) seconds from the start of the walk, strictly increasing.
        xy_m: (T, 2) building frame.
        level: (T,) int, IMDF ordinal.
        surveyed: (T,) bool, True where the position was surveyed independently and is scored;
            False where it is interpolated, or given to the localizer, and serves pictures only.
        heading_rad: (T,) heading of travel, or None.
        z_m: (T,) height above level 0, or None.
    """

    t_s: FloatArray
    xy_m: FloatArray
    level: IntArray
    surveyed: BoolArray
    heading_rad: FloatArray | None = None
    z_m: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "t_s", read_only(self.t_s))
        object.__setattr__(self, "xy_m", read_only(self.xy_m))
        object.__setattr__(self, "level", read_only(self.level, np.int64))
        object.__setattr__(self, "surveyed", read_only(self.surveyed, np.bool_))
        for name in ("heading_rad", "z_m"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, read_only(getattr(self, name)))
        count = len(self.t_s)
        shapes = {"t_s": (count,), "xy_m": (count, 2), "level": (count,), "surveyed": (count,)}
        shapes |= {name: (count,) for name in ("heading_rad", "z_m") if getattr(self, name) is not None}
        for name, shape in shapes.items():
            values = getattr(self, name)
            if values.shape != shape:
                raise RecordingError(f"trajectory: {name} has shape {values.shape}, expected {shape}")
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values.reshape(count, -1)).all(axis=1))[0])
                raise RecordingError(f"trajectory: {name} is not finite at row {row}; drop or mend the row")
        if count and (np.diff(self.t_s) <= 0).any():
            row = int(np.flatnonzero(np.diff(self.t_s) <= 0)[0]) + 1
            raise RecordingError(
                f"trajectory: t_s does not increase at row {row} "
                f"({self.t_s[row]:.3f} after {self.t_s[row - 1]:.3f}); sort it and drop duplicates in the reader"
            )

    def __len__(self) -> int:
        return len(self.t_s)

    def rows(self, keep: BoolArray) -> Trajectory:
        """The same trajectory with only the rows where `keep` (T,) is True."""
        columns = ((column.name, getattr(self, column.name)) for column in fields(self))
        kept: dict[str, Any] = {name: None if values is None else values[keep] for name, values in columns}
        return Trajectory(**kept)

    def scored(self) -> Trajectory:
        """The surveyed rows."""
        return self.rows(self.surveyed)


ESTIMATE_COLUMNS: Final = ("x_m", "y_m", "level", "heading_rad", "sigma_m", "converged")


@dataclass(frozen=True, slots=True)
class Estimates:
    """What a localizer answered during one walk; NaN in `xy_m` marks an answer that counts as missing.

    Attributes:
        t_s: (N,) `now_s` of the observation that each estimate answers, non-decreasing.
        xy_m: (N, 2) building frame, NaN where the answer was missing.
        level: (N,) float, integral where `xy_m` is finite.
        heading_rad: (N,) NaN where not claimed.
        sigma_m: (N,) NaN where not claimed; kept as answered, also where it makes no sense.
        converged: (N,) 1 where one place was claimed, 0 where several were possible, NaN where not claimed.
    """

    t_s: FloatArray
    xy_m: FloatArray
    level: FloatArray
    heading_rad: FloatArray
    sigma_m: FloatArray
    converged: FloatArray

    def __post_init__(self) -> None:
        columns = ("level", "heading_rad", "sigma_m", "converged")
        for name in ("t_s", "xy_m", *columns):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        count = len(self.t_s)
        for name in ("t_s", *columns):
            if getattr(self, name).shape != (count,):
                raise EstimateError(f"estimates: {name} has shape {getattr(self, name).shape}, expected ({count},)")
        if self.xy_m.shape != (count, 2):
            raise EstimateError(f"estimates: xy_m has shape {self.xy_m.shape}, expected ({count}, 2)")
        if not np.isfinite(self.t_s).all() or (np.diff(self.t_s) < 0).any():
            raise EstimateError("estimates: t_s must be finite and non-decreasing")

    def __len__(self) -> int:
        return len(self.t_s)

    @classmethod
    def from_columns(cls, t_s: FloatArray, columns: FloatArray) -> Estimates:
        """Estimates at `t_s` (N,) from their columns (6, N), in the order of `ESTIMATE_COLUMNS`."""
        return cls(t_s, columns[:2].T, *columns[2:])

    @property
    def columns(self) -> FloatArray:
        """(6, N) in the order of `ESTIMATE_COLUMNS`."""
        return np.stack([*self.xy_m.T, self.level, self.heading_rad, self.sigma_m, self.converged])

    @property
    def given(self) -> BoolArray:
        """(N,) True where an estimate was given: finite position and level."""
        return np.isfinite(self.xy_m).all(axis=1) & np.isfinite(self.level)
