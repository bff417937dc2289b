"""From the rows of a file to a `Log`: one clock, rows that can be trusted, an account of the others, findings."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.geo import GeoFrame
from pdrbench.io.log import Log, ReadReport
from pdrbench.sensors import SENSORS
from pdrbench.sensors.checks import MIN_ROWS, SAMPLED, Finding, found, is_constant
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.delimited import most_odd

STANDARD_GRAVITY_MPS2: Final = 9.80665
MIN_BACK_S: Final = 0.5  # batches of a sensor hub come late by less
_MOST: Final = 1e9  # what a damaged file holds must not overflow
MAX_BACK_S: Final = 5.0  # rows that come late are sorted in where a format allows it; a clock that was set is refused


@dataclass(slots=True)
class Tally:
    """What a reader counts while it reads.

    Attributes:
        skipped: Rows by kind that belong to no stream.
        dropped: Rows by reason that were left out.
        mended: Count by reason of what was repaired without loss.
        findings: What the reader itself found.
    """

    skipped: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    mended: Counter[str] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)

    def note(self, severity: str, code: str, where: str, seen: str, remedy: str) -> None:
        """Adds a finding."""
        self.findings.append(Finding(severity, code, where, seen, remedy))  # type: ignore[arg-type]

    def found(self, key: str, where: str, seen: str) -> None:
        """Adds a finding whose remedy is known."""
        self.findings.append(found(key, where, seen))


def note_guesses(tally: Tally, guesses: Sequence[str]) -> None:
    """Finding "columns-guessed" of what numbers alone say of a table; none where that is nothing."""
    seen = f"what the header does not state was concluded from the numbers: {', '.join(guesses)}"
    remedy = "check it with `pdrbench inspect`, which prints a column map to keep"
    if guesses:
        tally.note("warning", "columns-guessed", "header", seen, remedy)


def note_face_down(tally: Tally, force: FloatArray, remedy: str) -> None:
    """Finding "accel-sign" of a phone that lay on its face for most of a walk, as if it had the sign of Apple.

    Args:
        tally: Receives it.
        force: (T, 3) specific force of a phone, in any unit.
        remedy: What to do where the sign is wrong.
    """
    force = force[(np.abs(force) < _MOST).all(axis=1)]
    if not len(force):
        return
    z, length = float(np.median(force[:, 2])), float(np.median(np.linalg.norm(force, axis=1)))
    if z < -0.5 * length:
        seen = f"z is {z / length:.2f} of gravity: the device lay on its face, or the sign is that of an iPhone"
        tally.note("warning", "accel-sign", "accel", seen, f"in the second case the walk turns the wrong way: {remedy}")


@dataclass(frozen=True, slots=True)
class Origin:
    """What a reader knows beside the rows.

    Attributes:
        device: Brand and model.
        start_unix_s: Of 0 on the clock of the rows, in seconds since 1970, UTC.
        geo: Frame of the reference.
        mounting: Where the device was carried.
    """

    device: str = ""
    start_unix_s: float | None = None
    geo: GeoFrame | None = None
    mounting: str = ""


def seconds(ns: IntArray, origin_ns: int) -> FloatArray:
    """(T,) seconds since `origin_ns` of times (T,) in whole nanoseconds: the difference is taken in integers.

    >>> seconds(np.array([1762361557996220201, 1762361559996220201]), 1762361557996220201).tolist()
    [0.0, 2.0]
    """
    return (np.asarray(ns, dtype=np.int64) - np.int64(origin_ns)).astype(np.float64) * 1e-9


def unit_quaternions(q: FloatArray) -> FloatArray:
    """Quaternions (T, 4) of length 1 where they are nearly so, as printed with few digits; others as they are."""
    length = np.sqrt((q**2).sum(axis=1, keepdims=True))
    near = np.abs(length - 1.0) < 0.01
    unit: FloatArray = np.where(near, q / np.where(near, length, 1.0), q)
    return np.where(near, np.clip(unit, -1.0, 1.0), unit)


def with_gravity(linear: FloatArray, gravity: FloatArray) -> FloatArray:
    """Rows (T, 4) of an acceleration without gravity, and that of rows (G, 4) at their times."""
    t_s, *axes = gravity[np.argsort(gravity[:, 0], kind="stable")].T
    between = [np.interp(linear[:, 0], t_s, axis) for axis in axes]
    whole: FloatArray = linear + np.column_stack([np.zeros(len(linear)), *between])
    return whole


def places(
    t_s: FloatArray,
    xy_m: FloatArray,
    level: IntArray | None = None,
    *,
    surveyed: bool = True,
    z_m: FloatArray | None = None,
    tally: Tally | None = None,
) -> Trajectory:
    """A reference from rows (T,), (T, 2) in any order of time; rows without numbers and equal times are left out."""
    level = np.zeros(len(t_s), dtype=np.int64) if level is None else np.asarray(level, dtype=np.int64)
    whole = np.isfinite(t_s) & np.isfinite(xy_m).all(axis=1)
    if z_m is not None:
        whole &= np.isfinite(z_m)
    order = np.flatnonzero(whole)[np.argsort(t_s[whole], kind="stable")]
    first = np.append(True, np.diff(t_s[order]) > 0)[: len(order)]
    if tally is not None:
        tally.dropped["reference is not a number"] += int((~whole).sum())
        tally.dropped["reference twice at one time"] += int((~first).sum())
    keep = order[first]
    return Trajectory(
        t_s=t_s[keep],
        xy_m=xy_m[keep],
        level=level[keep],
        surveyed=np.full(len(keep), surveyed),
        z_m=None if z_m is None else z_m[keep],
    )


def assemble(
    path: Path,
    streams: Mapping[str, FloatArray],
    *,
    reference: Trajectory | None = None,
    origin: Origin = Origin(),
    tally: Tally | None = None,
    allow_unsorted: Collection[str] = (),
    strict: bool = True,
) -> Log:
    """A log from rows on one clock.

    * A row without a finite number in each column is dropped and counted.
    * A row that equals the one before it, time included, is dropped and counted, but for radio.
    * Times that go back by up to `MAX_BACK_S` are sorted in `allow_unsorted` streams and counted; elsewhere a few rows
      with wrong times are dropped and counted, and more are an error, since they cannot be integrated over.
    * Time 0 is the first row of any sensor, or the first place of the reference where that is earlier.

    Args:
        path: Named in errors.
        streams: (T, C) by sensor name, columns as in `pdrbench.sensors`; times in seconds from any origin. The arrays
            are taken over: they are changed, and read-only afterwards.
        reference: On the clock of the streams.
        origin: Device, time of day, frame of the reference.
        tally: What the reader counted and found.
        allow_unsorted: Names of streams whose rows the format writes as they arrive.
        strict: False to return a log with errors among its findings.

    Raises:
        RecordingError: No sensor has a row; or, where `strict`, something was found that is an error.
    """
    from pdrbench_formats.recordings.findings import examine  # half a second, which who makes a task needs not

    tally = tally or Tally()
    rows: dict[str, FloatArray] = {}
    for name, table in streams.items():
        columns = len(SENSORS[name].columns)
        if table.ndim != 2 or table.shape[1] != columns:
            raise ValueError(f"{name}: rows have shape {table.shape}, expected (T, {columns})")
        kept = _in_order(name, _numbers(name, table, tally), name in allow_unsorted, tally)
        if len(kept):
            rows[name] = kept
    if not rows:
        raise RecordingError(f"{path}: no row of any sensor that pdrbench knows; record accelerometer and gyroscope")
    begin_s = min(float(table[0, 0]) for table in rows.values())
    if reference is None:
        reference = Trajectory(np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.bool_))
    elif len(reference):
        begin_s = min(begin_s, float(reference.t_s[0]))
        reference = dataclasses.replace(reference, t_s=reference.t_s - begin_s)
    for table in rows.values():
        table[:, 0] -= begin_s
        table.flags.writeable = False
    log = Log(
        rows=rows,
        reference=reference,
        device=origin.device,
        report=_report(rows, len(reference), tally),
        start_unix_s=None if origin.start_unix_s is None else origin.start_unix_s + begin_s,
        geo=origin.geo,
        mounting=origin.mounting,
        findings=examine(rows, tally.findings),
    )
    if strict:
        refuse_errors(path, log)
    return log


def refuse_errors(path: Path, log: Log) -> None:
    """Raises `RecordingError` with the first error among the findings of a log; says how many more there are."""
    errors = [finding for finding in log.findings if finding.severity == "error"]
    if errors:
        more = f" (and {len(errors) - 1} more: pdrbench inspect lists them)" if len(errors) > 1 else ""
        raise RecordingError(f"{path}: {errors[0]}{more}")


def _numbers(name: str, table: FloatArray, tally: Tally) -> FloatArray:
    """The rows that hold numbers only."""
    kept: FloatArray = np.require(table, np.float64, ["C", "W"])
    if not np.isfinite(kept).all():
        whole = np.isfinite(kept).all(axis=1)
        tally.dropped[f"{name} is not a number"] += int((~whole).sum())
        kept = kept[whole]
    return kept


def _in_order(name: str, table: FloatArray, may_sort: bool, tally: Tally) -> FloatArray:
    """Rows in order of time, without those that stand twice."""
    step_s = np.diff(table[:, 0])
    back = np.flatnonzero(step_s < 0)
    if len(back):
        behind_s = np.maximum.accumulate(table[:, 0]) - table[:, 0]
        row = int(back[0]) + 1
        was_set = behind_s.max() > MAX_BACK_S or (name in SAMPLED and _stands_twice(table[:, 0], behind_s))
        if may_sort and not was_set:
            tally.mended[f"{name} sorted by time"] += int((behind_s > 0).sum())
        elif len(stray := _strays(table[:, 0], back)):
            tally.dropped[f"{name} has a time that does not fit the rows around it"] += len(stray)
            table = np.delete(table, stray, axis=0)
        else:
            seen = f"the time goes from {table[row - 1, 0]:.6f} to {table[row, 0]:.6f} s, and back in {len(back)} rows"
            tally.found("clock-back", f"{name}, row {row + 1}", seen)
        table = table[np.argsort(table[:, 0], kind="stable")]
        step_s = np.diff(table[:, 0])
    if name not in SAMPLED or step_s.all():
        return table
    again = np.append(False, (table[1:] == table[:-1]).all(axis=1))
    if again.any():
        tally.dropped[f"{name} the same row twice"] += int(again.sum())
        if again.mean() > 0.01:
            seen = f"{again.mean():.0%} of the rows stand twice"
            tally.found("duplicates", f"{name}, row {int(np.flatnonzero(again)[0]) + 1}", seen)
        table = table[~again]
    return table


def _strays(t_s: FloatArray, back: IntArray) -> IntArray:
    """The few rows whose own times are wrong, where times (T,) go `back`; none where the clock was set.

    Of the two rows of a step back the second is wrong if the row after it goes on from the first, else the first if the
    second goes on from the row before.
    """
    t_s = np.concatenate([[-np.inf], t_s, [np.inf]])
    second, first = t_s[back + 3] >= t_s[back + 1], t_s[back + 2] >= t_s[back]
    stray = np.unique(np.where(second, back + 1, back))
    kept = np.delete(t_s, stray + 1)
    is_few = (second | first).all() and len(stray) <= most_odd(len(t_s)) and (kept[1:] >= kept[:-1]).all()
    return stray if is_few else stray[:0]


def _stands_twice(t_s: FloatArray, behind_s: FloatArray) -> bool:
    """Whether rows go back into time that other rows have: a clock that was set, not rows that are late."""
    last = int(behind_s.argmax())
    back_s = float(behind_s[last])
    step_s = np.diff(t_s)
    usual_s = float(np.median(step_s[step_s > 0])) if (step_s > 0).any() else 0.0
    num = int(((t_s >= t_s[last]) & (t_s <= t_s[last] + back_s)).sum())
    return back_s > MIN_BACK_S and num * usual_s > 1.5 * back_s


def _report(rows: Mapping[str, FloatArray], num_places: int, tally: Tally) -> ReadReport:
    return ReadReport(
        kept={**{name: len(table) for name, table in rows.items()}, "reference": num_places},
        skipped=+tally.skipped,
        dropped=+tally.dropped,
        mended=+tally.mended,
        longest_gap_s={name: float(np.diff(table[:, 0]).max()) for name, table in rows.items() if len(table) > 1},
        constant=tuple(
            name for name, table in rows.items() if name in SAMPLED and len(table) >= MIN_ROWS and is_constant(table)
        ),
    )
