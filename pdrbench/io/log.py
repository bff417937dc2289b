"""What a reader makes of a log file, and the account of what it left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.io.geo import GeoFrame
from pdrbench.recording import Recording, SensorSpec, SensorStream
from pdrbench.sensors.checks import Finding
from pdrbench.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class ReadReport:
    """Account of one file: every row is kept, skipped or dropped.

    Attributes:
        kept: Rows by stream; "reference" counts the waypoints.
        skipped: Rows by record type that belong to no stream.
        dropped: Rows by reason that belong to a stream and were left out.
        mended: Count by reason of what was repaired without loss.
        longest_gap_s: By stream, the longest time without a row between its first and its last.
        constant: Streams of a sensor that reads one value from end to end.

    Counts of 0 are left out, except of what is kept.
    """

    kept: Mapping[str, int] = field(default_factory=dict)
    skipped: Mapping[str, int] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)
    mended: Mapping[str, int] = field(default_factory=dict)
    longest_gap_s: Mapping[str, float] = field(default_factory=dict)
    constant: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("kept", "skipped", "dropped", "mended", "longest_gap_s"):
            counts = getattr(self, name).items()
            is_left_out = name in ("skipped", "dropped", "mended")
            kept = {key: count for key, count in counts if count or not is_left_out}
            object.__setattr__(self, name, MappingProxyType(kept))


@dataclass(frozen=True, slots=True)
class Log:
    """One log file in pdrbench's units, clock and names, not yet tied to a building.

    Attributes:
        rows: (T, C) by sensor name, columns as in `pdrbench.sensors`, read-only, in order of delivery;
            a sensor that delivered nothing is left out.
        reference: The waypoints, possibly none.
        device: Brand and model as far as the file names them.
        report: What was kept and what was not.
        start_unix_s: Time 0 in seconds since 1970, UTC, or None where the file does not say.
        geo: The reference is in metres east and north of this place; None where it is in another frame.
        mounting: Where the device was carried, as far as the file says.
        findings: What is wrong or worth knowing.
    """

    rows: Mapping[str, FloatArray]
    reference: Trajectory
    device: str
    report: ReadReport
    start_unix_s: float | None = None
    geo: GeoFrame | None = None
    mounting: str = ""
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", MappingProxyType(dict(self.rows)))

    def recording(
        self,
        name: str,
        building: Building | None,
        spec_of: Callable[[str], SensorSpec],
        *,
        reference: Trajectory | None = None,
        mounting: str = "",
    ) -> Recording:
        """This log as a recording.

        Args:
            name: Id of the recording.
            building: Where the walk took place, or None.
            spec_of: Spec by sensor name: `pdrbench.sensors.sensor_spec`.
            reference: Used instead of the waypoints of the log.
            mounting: Where the device was carried; what the log says where it is empty.
        """
        return Recording(
            id=name,
            building=building,
            streams={sensor: SensorStream(spec_of(sensor), rows) for sensor, rows in self.rows.items()},
            reference=self.reference if reference is None else reference,
            device=self.device,
            mounting=mounting or self.mounting,
        )
