"""What a localizer is given, observes and answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray, read_only
from pdrbench.recording import MagneticMap, RadioMap, SensorSpec
from pdrbench.trajectory import Start

Carrier = Literal["foot", "phone"]


@dataclass(frozen=True, slots=True)
class Briefing:
    """What a localizer is given before a walk.

    Attributes:
        building: The map, without the name that it has elsewhere, or None.
        sensors: Spec by sensor name; every observation has rows for exactly these.
        period_s: Time between observations.
        start: Where the walk begins, or None where that is for the localizer to find out.
        radio_map: The radio survey, or None.
        subject: Facts on the person that a user would enter, such as `height_m`.
        mounting: Where the device is carried.
        magnetic_map: The magnetic survey, or None.
    """

    building: Building | None
    sensors: Mapping[str, SensorSpec]
    period_s: float
    start: Start | None = None
    radio_map: RadioMap | None = None
    subject: Mapping[str, float | str] = field(default_factory=dict)
    mounting: str = ""
    magnetic_map: MagneticMap | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", MappingProxyType(dict(self.sensors)))
        object.__setattr__(self, "subject", MappingProxyType(dict(self.subject)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Lets a briefing travel between processes, which a mapping proxy cannot."""
        fields = (self.building, dict(self.sensors), self.period_s, self.start, self.radio_map, dict(self.subject))
        return Briefing, (*fields, self.mounting, self.magnetic_map)

    @property
    def carrier(self) -> Carrier:
        """What the device counts as: one that is not on the foot is a phone."""
        return "foot" if self.mounting == "foot" else "phone"

    def require(
        self,
        *,
        sensors: tuple[str, ...] = (),
        start: bool = False,
        radio_map: bool = False,
        magnetic_map: bool = False,
        carrier: Carrier | None = None,
        min_rate_hz: float = 0.0,
    ) -> None:
        """Raises `UnsuitableError` naming the first thing a localizer needs and was not briefed with.

        A radio map that is needed has a scan on the level where the walk begins, if that is known. A device that may
        be carried anywhere counts as a phone. Every sensor that is needed has `min_rate_hz`, if its rate is known.
        """
        for name in sensors:
            if name not in self.sensors:
                offered = ", ".join(self.sensors) or "none"
                raise UnsuitableError(f"needs the sensor {name!r}; this environment offers {offered}")
            rate_hz = self.sensors[name].rate_hz
            if rate_hz is not None and rate_hz < min_rate_hz:
                raise UnsuitableError(f"needs {name!r} at {min_rate_hz:g} Hz or more; this one has {rate_hz:g} Hz")
        if carrier is not None and carrier != self.carrier:
            where = f"is carried in the {self.mounting}" if self.mounting else "may be carried anywhere"
            if self.carrier == "foot":
                raise UnsuitableError("needs a phone; this unit is on the foot")
            raise UnsuitableError(f"needs a unit on the foot (mounting foot); this one {where}")
        if start and self.start is None:
            raise UnsuitableError("needs a known start; this environment gives none")
        if radio_map and self.radio_map is None:
            raise UnsuitableError("needs a radio map; this environment has no radio survey")
        if magnetic_map and self.magnetic_map is None:
            raise UnsuitableError("needs a magnetic map; this environment has no magnetic survey")
        level = None if self.start is None else self.start.level
        if radio_map and self.radio_map is not None and level is not None and level not in self.radio_map.level:
            raise UnsuitableError(f"needs a radio survey of level {level}, where the walk begins; it has no scan there")


@dataclass(frozen=True, slots=True)
class Observation:
    """What the sensors delivered since the last step; nothing later than `now_s`.

    Attributes:
        now_s: Seconds from the start of the walk.
        rows: (n, C) rows by sensor name, n possibly 0; columns as in the briefing.
    """

    now_s: float
    rows: Mapping[str, FloatArray]

    def __getitem__(self, sensor: str) -> FloatArray:
        return self.rows[sensor]


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where the pedestrian is now.

    Attributes:
        xy_m: (2,) building frame.
        level: IMDF ordinal.
        heading_rad: Heading of travel, or None.
        sigma_m: Standard deviation per axis of an isotropic normal around `xy_m`, or None.
        converged: False where several places are still possible and `xy_m` is a guess (Woodman & Harle 2008, section
            6.3), True where it is one place, None where nothing is claimed.
    """

    xy_m: FloatArray
    level: int
    heading_rad: float | None = None
    sigma_m: float | None = None
    converged: bool | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy_m", read_only(np.asarray(self.xy_m, dtype=np.float64)))


@runtime_checkable
class Localizer(Protocol):
    """Anything that turns observations into estimates.

    A localizer may also offer

    * `debug() -> dict[str, NDArray]` of arrays for pictures (`particles_xy_m (N, 2)`, `particles_level (N,)`);
    * `revise() -> FloatArray | None`, asked for once when the walk is over (the offline division): where the pedestrian
      was, (K, 4) `t_s, x_m, y_m, level`, t_s increasing, then where claimed a fifth column `sigma_m` and a sixth
      `heading_rad`, NaN where not. It replaces the answers from its first row on; None leaves them as they were given.
    """

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        """Begins a walk, and forgets the one before: an instance may play several.

        Raises:
            UnsuitableError: The briefing lacks what this localizer needs.
        """

    def step(self, observation: Observation) -> Estimate:
        """Answers one observation with the position now."""
