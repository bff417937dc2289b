"""Thinned copies of generated walks: every k-th row in whole steps, and whether a walk of today agrees with its copy.

python -m pdrbench_sim.thinned write FOLDER ENV/WALK...
python -m pdrbench_sim.thinned check FOLDER ENV/WALK...
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.recording import RadioMap, Recording
from pdrbench.registry import make_task
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_sim.resolution import ANGLE_STEP_RAD, PLACE_STEP_M, STEPS, TIME_STEP_S, mag_step_ut, whole

MAX_ROWS: Final = 200  # of an array that are kept
_WHOLE: Final = 1e-6  # a value is in whole steps if it is that close to one


@dataclass(frozen=True, slots=True)
class Agreement:
    """How a walk compares with its copy.

    Attributes:
        values: That were compared.
        other: Of them, those that are another whole number.
        most: By so many steps at most.
        wrong: What is not in whole steps, or has another number of rows.
    """

    values: int
    other: int
    most: int
    wrong: tuple[str, ...]


def arrays(task: Task, walk: str) -> dict[str, tuple[FloatArray, tuple[float | None, ...]]]:
    """Everything that a generated walk hands out, briefs and scores.

    Returns:
        By name (rows, columns), and the step of each column: None where an inertial unit has its own.
    """
    recording = task.load(walk)
    found = {
        f"stream {name}": (stream.rows, tuple(_step_of(name, column, recording) for column in stream.spec.columns))
        for name, stream in recording.streams.items()
    }
    found["reference"] = _reference(recording)
    if task.start != "unknown":
        found["start"] = _start(task.tell_start(recording))
    if task.dataset is not None:  # a published plan, and a survey of all of it
        return found
    if (radio_map := task.radio_map(recording)) is not None:
        found |= _survey(radio_map)
    if (building := recording.building) is not None:
        corners = np.column_stack([building.edge_start_xy_m, building.height(building.edge_polygon)])
        found["building"] = corners, (PLACE_STEP_M,) * 3
    return found


def _step_of(sensor: str, column: str, recording: Recording) -> float | None:
    if column == "t_s" or sensor not in ("accel", "gyro", "mag"):
        return STEPS.get(column, 1.0)
    return mag_step_ut(recording.mounting) if sensor == "mag" else None


def _reference(recording: Recording) -> tuple[FloatArray, tuple[float | None, ...]]:
    way = recording.reference
    columns: list[tuple[FloatArray, float]] = [(way.t_s, TIME_STEP_S)]
    columns += [(way.xy_m[:, 0], PLACE_STEP_M), (way.xy_m[:, 1], PLACE_STEP_M)]
    columns += [(way.level.astype(np.float64), 1.0), (way.surveyed.astype(np.float64), 1.0)]
    columns += [(way.heading_rad, ANGLE_STEP_RAD)] if way.heading_rad is not None else []
    columns += [(way.z_m, PLACE_STEP_M)] if way.z_m is not None else []
    return np.column_stack([values for values, _ in columns]), tuple(step for _, step in columns)


def _start(start: Start) -> tuple[FloatArray, tuple[float | None, ...]]:
    heading_rad = 0.0 if start.heading_rad is None else start.heading_rad
    return np.array([[*start.xy_m, heading_rad, start.radius_m]]), (*(PLACE_STEP_M,) * 2, ANGLE_STEP_RAD, PLACE_STEP_M)


def _survey(radio_map: RadioMap) -> dict[str, tuple[FloatArray, tuple[float | None, ...]]]:
    readings = np.column_stack([radio_map.access_point, radio_map.rssi_dbm, radio_map.age_s])
    places = np.column_stack([radio_map.xy_m, radio_map.level])
    return {
        "survey readings": (readings, (1.0, STEPS["rssi_dbm"], STEPS["age_s"])),
        "survey places": (places, (PLACE_STEP_M, PLACE_STEP_M, 1.0)),
    }


def copy_of(task: Task, walk: str) -> dict[str, dict[str, Any]]:
    """A walk as plain numbers: of each array the number of rows, every k-th of them in whole steps, and the steps."""
    copied = {}
    for name, (rows, known) in arrays(task, walk).items():
        steps = [_found_step(column) if step is None else step for column, step in zip(rows.T, known, strict=True)]
        every = max(1, math.ceil(len(rows) / MAX_ROWS))
        columns = [whole(column[::every], step) for column, step in zip(rows.T, steps, strict=True)]
        copied[name] = {
            "rows": len(rows),
            "every": every,
            "steps": steps,
            "columns": [[int(value) for value in column] for column in columns],
        }
    return copied


def _found_step(column: FloatArray) -> float:
    """The step of numbers that are whole multiples of it: the smallest difference of two of them."""
    gaps = np.diff(np.unique(column))
    smallest = float(gaps[gaps > _WHOLE * max(float(np.abs(column).max()), 1e-9)].min())
    return float(np.median(gaps[np.abs(gaps - smallest) < 0.01 * smallest]))


def agreement(task: Task, walk: str, copied: Mapping[str, Mapping[str, Any]]) -> Agreement:
    """Compares a walk with its copy."""
    now = arrays(task, walk)
    wrong = [f"{name} is new or missing" for name in sorted(now.keys() ^ copied.keys())]
    values, other, most = 0, 0, 0
    for name, stored in copied.items():
        rows = now[name][0] if name in now else np.zeros((0, 0))
        if len(rows) != stored["rows"]:
            wrong.append(f"{name} has {len(rows)} rows, its copy is of {stored['rows']}")
            continue
        for number, (column, step) in enumerate(zip(stored["columns"], stored["steps"], strict=True)):
            kept = rows[:: stored["every"], number]
            off = np.abs(whole(kept, step) - np.array(column, dtype=np.float64))
            if (np.abs(kept / step - whole(kept, step)) > _WHOLE * np.maximum(1.0, np.abs(kept / step))).any():
                wrong.append(f"{name}, column {number}, is not in whole steps of {step:g}")
            values, other, most = values + len(off), other + int((off > 0).sum()), max(most, int(off.max(initial=0)))
    return Agreement(values, other, most, tuple(wrong))


def _by_env(names: Iterable[str]) -> Iterator[tuple[str, list[str]]]:
    walks: dict[str, list[str]] = {}
    for name in names:
        env, _, walk = name.partition("/")
        walks.setdefault(env, []).append(walk)
    yield from walks.items()


def main(arguments: Sequence[str]) -> None:
    """The command of this module; `check` prints a JSON object of agreements by environment and walk."""
    action, folder, *names = arguments
    found: dict[str, Any] = {}
    for env, walks in _by_env(names):
        task, path = make_task(env), Path(folder) / f"{env}.json"
        if action == "write":
            text = json.dumps({walk: copy_of(task, walk) for walk in walks}, separators=(",", ":"))
            path.write_text(text.replace('"stream', '\n"stream') + "\n", encoding="utf-8")
            continue
        stored = json.loads(path.read_text(encoding="utf-8"))
        for walk in walks:
            one = agreement(task, walk, stored[walk])
            found[f"{env}/{walk}"] = {
                "values": one.values,
                "other": one.other,
                "most": one.most,
                "wrong": list(one.wrong),
            }
    print(json.dumps(found))  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1:])
