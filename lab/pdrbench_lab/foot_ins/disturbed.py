"""What the foot filter makes of worse sensors: real recordings with clipped rates, a wrong scale, a low rate, gaps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pdrbench.inertial import FootParams
from pdrbench.inertial.zero_velocity import nominal_rate_hz
from pdrbench_lab.foot_ins.experiments import FootWalk
from pdrbench_lab.foot_ins.left_out import available_walks, measured
from pdrbench_lab.reproduce.reproduction import Claim, mean_over_walks

RANGE_RADPS: Final = math.radians(300.0)
SCALE: Final = 1.01
LOW_RATE_HZ: Final = 50.0
NUM_GAPS, GAP_S = 5, 0.1
GROUPS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "captured walks and runs": ("capture", "capture_fast"),
        "walks and runs with places": ("walks", "walks_2"),
        "loops": ("loops",),
        "both feet": ("dual",),
    }
)


def clipped(walk: FootWalk) -> FootWalk:
    """The gyroscope ends at 300 degrees/s."""
    return replace(walk, gyro=np.clip(walk.gyro, -RANGE_RADPS, RANGE_RADPS))


def scaled(walk: FootWalk) -> FootWalk:
    """The gyroscope shows 1 % too much."""
    return replace(walk, gyro=SCALE * walk.gyro)


def thinned(walk: FootWalk) -> FootWalk:
    """Every n-th sample, about 50 a second, and no filter before that."""
    rows = slice(None, None, max(1, round(nominal_rate_hz(walk.t_s) / LOW_RATE_HZ)))
    return replace(walk, t_s=walk.t_s[rows], accel=walk.accel[rows], gyro=walk.gyro[rows])


def with_gaps(walk: FootWalk) -> FootWalk:
    """Five gaps of 0.1 s, one in each fifth of the middle four fifths of the walk."""
    rng, first_s, lasts_s = np.random.default_rng(len(walk.t_s)), walk.t_s[0], walk.t_s[-1] - walk.t_s[0]
    parts = 0.1 + 0.8 * (np.arange(NUM_GAPS) + rng.uniform(0.1, 0.9, NUM_GAPS)) / NUM_GAPS
    since_s = walk.t_s[:, None] - (first_s + lasts_s * parts)
    kept = ~((since_s >= 0) & (since_s < GAP_S)).any(axis=1)
    return replace(walk, t_s=walk.t_s[kept], accel=walk.accel[kept], gyro=walk.gyro[kept])


DISTURBED: Final[Mapping[str, tuple[str, Callable[[FootWalk], FootWalk]]]] = MappingProxyType(
    {
        "clipped": ("rates end at 300°/s", clipped),
        "scaled": ("scale of the gyroscope +1 %", scaled),
        "thinned": ("50 Hz", thinned),
        "gaps": ("five gaps of 0.1 s", with_gaps),
    }
)


def disturbed(seed: int) -> dict[str, Any]:
    """Error and ANEES of every walk as of `left_out`, by disturbance and group; the settings stay."""
    strata, walks = available_walks()
    found: dict[str, Any] = {}
    for name, (_, disturb) in DISTURBED.items():
        changed = [[disturb(walk) for walk in group] for group in walks]
        scores = dict(zip((stratum.name for stratum in strata), measured(changed, FootParams()), strict=True))
        for group, members in GROUPS.items():
            rows = [scores[member] for member in members if member in scores]
            for index, suffix in enumerate(("", "_nees")):
                found[f"{name}_{group}{suffix}"] = np.concatenate([np.zeros(0), *(row[index] for row in rows)])
    return found


CLAIMS: Final = tuple(
    Claim(
        *("F7", f"{said}; {group}: {what}", "not stated", "disturbed"),
        *(mean_over_walks(f"{name}_{group}{suffix}"), None, unit),
    )
    for name, (said, _) in DISTURBED.items()
    for group in GROUPS
    for suffix, what, unit in (
        ("", "mean closure" if group == "loops" else "mean error", "%" if group == "loops" else "m"),
        ("_nees", "ANEES", ""),
    )
)
