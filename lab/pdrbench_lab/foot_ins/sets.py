"""All feet that the foot filter is judged by: every recorded set, and people with five simulated units.

A set is what is left out at once: one batch of units, one place, one group of people.
"""

from __future__ import annotations

import io
import lzma
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from pdrbench.datasets import is_available
from pdrbench.datasets.folders import data_folders
from pdrbench.inertial import LITERAL, navigate
from pdrbench.trajectory import Trajectory
from pdrbench_lab.foot_ins.experiments import FootWalk, rmse_m, walk_of, walks_of
from pdrbench_lab.readers import foot_loops
from pdrbench_lab.realism.foot_walks import FootProtocol, foot_walk
from pdrbench_sim.foot.site import INSTEP, SOLE, FootSite
from pdrbench_sim.foot.style import SwingParams
from pdrbench_sim.units.device import draw_unit
from pdrbench_sim.units.profiles import ImuProfile, imu_profile

GAITMAP_HZ: Final = 204.8
GAITMAP_CAPTURE_HZ: Final = 100.0
LAGS_S: Final = np.linspace(-0.5, 0.5, 21)  # of the two clocks of `foot_gaitmap`, which start together to half a second
RECORDED: Final[Mapping[str, Mapping[str, tuple[tuple[str, str], ...]]]] = MappingProxyType(
    {
        "captures 2017": {"slow": (("foot_vicon", "2017"),), "fast": (("foot_vicon_2", "2017"),)},
        "captures 2018": {"lifts": (("foot_vicon_2", "2018-02-09"),), "crawl": (("foot_vicon_2", "2018-02-22"),)},
        "walks": {"first": (("foot_stride_gcp", ""),), "second": (("foot_stride_gcp_2", ""),)},
        "loops": {"loops": (("foot_loops", ""),)},
        "short": {"short": (("foot_short", ""),)},
        "both feet": {"both feet": (("foot_dual", ""),)},
    }
)


class Unit(NamedTuple):
    """A simulated unit: its kind, what is changed of it, and where it sits."""

    kind: str
    rate_hz: float
    noise: float  # of the gyroscope, over that of the kind
    range_radps: float
    bandwidth_hz: float  # of both sensors
    scale: float  # of the gyroscope
    lag_samples: int  # of the gyroscope behind the accelerometer
    site: FootSite

    def profile(self) -> ImuProfile:
        """Its errors."""
        kind = imu_profile(self.kind)
        return replace(
            kind,
            rate_hz=self.rate_hz,
            gyro=replace(
                kind.gyro,
                density=self.noise * kind.gyro.density,
                limit=self.range_radps,
                bandwidth_hz=self.bandwidth_hz,
                scale_sigma=0.0,
            ),
            accel=replace(kind.accel, bandwidth_hz=self.bandwidth_hz),
        )


UNITS: Final[Mapping[str, Unit]] = MappingProxyType(
    {
        "unit 1": Unit("3dm-gx3", 200.0, 1.0, math.radians(1200), 95.0, 1.0, 0, INSTEP),
        "unit 2": Unit("mtx18", 100.0, 2.0, math.radians(1200), 40.0, 1.0, 0, INSTEP),
        "unit 3": Unit("mtx18", 200.0, 1.0, math.radians(500), 60.0, 1.01, 0, INSTEP),
        "unit 4": Unit("3dm-gx3", 250.0, 2.0, math.radians(1000), 110.0, 0.99, 1, SOLE),
        "unit 5": Unit("mtx18", 204.8, 1.0, math.radians(2000), 50.0, 1.0, 1, INSTEP),
    }
)
# Soft shoes ring little and give; stiff ones ring.
SHOES: Final = {
    "soft": SwingParams(knock_lever_m=0.04, run_knock=1.0, creep_m=(0.03, 0.018)),
    "stiff": SwingParams(run_knock=1.6, creep_m=(0.01, 0.01)),
}
SPEEDS_MPS: Final = (0.9, 1.3, 1.6, 2.8)  # the last one runs


def all_sets(*, simulated: bool = True) -> dict[str, dict[str, tuple[FootWalk, ...]]]:
    """Walks by set and part, of what is available."""
    found: dict[str, dict[str, tuple[FootWalk, ...]]] = {}
    for name, parts in RECORDED.items():
        for part, sources in parts.items():
            walks = tuple(walk for source in sources for walk in _starting(*source))
            if walks:
                found.setdefault(name, {})[part] = walks
    for folder in _unregistered("foot_loops_2"):
        more = tuple(walk_of(path, foot_loops.read) for path in sorted(folder.rglob("data_inert.txt")))
        found["loops"]["loops"] = (*found.get("loops", {}).get("loops", ()), *more)
    for folder in _unregistered("foot_gaitmap"):
        found["gaitmap"] = {"gaitmap": gaitmap(folder)}
    if simulated:
        found |= {name: {"simulated": simulated_walks(name)} for name in UNITS}
    return found


def _starting(dataset: str, beginning: str) -> list[FootWalk]:
    """The walks of a set whose file begins so; none where it is not available."""
    if not is_available(dataset):
        return []
    return [walk for walk in walks_of(dataset) if walk.path.name.startswith(beginning)]


def _unregistered(name: str) -> list[Path]:
    """Where a set lies that no environment plays."""
    return [place / name for place in data_folders() if (place / name).is_dir()][:1]


def gaitmap(folder: Path) -> tuple[FootWalk, ...]:
    """Both feet of `foot_gaitmap` under motion capture of their heels; the lag is where fits best."""
    samples = _table(folder / "imu_sample.csv.xz")
    heels = _table(folder / "mocap_sample.csv.xz")
    walks = []
    for side in ("left", "right"):
        columns = [(f"{side}_sensor", f"{kind}_{axis}") for kind in ("acc", "gyr") for axis in "xyz"]
        values = samples[columns].to_numpy(np.float64)
        t_s = np.arange(len(values)) / GAITMAP_HZ
        place_m = heels[[(f"{side[0].upper()}_FCC", axis) for axis in "xyz"]].to_numpy(np.float64) / 1000
        place_m, known = place_m[1:-1], np.isfinite(place_m[1:-1]).all(axis=1)
        place_m, at_s = place_m[known], (1 + np.flatnonzero(known)) / GAITMAP_CAPTURE_HZ
        states = navigate(t_s, values[:, :3], np.radians(values[:, 3:]), LITERAL)
        tried = []
        for lag_s in LAGS_S:
            inside = (at_s + lag_s > states.t_s[0]) & (at_s + lag_s < states.t_s[-1])
            reference = Trajectory(
                at_s[inside] + lag_s,
                place_m[inside, :2],
                np.zeros(np.count_nonzero(inside), dtype=np.int64),
                np.ones(np.count_nonzero(inside), dtype=np.bool_),
                z_m=place_m[inside, 2],
            )
            walk = FootWalk(folder / side, t_s, values[:, :3], np.radians(values[:, 3:]), reference)
            tried.append((rmse_m(states, reference), walk))
        walks.append(min(tried, key=lambda one: one[0])[1])
    return tuple(walks)


def _table(path: Path) -> pd.DataFrame:
    return pd.read_csv(io.BytesIO(lzma.decompress(path.read_bytes())), header=[0, 1], index_col=0)


def simulated_walks(name: str) -> tuple[FootWalk, ...]:
    """Closed walks of people with one of `UNITS`: in soft and in stiff shoes, slow to running."""
    unit = UNITS[name]
    rng = np.random.default_rng([20261129, list(UNITS).index(name)])
    walks = []
    for shoe, params in SHOES.items():
        for speed_mps, stream in zip(SPEEDS_MPS, rng.spawn(len(SPEEDS_MPS)), strict=True):
            protocol = FootProtocol((6.0, 9.0), (12.0, 20.0), 1.0, (60.0, 70.0), (speed_mps,) * 2, (2.0, 3.0), "mtx18")
            for_motion, for_unit, for_noise = stream.spawn(3)
            motion = foot_walk(for_motion, replace(protocol, site=unit.site), params=params).motion
            device = draw_unit(unit.profile(), for_unit)
            ideal = motion.ideal_signals()
            t_s, accel, gyro = device.measure(motion.t_s, ideal[0], unit.scale * ideal[1], for_noise)
            lag = unit.lag_samples
            last = len(t_s) - lag
            every = slice(None, None, max(1, round(len(motion.t_s) / (motion.t_s[-1] - motion.t_s[0]) / 50)))
            place_m = motion.xyz_m[every]
            reference = Trajectory(
                motion.t_s[every],
                place_m[:, :2],
                np.zeros(len(place_m), dtype=np.int64),
                np.ones(len(place_m), dtype=np.bool_),
                z_m=place_m[:, 2],
            )
            walks.append(FootWalk(Path(f"{name} {shoe} {speed_mps:g}"), t_s[lag:], accel[lag:], gyro[:last], reference))
    return tuple(walks)
