"""Thinned copies of generated walks: every k-th row in whole steps, and whether a walk of today agrees with its copy.

python tests/samples/thinned.py write FOLDER ENV/WALK...
python tests/samples/thinned.py check FOLDER ENV/WALK...
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.recording import RadioMap, Recording
from pdrbench.registry import make_task
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_sim.resolution import ANGLE_STEP_RAD, PLACE_STEP_M, STEPS, TIME_STEP_S, mag_step_ut, whole

Columns = tuple[FloatArray, tuple[float | None, ...]]  # (rows, columns), and the step of each column

MAX_ROWS: Final = 200  # of an array that are kept
MAX_OTHER: Final = 1e-5  # fraction of values that may be another whole number, by one step
_WHOLE: Final = 1e-6  # a value is in whole steps if it is that close to one


def arrays(task: Task, walk: str) -> dict[str, Columns]:
    """All that a generated walk hands out, briefs and scores; a step is None where an inertial unit has its own."""
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


def _reference(recording: Recording) -> Columns:
    way = recording.reference
    columns: list[tuple[FloatArray, float]] = [(way.t_s, TIME_STEP_S)]
    columns += [(way.xy_m[:, 0], PLACE_STEP_M), (way.xy_m[:, 1], PLACE_STEP_M)]
    columns += [(way.level.astype(np.float64), 1.0), (way.surveyed.astype(np.float64), 1.0)]
    columns += [(way.heading_rad, ANGLE_STEP_RAD)] if way.heading_rad is not None else []
    columns += [(way.z_m, PLACE_STEP_M)] if way.z_m is not None else []
    return np.column_stack([values for values, _ in columns]), tuple(step for _, step in columns)


def _start(start: Start) -> Columns:
    heading_rad = 0.0 if start.heading_rad is None else start.heading_rad
    return np.array([[*start.xy_m, heading_rad, start.radius_m]]), (*(PLACE_STEP_M,) * 2, ANGLE_STEP_RAD, PLACE_STEP_M)


def _survey(radio_map: RadioMap) -> dict[str, Columns]:
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


def agreement(task: Task, walk: str, copied: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Compares a walk with its copy.

    Returns:
        How many "values" were compared, how many of them are an "other" whole number, by how many steps at "most", and
        what is "wrong": not in whole steps, or of another number of rows.
    """
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
    return {"values": values, "other": other, "most": most, "wrong": wrong}


def check(folder: Path, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """The agreement of each ENV/WALK with its copy."""
    return {
        name: agreement(make_task(env), walk, json.loads((folder / f"{env}.json").read_text(encoding="utf-8"))[walk])
        for name in names
        for env, _, walk in [name.partition("/")]
    }


def check_elsewhere(folder: Path, names: Iterable[str], variables: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """`check` in a child process with other variables of the environment; empty ones are left as they are."""
    command = [sys.executable, __file__, "check", str(folder), *names]
    environment = os.environ | {name: value for name, value in variables.items() if value}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found: dict[str, dict[str, Any]] = json.loads(done.stdout)
    return found


def assert_same(found: Mapping[str, Mapping[str, Any]]) -> None:
    """Walks are their copies, but for the few values that lie on the edge of a step."""
    assert {walk: one["wrong"] for walk, one in found.items() if one["wrong"]} == {}
    values, other = (sum(one[name] for one in found.values()) for name in ("values", "other"))
    assert values > 2000 * len(found)
    assert other <= math.ceil(MAX_OTHER * values), found
    assert max(one["most"] for one in found.values()) <= 1


def main(action: str, folder: str, *names: str) -> None:
    """The command of this file; `check` prints agreements as JSON."""
    if action == "check":
        print(json.dumps(check(Path(folder), names)))
        return
    walks: dict[str, list[str]] = {}
    for env, _, walk in (name.partition("/") for name in names):
        walks.setdefault(env, []).append(walk)
    for env, of_env in walks.items():
        text = json.dumps({walk: copy_of(make_task(env), walk) for walk in of_env}, separators=(",", ":"))
        (Path(folder) / f"{env}.json").write_text(text.replace('"stream', '\n"stream') + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
