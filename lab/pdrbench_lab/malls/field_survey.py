"""What the magnetometers of the walks of a mall measured, at its places, parsed once and kept in the cache folder."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.files import bytes_sha256
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.log import Log
from pdrbench.recording import MagneticMap
from pdrbench_envs.malls.surveys import level_of, log_once, parsed_once
from pdrbench_lab.magnetic.level_field import level_field_ut

EVERY_S: Final = 0.4  # over which samples are averaged: half a metre
MIN_SAMPLES: Final = 10  # of the 20 in that time


@dataclass(frozen=True, slots=True)
class Fields:
    """Samples of W walks of one mall, walk by walk.

    Attributes:
        paths: (W,) of the files.
        samples: (W,) int, samples of each walk between its first and its last waypoint.
        xy_m: (S, 2) interpolated between waypoints at the time of each sample.
        field_ut: (S, 3) as in `MagneticMap`.
    """

    paths: tuple[str, ...]
    samples: IntArray
    xy_m: FloatArray
    field_ut: FloatArray

    def magnetic_map(self, paths: Sequence[str]) -> MagneticMap:
        """The survey that some walks make, those without a sample left out."""
        is_walk = np.isin(self.paths, list(paths))
        is_sample = np.repeat(is_walk, self.samples)
        return MagneticMap(
            xy_m=self.xy_m[is_sample],
            level=np.repeat([level_of(path) for path in self.paths], self.samples)[is_sample],
            walk=np.repeat(np.cumsum(is_walk) - 1, self.samples)[is_sample],
            field_ut=self.field_ut[is_sample],
        )


@functools.lru_cache(maxsize=4)
def fields_of(paths: tuple[str, ...]) -> Fields:
    """Samples of some walks, parsed once."""
    code = bytes_sha256([Path(__file__)])
    return Fields(paths, **parsed_once(paths, code, ("samples", "xy_m", "field_ut"), _parsed))


def _parsed(paths: Sequence[str]) -> dict[str, Any]:
    """Samples of each walk (W,), and, walk after walk, their places (S, 2) and fields (S, 3)."""
    by_walk = [samples_of(log_once(path)) for path in paths]
    xy_m, field_ut = (np.concatenate(part) for part in zip(*by_walk, strict=True))
    return {"samples": np.array([len(walk[0]) for walk in by_walk]), "xy_m": xy_m, "field_ut": field_ut}


def samples_of(log: Log) -> tuple[FloatArray, FloatArray]:
    """(S, 2) places and (S, 3) level fields of a walk, between its first and its last waypoint, `EVERY_S` each."""
    way, rotation = log.reference, log.rows.get("rotation", np.zeros((0, 5)))
    mag = log.rows.get("mag", np.zeros((0, 4)))
    if len(way) < 2 or not len(rotation):
        return np.zeros((0, 2)), np.zeros((0, 3))
    mag = mag[(mag[:, 0] >= max(way.t_s[0], rotation[0, 0])) & (mag[:, 0] <= way.t_s[-1])]
    latest = np.searchsorted(rotation[:, 0], mag[:, 0], side="right") - 1
    rows = np.column_stack([mag[:, 0], level_field_ut(rotation[latest, 1:], mag[:, 1:])])
    _, period, count = np.unique((mag[:, 0] - way.t_s[0]) // EVERY_S, return_inverse=True, return_counts=True)
    means = np.column_stack([np.bincount(period, column, len(count)) / count for column in rows.T])
    means = means[count >= MIN_SAMPLES]
    places_m = [np.interp(means[:, 0], way.t_s, axis_m) for axis_m in way.xy_m.T]
    return np.column_stack(places_m), means[:, 1:]
