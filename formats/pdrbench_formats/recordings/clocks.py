"""Times of a recording: their unit, pauses, gaps, rates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from pdrbench.io.log import Finding
from pdrbench_formats.recordings.windows import MIN_ROWS, SAMPLED, Rows

MAX_PAUSE_S: Final = 60.0  # a clock that was set, or two walks in one file
MAX_GAP_S: Final = 1.0  # a step and a half: longer, and step detectors miss one
MIN_RATE_HZ: Final = 15.0  # steps come at up to 3 Hz and have harmonics


def clock(rows: Rows) -> Iterator[Finding]:
    """Unit of time and rate, from the stream with most rows; pauses, from all of them together."""
    name = max((n for n in SAMPLED if n in rows), key=lambda n: len(rows[n]), default="")
    if not name or len(rows[name]) < MIN_ROWS:
        return
    t_s = rows[name][:, 0]
    steps_s = np.diff(t_s)
    usual_s = float(np.median(steps_s[steps_s > 0])) if (steps_s > 0).any() else 0.0
    for unit, factor in (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)):
        if 2e-3 <= usual_s * factor <= 0.1:  # a row each second is slow, one each 2 s is a row each 2 ms
            yield Finding(
                "error",
                "time-unit",
                name,
                f"the median step of time is {usual_s:g} s",
                f"it looks like {unit}: state the unit of time",
            )
            return
    if usual_s < 1e-4:
        yield Finding(
            "error",
            "time-unit",
            name,
            f"the median step of time is {usual_s:g} s",
            "write the time of each sample in seconds",
        )
        return
    every_s = [rows[n][:, 0] for n in SAMPLED if n in rows]
    outside_s = max(t_s[0] - min(s[0] for s in every_s), max(s[-1] for s in every_s) - t_s[-1])
    all_s = t_s
    if max(float(steps_s.max()), outside_s) > MAX_PAUSE_S:  # then another sensor may have rows in that time
        all_s = np.sort(np.concatenate(every_s))
    pause_s = np.diff(all_s)
    if pause_s.max(initial=0.0) > MAX_PAUSE_S:
        after_s = all_s[int(pause_s.argmax())]
        yield Finding(
            "error",
            "clock-jump",
            f"every sensor, after {after_s:.3f} s",
            f"nothing for {pause_s.max():.0f} s",
            "the clock was set or this is more than one walk: split the file there",
        )
        return
    for name in ("accel", "gyro"):
        if name not in rows or len(rows[name]) < MIN_ROWS:
            continue
        t_s = rows[name][:, 0]
        steps_s = np.diff(t_s)
        rate_hz = (len(t_s) - 1) / max(float(t_s[-1] - t_s[0]), 1e-9)
        if rate_hz < MIN_RATE_HZ:
            yield Finding(
                "warning",
                "low-rate",
                name,
                f"{rate_hz:.2g} rows a second",
                f"steps cannot be found below {MIN_RATE_HZ:g} Hz: record at 50 Hz or more",
            )
        elif steps_s.max() > MAX_GAP_S:
            long = np.flatnonzero(steps_s > MAX_GAP_S)
            yield Finding(
                "warning",
                "gap",
                f"{name}, after {t_s[long[0]]:.3f} s",
                f"{len(long)} gaps longer than {MAX_GAP_S:g} s, the longest {steps_s.max():.2f} s",
                "keep the app in the foreground while recording",
            )
        same = float((steps_s == 0).mean())
        if same > 0.01:
            yield Finding(
                "warning" if same > 0.2 else "note",
                "equal-times",
                name,
                f"{same:.0%} of rows have the time of the row before them",
                "record with the time of the sensor, not of its arrival",
            )
