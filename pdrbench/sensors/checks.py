"""Can these rows be meant? Time base, rate, gravity, units: the checks of every reader, and of every toolbox function.

Each check is a pure function of rows and says what was seen and what to do about it. Units are judged by gravity, which
is there all the time; not by the median length of the specific force, which is above 2 g in a run.
"""

from __future__ import annotations

import functools
import math
import tomllib
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from pdrbench.errors import RecordingError, RecordingWarning
from pdrbench.geometry import FloatArray

Severity = Literal["error", "warning", "note"]
Rows = Mapping[str, FloatArray]  # (T, C) by sensor name, columns as in `pdrbench.sensors`

MIN_ROWS: Final = 20  # fewer say nothing on units
MAX_ROWS: Final = 60_000  # that units and axes are judged by: ten minutes at 100 Hz
SAMPLED: Final = ("accel", "gyro", "mag", "rotation", "baro")
WINDOW_S: Final = 0.5
_ROWS_AT_A_TIME: Final = 64
MAX_PAUSE_S: Final = 60.0  # a clock that was set, or two walks in one file
MAX_GAP_S: Final = 1.0  # a step and a half: longer, and step detectors miss one
MIN_RATE_HZ: Final = 15.0  # steps come at up to 3 Hz and have harmonics
MAX_RATE_RADPS: Final = 35.0  # 2000 degree/s, where gyroscopes end
_GRAVITY_MPS2: Final = (9.0, 10.6)  # a phone of IPIN 2023 reads 10.1
_MIN_MPS2, _MAX_MPS2 = 5.0, 25.0  # of gravity in any scale, and of a foot that runs from end to end of a recording
_MIN_STEADY: Final = 0.6  # mean over a second against the median; without gravity it cancels
_WHOLE: Final = 0.9  # of the rows that its rate gives a window
_MAX_SPREAD_MPS2: Final = 2.0  # of a rest that shows the scale
_OTHER_SIGN: Final = "by -9.80665 where it comes from CoreMotion of iOS, which has the other sign"
_MIN_TURN_RADPS: Final = 0.2  # a foot that walks, converted from degree/s twice, ends at 0.15
_MIN_UPWARDS: Final = 0.3  # sine of the dip: beyond 10 degrees of the equator, and above what iron does to a median
_JUDGED_AT_S: Final = (5.0, 30.0)  # a walker who stands says nothing of the unit of the rates: look twice
_MIN_JUDGED: Final = 100  # rows, whatever the unit of their times
_OTHER_RATE: Final = 1.5  # a rate that is so many times the stated one is another one; phones keep to 1.2
_MIN_PHONE_RADPS: Final = 0.06  # 900 walks with a phone, recorded and simulated, turn by 0.87 and more
_WALKS_MPS2: Final = 0.5  # standard deviation of the length of the force; 0.63 and more of these
_SHAKES_MPS2: Final = 5.0  # specific force strays that far from its median where a foot walks


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong or worth knowing.

    Attributes:
        severity: "error" where the recording cannot be used as it is, "warning" where results suffer, or "note".
        code: Short name of the check, as in "accel-unit".
        where: Stream, and row or time in it.
        seen: What was seen.
        remedy: What to do.
    """

    severity: Severity
    code: str
    where: str
    seen: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.where}: {self.seen}; {self.remedy}"


def found(key: str, where: str, seen: str, severity: Severity | None = None) -> Finding:
    """A finding whose severity, but for another one, and remedy stand in `findings.toml` under its code."""
    facts = known(key)
    return Finding(severity or facts["severity"], key.partition(",")[0], where, seen, facts["remedy"])


@functools.cache
def known(key: str) -> Mapping[str, Any]:
    """What `findings.toml` has of findings under a key."""
    table = tomllib.loads(Path(__file__).with_name("findings.toml").read_text(encoding="utf-8"))
    facts: Mapping[str, Any] = table.get(key, {})
    return facts


def clock(rows: Rows) -> Iterator[Finding]:
    """Unit of time and rate, from the stream with most rows; pauses, from all of them together."""
    name = max((n for n in SAMPLED if n in rows), key=lambda n: len(rows[n]), default="")
    if not name or len(rows[name]) < MIN_ROWS:
        return
    t_s = rows[name][:, 0]
    steps_s = np.diff(t_s)
    usual_s = float(np.median(steps_s[steps_s > 0])) if (steps_s > 0).any() else 0.0
    seen = f"the median step of time is {usual_s:g} s"
    for unit, factor in (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)):
        if 2e-3 <= usual_s * factor <= 0.1:  # a row each second is slow, one each 2 s is a row each 2 ms
            yield Finding("error", "time-unit", name, seen, f"it looks like {unit}: state the unit of time")
            return
    if name in ("accel", "gyro") and (np.abs(steps_s - 1.0) < 1e-6).all():
        yield found("time-unit, numbers of samples", name, "every step of time is 1 s")
        return
    if usual_s < 1e-4:
        yield found("time-unit, unknown", name, seen)
        return
    every_s = [rows[n][:, 0] for n in SAMPLED if n in rows]
    outside_s = max(t_s[0] - min(s[0] for s in every_s), max(s[-1] for s in every_s) - t_s[-1])
    all_s = t_s
    if max(float(steps_s.max()), outside_s) > MAX_PAUSE_S:  # then another sensor may have rows in that time
        all_s = np.sort(np.concatenate(every_s))
    pause_s = np.diff(all_s)
    if pause_s.max(initial=0.0) > MAX_PAUSE_S:
        after_s = all_s[int(pause_s.argmax())]
        yield found("clock-jump", f"every sensor, after {after_s:.3f} s", f"nothing for {pause_s.max():.0f} s")
        return
    for name in ("accel", "gyro"):
        if name not in rows or len(rows[name]) < MIN_ROWS:
            continue
        t_s = rows[name][:, 0]
        steps_s = np.diff(t_s)
        rate_hz = (len(t_s) - 1) / max(float(t_s[-1] - t_s[0]), 1e-9)
        if rate_hz < MIN_RATE_HZ:
            yield found("low-rate", name, f"{rate_hz:.2g} rows a second")
        elif steps_s.max() > MAX_GAP_S:
            long = np.flatnonzero(steps_s > MAX_GAP_S)
            seen = f"{len(long)} gaps longer than {MAX_GAP_S:g} s, the longest {steps_s.max():.2f} s"
            yield found("gap", f"{name}, after {t_s[long[0]]:.3f} s", seen)
        same = float((steps_s == 0).mean())
        if same > 0.01:
            seen = f"{same:.0%} of rows have the time of the row before them"
            yield found("equal-times", name, seen, "warning" if same > 0.2 else "note")


def gravity(rows: Rows) -> Iterator[Finding]:
    """Unit of acceleration, and whether gravity is in it."""
    accel = rows.get("accel")
    if accel is None or len(accel) < MIN_ROWS:
        return
    usual, mean, rest, spread = _levels(accel[:MAX_ROWS])
    where = "accel"
    if _is_gravity(usual, mean, rest):
        if not _GRAVITY_MPS2[0] <= rest <= _GRAVITY_MPS2[1] and spread < _MAX_SPREAD_MPS2:
            yield Finding(
                "warning", "accel-scale", where, f"gravity reads {rest:.2f} m/s^2", "calibrate the accelerometer"
            )
        return
    seen = f"the median length is {usual:.4g} m/s^2, of means over a second {mean:.4g}, where it is quiet {rest:.4g}"
    for unit, low, high, convert in (
        ("g", 0.8, 2.0, f"multiply by 9.80665 ({_OTHER_SIGN})"),
        ("mg", 800.0, 2000.0, "multiply by 0.00980665"),
        ("feet/s^2", 29.0, 50.0, "multiply by 0.3048"),
        ("g, converted twice", 78.0, 200.0, "divide by 9.80665"),
    ):
        if low <= mean <= high and low <= min(rest, usual) <= high and mean > _MIN_STEADY * usual:
            yield Finding("error", "accel-unit", where, seen, f"it looks like {unit}: state the unit, or {convert}")
            return
    if mean < _MIN_MPS2:
        yield found("no-gravity", where, seen)
        return
    yield Finding("error", "accel-unit", where, seen, "expected 9.81 m/s^2: state the unit, or convert to m/s^2")


def gravity_mps2(accel: FloatArray) -> float | None:
    """What rows (T, 4) of acceleration read where they are quiet; None where that is not gravity in m/s^2."""
    usual, mean, rest, _ = _levels(accel[:MAX_ROWS])
    return rest if _is_gravity(usual, mean, rest) else None


def _is_gravity(usual: float, mean: float, rest: float) -> bool:
    """Half of the samples of a foot that runs exceed 2 g: its rests and its means over strides do not."""
    return _MIN_MPS2 <= min(rest, usual) <= _MAX_MPS2 and mean > _MIN_STEADY * usual


def _levels(accel: FloatArray) -> tuple[float, float, float, float]:
    """Lengths of specific force (T, 4): median; of vectors averaged over a second; at rest, and how they spread there.

    At rest is the quietest tenth of half-second windows. Over a second shaking cancels, gravity stays: not over the
    part of one beside a gap, which may be a foot in the air.
    """
    length = lengths(accel[:, 1:])
    usual, most = float(np.median(length)), _WHOLE * WINDOW_S * rate_of(accel[:, 0])
    means, counts = windows(accel, 2 * WINDOW_S)
    whole = counts >= 2 * most if (counts >= 2 * most).any() else counts > 0
    mean = float(np.median(lengths(means[whole]))) if len(counts) else usual
    with np.errstate(over="ignore"):
        moments, counts = windows(np.column_stack([accel[:, 0], length, length**2]), WINDOW_S)
    moments = moments[(counts > 3) & (counts >= most)]
    if not len(moments):
        return usual, mean, usual, np.inf
    with np.errstate(invalid="ignore", over="ignore"):  # what a damaged file holds
        variance = np.nan_to_num(np.maximum(moments[:, 1] - moments[:, 0] ** 2, 0.0), nan=np.inf)
    quiet = variance <= np.quantile(variance, 0.1)
    return usual, mean, float(np.median(moments[quiet, 0])), float(np.sqrt(np.median(variance[quiet])))


def gyroscope(rows: Rows) -> Iterator[Finding]:
    """Unit of the rates, by what hands and feet can do."""
    gyro = rows.get("gyro")
    if gyro is None or len(gyro) < MIN_ROWS:
        return
    fast = float(np.quantile(lengths(gyro[:MAX_ROWS, 1:]), 0.99))
    if fast > MAX_RATE_RADPS:
        seen = f"a hundredth of it turns by {fast:.3g} rad/s or more"
        remedy = f"it looks like degree/s: state the unit, or multiply by pi/180 = {math.pi / 180:.6f}"
        yield Finding("error", "gyro-unit", "gyro", seen, remedy)
        return
    accel = rows.get("accel")
    if accel is None or len(accel) < MIN_ROWS:
        return
    force = lengths(accel[:MAX_ROWS, 1:])
    shakes = float(np.quantile(np.abs(force - np.median(force)), 0.99)) > _SHAKES_MPS2
    walks = float(force.std()) > _WALKS_MPS2
    if 0 < fast < (_MIN_TURN_RADPS if shakes else _MIN_PHONE_RADPS if walks else 0.0):  # 0: the sensor is off
        seen = f"the fastest hundredth turns by {fast:.3g} rad/s and more, of a device that is shaken"
        yield Finding("error", "gyro-unit", "gyro", seen, "it was converted from degree/s twice: leave it in rad/s")


def sign(rows: Rows) -> Iterator[Finding]:
    """Sign of acceleration, which shows nowhere but against the magnetic field: north of the equator it points down.

    Accelerometer and gyroscope alone cannot show it: with the other sign, they are those of the walk in a mirror.
    """
    accel, mag = (rows.get(name, np.zeros((0, 4)))[:MAX_ROWS] for name in ("accel", "mag"))
    if len(accel) < MIN_ROWS or len(mag) < MIN_ROWS:
        return
    force = accel[(np.searchsorted(accel[:, 0], mag[:, 0], side="right") - 1).clip(0), 1:]
    upwards = float(
        np.median((force * mag[:, 1:]).sum(axis=1) / np.maximum(lengths(force) * lengths(mag[:, 1:]), 1e-9))
    )
    if upwards > _MIN_UPWARDS:
        seen = f"the magnetic field points up by {math.degrees(math.asin(upwards)):.0f} degrees"
        remedy = (
            "south of the equator it does; elsewhere accel has the other sign, as from CoreMotion: multiply it by -1"
        )
        yield Finding("warning", "accel-sign", "accel", seen, remedy)


def guard(
    rows: Rows, *, min_rate_hz: float = MIN_RATE_HZ, stated_hz: float | None = None, whose: str = "the recording"
) -> None:
    """Refuses arrays that cannot be meant, and warns of what will make results worse.

    Args:
        rows: (n, 4) t_s, x, y, z by sensor name, "accel" in m/s2, "gyro" in rad/s, "mag" in microtesla.
        min_rate_hz: Fewer samples a second are too few for what follows.
        stated_hz: The rate as the caller states it; None where it is not stated.
        whose: What is refused, for the message.

    Raises:
        RecordingError: Shapes, order of times, numbers that are not finite, unit of time, rate, gravity, unit of rates.
    """
    for name, table in rows.items():
        _check_rows(name, table, whose)
    from_zero = _from_zero(rows)
    found = [one for check in (clock, gravity, gyroscope, sign) for one in check(from_zero)]
    for name in ("accel", "gyro"):
        table = rows.get(name, np.zeros((0, 4)))
        if len(table) >= MIN_ROWS:
            found += _rate(name, rate_of(table[:, 0]), min_rate_hz, stated_hz)
    refuse([one for one in found if one.code != "accel-scale"], whose)  # which seconds without a rest do not show


class Gate:
    """`guard` for rows that come in pieces: each piece is checked at once, what came so far after 5 s and after 30 s.

    Args:
        whose: What is refused, for the message.
        min_rate_hz: See `guard`.
    """

    def __init__(self, whose: str, min_rate_hz: float = MIN_RATE_HZ) -> None:
        self._whose, self._min_rate_hz = whose, min_rate_hz
        self._seen: dict[str, list[FloatArray]] = {}
        self._ends_s: dict[str, float] = {}
        self._to_judge_s = list(_JUDGED_AT_S)

    def take(self, rows: Rows) -> None:
        """Takes the next rows, (n, 4) by sensor name; raises `RecordingError` where they cannot be meant."""
        for name, table in rows.items():
            _check_rows(name, table, self._whose, self._ends_s.get(name, -math.inf))
            if len(table):
                self._ends_s[name] = float(table[-1, 0])
                if self._to_judge_s:
                    self._seen.setdefault(name, []).append(table.copy())
        accel = self._seen.get("accel", [])
        if not self._to_judge_s or sum(map(len, accel)) < _MIN_JUDGED:
            return
        covered_s = accel[-1][-1, 0] - accel[0][0, 0]
        if covered_s >= self._to_judge_s[0]:
            seen = {name: np.concatenate(parts) for name, parts in self._seen.items()}
            guard(seen, min_rate_hz=self._min_rate_hz, whose=self._whose)
            self._to_judge_s = [at_s for at_s in self._to_judge_s if at_s > covered_s]
            self._seen = self._seen if self._to_judge_s else {}


def refuse(found: Iterable[Finding], whose: str) -> None:
    """Raises the first error among findings as `RecordingError`; warns of the rest with `RecordingWarning`."""
    found = list(found)
    for one in found:
        if one.severity == "error":
            raise RecordingError(f"{whose}: {one}")
    for one in found:
        if one.severity == "warning":
            warnings.warn(f"{whose}: {one}", RecordingWarning, stacklevel=4)


def rate_of(t_s: FloatArray) -> float:
    """Rows a second where they come without a gap; 0 of times that stand still."""
    steps_s = np.diff(t_s)
    steps_s = steps_s[steps_s > 0]
    return 1.0 / float(np.median(steps_s)) if len(steps_s) else 0.0


def _from_zero(rows: Rows) -> dict[str, FloatArray]:
    begin_s = min((float(table[0, 0]) for table in rows.values() if len(table)), default=0.0)
    return {name: np.column_stack([table[:, 0] - begin_s, table[:, 1:]]) for name, table in rows.items()}


def _check_rows(name: str, table: FloatArray, whose: str, after_s: float = -math.inf) -> None:
    if table.ndim != 2 or table.shape[1] != 4:
        raise RecordingError(f"{whose}: {name} has the shape {table.shape}, expected (n, 4): t_s, x, y, z in each row")
    if not np.isfinite(table).all():
        bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
        raise RecordingError(
            f"{whose}: {name}, row {bad[0] + 1} holds {table[bad[0]].tolist()}, and {len(bad)} of {len(table)} rows "
            "are not finite; leave them out"
        )
    before_s = np.concatenate([[after_s], table[:-1, 0]]) if len(table) else np.zeros(0)
    back = np.flatnonzero(table[:, 0] < before_s)
    if len(back):
        row = int(back[0])
        raise RecordingError(
            f"{whose}: {name}, t_s goes back at row {row + 1} ({table[row, 0]:.3f} after {before_s[row]:.3f}); sort "
            "the rows by time, or cut the recording where the clock jumped"
        )


def _rate(name: str, rate_hz: float, min_rate_hz: float, stated_hz: float | None) -> Iterator[Finding]:
    if rate_hz < min_rate_hz:
        seen = f"{rate_hz:.3g} rows a second, and {min_rate_hz:g} are needed"
        yield Finding("error", "low-rate", name, seen, "record faster, or check the unit of the times")
    elif stated_hz is not None and not stated_hz / _OTHER_RATE < rate_hz < stated_hz * _OTHER_RATE:
        seen = f"{rate_hz:.4g} rows a second by their times, and {stated_hz:g} are stated"
        yield Finding("error", "other-rate", name, seen, "state the rate of the recording, or correct the times")


def extremes(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(C,) least and (C,) greatest of each column of rows (T, C); NumPy is slow along short rows: many at a time."""
    num, width = len(rows) // _ROWS_AT_A_TIME, rows.shape[1]
    blocks = rows[: num * _ROWS_AT_A_TIME].reshape(num, _ROWS_AT_A_TIME * width)
    rest = rows[num * _ROWS_AT_A_TIME :]
    low, high = (
        np.concatenate([least(blocks, axis=0).reshape(-1, width) if num else rest, rest]) for least in (np.min, np.max)
    )
    return low.min(axis=0), high.max(axis=0)


def is_constant(rows: FloatArray) -> bool:
    """True where rows (T, C) hold one value from end to end but for their times."""
    return bool((rows[-1, 1:] == rows[0, 1:]).all() and (rows[:, 1:] == rows[0, 1:]).all())


def lengths(vectors: FloatArray) -> FloatArray:
    """(T,) length of each vector; what a damaged file holds must not overflow."""
    with np.errstate(over="ignore"):
        lengths: FloatArray = np.minimum(np.sqrt(np.einsum("...i,...i", vectors, vectors)), 1e100)
    return lengths


def windows(rows: FloatArray, window_s: float) -> tuple[FloatArray, FloatArray]:
    """(K, C - 1) means over equal windows, NaN where one is empty, and (K,) rows in each."""
    if not len(rows) or rows[-1, 0] > (50 * len(rows) + 1000) * window_s:  # another unit of time: a finding of its own
        return np.zeros((0, rows.shape[1] - 1)), np.zeros(0)
    at = (rows[:, 0] // window_s).astype(np.int64)
    counts = np.bincount(at).astype(np.float64)
    sums = np.stack([np.bincount(at, weights=column) for column in rows[:, 1:].T], axis=1)
    with np.errstate(invalid="ignore"):
        return sums / counts[:, None], counts
