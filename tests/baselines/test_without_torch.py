"""Every localizer of pdrbench walks where PyTorch cannot be imported."""

from __future__ import annotations

import subprocess
import sys

from pdrbench_baselines import LOCALIZERS

# A phone, or a shoe, that goes up and down for six seconds in a corridor with a survey, offered everything.
WALK = """
import sys
sys.modules["torch"] = None  # importing it is an error
import numpy as np
from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Observation
from pdrbench.radio import survey_of_readings
from pdrbench.registry import make_localizer
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start, Trajectory
from pdrbench_sim.buildings.assembly import one_room
from dataclasses import replace

rate_hz, count = 100.0, 600
t_s = np.arange(count) / rate_hz
still, swing = np.zeros(count), 3.0 * np.sin(2 * np.pi * 1.8 * t_s) * (t_s > 2.0)
columns = {
    "accel": [still, still, 9.81 + swing], "gyro": [still, still, still], "mag": [still, still + 20.0, still - 40.0],
    "rotation": [still + 1.0, still, still, still],
}
rows = {name: np.column_stack([t_s, *values]) for name, values in columns.items()}
each_s = np.arange(1.0, 7.0)
rows["stride"] = np.column_stack([each_s, np.full(6, 1.2), np.zeros((6, 2))])
rows["position"] = np.column_stack([each_s, each_s, 0 * each_s])
rows["wifi"] = np.column_stack([each_s, np.ones(6), np.full(6, -50.0), np.zeros((6, 2))])
sensors = {name: replace(sensor_spec(name), rate_hz=rate_hz if name in columns else 1.0) for name in rows}
places_m, nothing = np.array([[0.0, 0.0], [10.0, 0.0]]), np.zeros(2, dtype=np.int64)
readings = np.array([[1.0, -50.0, 0.0], [1.0, -70.0, 0.0]])
survey = survey_of_readings(places_m, nothing, np.arange(2), [1, 1], readings, surveyed=True)
start = Start(np.zeros(2), 0, heading_rad=0.0)
hall = one_room("hall", [(-9, -9), (9, -9), (9, 9), (-9, 9)])


def walks(name, mounting):
    localizer = make_localizer(name)
    if hasattr(localizer, "tell"):
        localizer.tell(Trajectory(each_s, np.zeros((6, 2)), np.zeros(6, np.int64), np.ones(6, bool)))
    localizer.reset(Briefing(hall, sensors, 0.5, start, survey, mounting=mounting), np.random.default_rng(0))
    for now_s in np.arange(0.5, 6.5, 0.5):
        due = {name: one[(one[:, 0] > now_s - 0.5) & (one[:, 0] <= now_s)] for name, one in rows.items()}
        assert np.isfinite(localizer.step(Observation(now_s, due)).xy_m).all()
    if hasattr(localizer, "revise"):
        localizer.revise()


for name in sys.argv[1:]:
    try:
        walks(name, "hand")
    except UnsuitableError:
        walks(name, "foot")
    print(name)
"""


def test_all_walk() -> None:
    names = [name for name, target in LOCALIZERS.items() if not target.startswith("renamed:")]
    done = subprocess.run([sys.executable, "-c", WALK, *names], capture_output=True, text=True, check=False)
    assert done.stdout.split() == names, done.stderr
