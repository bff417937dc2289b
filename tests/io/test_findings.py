"""Every fault of a recording is found in its numbers, and a good walk has none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pdrbench.errors import RecordingError
from pdrbench_formats.recordings.assemble import assemble
from pdrbench_formats.recordings.findings import examine

Rows = dict[str, np.ndarray]
SENSORS = ("accel", "gyro", "mag", "rotation", "baro")


def scaled(sensor: str, factor: float) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        rows[sensor][:, 1:] *= factor

    return change


def columns(sensor: str, order: list[int], signs: list[float]) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        rows[sensor][:, 1:] = rows[sensor][:, 1:][:, order] * signs

    return change


def timed(factor: float) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for table in rows.values():
            table[:, 0] *= factor

    return change


def without_gravity(rows: Rows) -> None:
    rows["accel"][:, 1:] -= rows["gravity"][:, 1:]


def running(rows: Rows) -> None:
    """A foot that runs: it swings through 70 degrees at 2 g, with blows of 5 g, after two seconds of rest."""
    t_s = rows["accel"][:, 0]
    phase = 2 * np.pi * 1.4 * t_s
    length = 21.0 + 6.0 * np.sin(phase) + 25.0 * np.maximum(0.0, np.sin(phase)) ** 8
    pitch = 1.2 * np.sin(phase)
    rows["accel"][:, 1:] = length[:, None] * np.column_stack([np.sin(pitch), 0 * pitch, np.cos(pitch)])
    rows["accel"][:200, 1:] = [0.0, 0.0, 9.8]  # before the start
    for name in ("gyro", "mag", "rotation", "baro"):
        del rows[name]


def running_in_g(rows: Rows) -> None:
    running(rows)
    rows["accel"][:, 1:] /= 9.80665


def running_from_end_to_end(rows: Rows) -> None:
    running(rows)
    rows["accel"] = rows["accel"][200:]


def mirrored(rows: Rows) -> None:
    for name in ("accel", "gyro"):
        rows[name][:, 2] *= -1.0


def jump(rows: Rows) -> None:
    for table in rows.values():
        table[1500:, 0] += 3600.0


def gap(rows: Rows) -> None:
    rows["accel"] = np.delete(rows["accel"], np.arange(1000, 1250), axis=0)


def stuck(rows: Rows) -> None:
    rows["gyro"][:, 1:] = [0.0, 0.1, 0.0]


def saturated(rows: Rows) -> None:
    rows["gyro"][:, 1:] = np.clip(10.0 * rows["gyro"][:, 1:], -4.36, 4.36)
    del rows["accel"], rows["rotation"]
    rows["wifi"] = np.zeros((1, 5))


def other_phone(rows: Rows) -> None:
    rows["accel"][::2, 1:] = rows["accel"][::2, 1:][:, [2, 0, 1]]
    del rows["rotation"]


def slow(rows: Rows) -> None:
    for name in rows:
        rows[name] = rows[name][::50]


def huge(rows: Rows) -> None:
    rows["mag"][7, 2] = 1e9


def no_inertia(rows: Rows) -> None:
    del rows["accel"], rows["gyro"]


@pytest.mark.parametrize(
    ("change", "severity", "code"),
    [
        (scaled("accel", 1 / 9.80665), "error", "accel-unit"),
        (scaled("accel", 1000 / 9.80665), "error", "accel-unit"),
        (scaled("accel", 9.80665), "error", "accel-unit"),
        (scaled("accel", 1.12), "warning", "accel-scale"),
        (without_gravity, "error", "no-gravity"),
        (running_in_g, "error", "accel-unit"),
        (scaled("gyro", 180 / np.pi), "error", "gyro-unit"),
        (scaled("gyro", np.pi / 180), "error", "gyro-unit"),
        (scaled("gyro", -1.0), "error", "axes"),
        (mirrored, "error", "axes"),
        (columns("gyro", [1, 0, 2], [1, 1, 1]), "error", "axes"),
        (columns("accel", [2, 1, 0], [1, 1, 1]), "error", "axes"),
        (columns("accel", [0, 1, 2], [-1, -1, -1]), "error", "quaternion"),
        (columns("rotation", [0, 1, 2, 3], [1, -1, -1, -1]), "error", "quaternion"),
        (columns("rotation", [1, 2, 3, 0], [1, 1, 1, 1]), "error", "quaternion"),
        (scaled("rotation", 0.5), "error", "quaternion-length"),
        (scaled("mag", 0.01), "error", "mag-unit"),
        (scaled("mag", 8.0), "warning", "mag-uncalibrated"),
        (scaled("baro", 0.1), "error", "baro-unit"),
        (timed(1e3), "error", "time-unit"),
        (timed(1e6), "error", "time-unit"),
        (timed(1e9), "error", "time-unit"),
        (timed(1e-3), "error", "time-unit"),
        (jump, "error", "clock-jump"),
        (gap, "warning", "gap"),
        (stuck, "error", "constant"),
        (saturated, "warning", "saturated"),
        (other_phone, "error", "two-devices"),
        (slow, "warning", "low-rate"),
        (huge, "error", "out-of-bounds"),
        (no_inertia, "warning", "cannot-localize"),
    ],
)
def test_a_fault_is_found(phone_walk: Rows, change: Callable[[Rows], None], severity: str, code: str) -> None:
    rows = {name: table.copy() for name, table in phone_walk.items()}
    change(rows)
    del rows["gravity"]
    found = examine(rows)
    assert (severity, code) in {(finding.severity, finding.code) for finding in found}, found
    assert all(finding.where and finding.seen and finding.remedy for finding in found)


def test_a_good_walk_has_no_fault_and_nothing_to_read_is_refused(phone_walk: Rows) -> None:
    assert examine({name: phone_walk[name] for name in SENSORS}) == ()
    with pytest.raises(RecordingError, match="no row of any sensor"):
        assemble(Path("walk.csv"), {"accel": np.full((3, 4), np.nan)})


@pytest.mark.parametrize("change", [running, running_from_end_to_end])
def test_running_is_not_another_unit(phone_walk: Rows, change: Callable[[Rows], None]) -> None:
    rows = {name: table.copy() for name, table in phone_walk.items()}
    change(rows)
    assert np.median(np.linalg.norm(rows["accel"][:, 1:], axis=1)) > 20.0
    found = {finding.code for finding in examine({"accel": rows["accel"]})}
    assert not found & {"accel-unit", "accel-scale", "no-gravity"}


def test_rows_are_kept_dropped_and_sorted_and_each_is_counted(phone_walk: Rows) -> None:
    accel = phone_walk["accel"].copy()
    accel[10, 2] = np.nan
    accel = np.insert(accel, 20, accel[20], axis=0)
    baro = phone_walk["baro"].copy()
    baro[[5, 6]] = baro[[6, 5]]
    streams = {"accel": accel, "gyro": phone_walk["gyro"].copy(), "baro": baro}
    log = assemble(Path("walk.csv"), streams, allow_unsorted=("baro",))
    assert log.report.kept["accel"] == 2999
    assert dict(log.report.dropped) == {"accel is not a number": 1, "accel the same row twice": 1}
    assert dict(log.report.mended) == {"baro sorted by time": 1}
    assert not log.rows["accel"].flags.writeable


@pytest.mark.parametrize("strict", [True, False])
def test_a_clock_that_goes_back_is_refused_or_listed(phone_walk: Rows, strict: bool) -> None:
    accel = phone_walk["accel"].copy()
    accel[1500:, 0] -= 7.0
    streams = {"accel": accel, "gyro": phone_walk["gyro"].copy()}
    if strict:
        with pytest.raises(RecordingError, match=r"walk.csv: accel, row 1501: the time goes from 14.99\d* to 8.00"):
            assemble(Path("walk.csv"), streams)
    else:
        log = assemble(Path("walk.csv"), streams, strict=False)
        assert [finding.code for finding in log.findings if finding.severity == "error"] == ["clock-back"]


@pytest.fixture(scope="module")
def corners() -> Rows:
    """A phone held with little tilting around four corners to the left, with the shaking of steps."""
    t_s = np.arange(4000) / 100.0
    yaw = np.interp(t_s, [4, 5.5, 14, 15.5, 24, 25.5, 34, 35.5], np.repeat(np.arange(5) * np.pi / 2, 2)[1:-1])
    swing = 0.04 * np.sin(np.pi * 1.8 * t_s)
    turn = Rotation.from_euler("ZXY", np.column_stack([yaw, 0.6 + swing, 0.5 * swing]))
    rate = np.vstack([(turn[:-1].inv() * turn[1:]).as_rotvec() * 100.0, np.zeros(3)])
    shake = np.outer(np.sin(2 * np.pi * 1.8 * t_s), [0.5, 0.4, 2.0])
    accel = turn.apply(shake + np.array([0.0, 0.0, 9.80665]), inverse=True)
    mag = turn.apply(np.tile([0.0, 22.0, -42.0], (len(t_s), 1)), inverse=True)
    return {name: np.column_stack([t_s, table]) for name, table in (("accel", accel), ("gyro", rate), ("mag", mag))}


@pytest.mark.parametrize(
    ("names", "order", "signs", "expected"),
    [
        (("gyro",), (0, 1, 2), (1, 1, 1), []),
        (("accel", "gyro", "mag"), (2, 0, 1), (1, 1, 1), []),  # another device frame, right-handed
        (("gyro",), (0, 1, 2), (1, 1, -1), [("error", "gyro")]),
        (("gyro",), (1, 0, 2), (1, 1, 1), [("error", "gyro")]),
        (("accel",), (0, 2, 1), (1, 1, 1), [("error", "gyro")]),
        (("gyro",), (0, 1, 2), (-1, -1, -1), [("warning", "gyro")]),  # gravity does not show it: the field does
        (("accel", "gyro", "mag"), (1, 0, 2), (1, 1, 1), [("warning", "gyro")]),
        (("mag",), (0, 1, 2), (-1, 1, 1), [("warning", "gyro")]),  # gravity does not say which of the two
    ],
)
def test_axes_are_judged_by_the_corners_of_a_walk(
    corners: Rows, names: tuple[str, ...], order: tuple[int, ...], signs: tuple[int, ...], expected: list[Any]
) -> None:
    rows = {name: table.copy() for name, table in corners.items()}
    for name in names:
        rows[name][:, 1:] = corners[name][:, 1:][:, order] * signs
    assert [(found.severity, found.where) for found in examine(rows) if found.code == "axes"] == expected


def test_what_follows_from_a_fault_is_not_found_beside_it(phone_walk: Rows) -> None:
    rows = {name: phone_walk[name].copy() for name in SENSORS}
    rows["accel"][:, 1:] *= 1000.0 / 9.80665
    rows["baro"][:, 1] *= 100.0
    assert [found.code for found in examine(rows)] == ["accel-unit", "baro-unit"]
    rows = {name: phone_walk[name].copy() for name in ("accel", "gyro", "rotation")}
    rows["accel"][:, 1:] = [0.0, 5.6, 8.03]
    assert [found.code for found in examine(rows)] == ["constant"]
    rows = {name: phone_walk[name] * ([1e6] + [1.0] * (phone_walk[name].shape[1] - 1)) for name in SENSORS}
    assert [found.code for found in examine(rows)] == ["time-unit"]


@pytest.mark.parametrize(("back_s", "late", "code"), [(4.0, False, "clock-back"), (4.0, True, ""), (0.3, False, "")])
def test_a_clock_that_was_set_back_is_no_batch_that_came_late(
    phone_walk: Rows, back_s: float, late: bool, code: str
) -> None:
    """Rows that come late fill a gap; after a clock was set back there are twice as many as the time can hold."""
    tables = {name: phone_walk[name].copy() for name in ("accel", "gyro")}
    for name, table in tables.items():
        if late:
            tables[name] = np.concatenate([table[:1000], table[1400:1500], table[1000:1400], table[1500:]])
        else:
            table[1500:, 0] -= back_s
    log = assemble(Path("a"), tables, allow_unsorted=("accel", "gyro"), strict=False)
    assert [found.code for found in log.findings] == [code] * bool(code)
    assert (np.diff(log.rows["accel"][:, 0]) >= 0).all()
