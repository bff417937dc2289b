"""Figures of a network on whole walks of environments: legs between surveyed places, distances, turns, coverage."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.inertial.step_detection import StepDetector
from pdrbench.localizer import Briefing
from pdrbench.recording import Recording, SensorStream
from pdrbench_baselines.learned.reckoning import EVERY_S, Reckoner, WindowNetwork
from pdrbench_baselines.learned.row_checks import SENSORS
from pdrbench_baselines.li2012.localizer import GENERIC
from pdrbench_lab.learned.data import EDGE_S, bent_way
from pdrbench_lab.learned.measure import LEVELS, WALKS_M
from pdrbench_lab.learned.recordings import is_dense
from pdrbench_lab.papers.li2012.model import walked_m

CHUNK_S: Final = 1.0
# Ours: standard deviation of the Gaussian that keeps the motion of the body, with 0.02 of 1.8 Hz; the rest is shaking.
SLOW_S: Final = 0.25
SHORTEST_M: Final = 5.0  # of what is known of a walk: relative errors of less say nothing
USED: Final = (*SENSORS, "mag")


@dataclass(frozen=True, slots=True)
class Reckoned:
    """What a network estimates of one walk.

    Attributes:
        end_s: (K,) when each second ended.
        move_m: (K, 2).
        covariance_m2: (K, 2, 2).
    """

    end_s: FloatArray
    move_m: FloatArray
    covariance_m2: FloatArray

    def at(self, t_s: FloatArray) -> FloatArray:
        """(T, 2) where the walk has come to since its beginning."""
        knots_s = np.concatenate([[self.end_s[0] - EVERY_S], self.end_s])
        path_m = np.concatenate([np.zeros((1, 2)), np.cumsum(self.move_m, axis=0)])
        return np.column_stack([np.interp(t_s, knots_s, one) for one in path_m.T])


def reckon(network: WindowNetwork, recording: Recording) -> Reckoned:
    """Plays a recording to a network."""
    names = [name for name in USED if name in recording.streams]
    specs = {name: recording.streams[name].spec for name in names}
    reckoner = Reckoner(network, Briefing(None, specs, CHUNK_S, subject=recording.subject, mounting=recording.mounting))
    rows = {name: recording.streams[name].rows for name in names}
    last_s = max(float(one[-1, 0]) for one in rows.values())
    moves = []
    for until_s in np.arange(CHUNK_S, last_s + CHUNK_S, CHUNK_S).tolist():
        new = {name: one[(one[:, 0] > until_s - CHUNK_S) & (one[:, 0] <= until_s)] for name, one in rows.items()}
        moves += list(reckoner.update(new))
    return Reckoned(
        np.array([move.end_s for move in moves]),
        np.array([move.move_m for move in moves]),
        np.array([move.covariance_m2 for move in moves]),
    )


def mirrored(recording: Recording) -> Recording:
    """Left for right: what the same phone would measure on the same way in a mirrored building; x becomes -x.

    Rates and the axis of a rotation are axial vectors: they keep x and change the sign of y and z.
    """
    signs = {"accel": [1, -1, 1, 1], "gyro": [1, 1, -1, -1], "rotation": [1, 1, 1, -1, -1]}
    streams = {
        name: SensorStream(recording.streams[name].spec, recording.streams[name].rows * signs[name]) for name in signs
    }
    way = recording.reference
    reference = replace(way, xy_m=way.xy_m * [-1, 1], heading_rad=None)
    return replace(recording, building=None, streams=streams, reference=reference)


def gentler(recording: Recording, factor: float, gyro_factor: float | None = None) -> Recording:
    """The same walk with its shaking multiplied: what is faster than `SLOW_S`, at the same steps on the same way.

    Args:
        recording: Of a phone.
        factor: Of the specific force.
        gyro_factor: Of the rates; None for the root of `factor`, as a softer hand turns the phone less, too.
    """
    factors = {"accel": factor, "gyro": math.sqrt(factor) if gyro_factor is None else gyro_factor}
    streams = dict(recording.streams)
    for name, by in factors.items():
        rows = streams[name].rows.copy()
        apart_s = max(float(np.median(np.diff(rows[:, 0]))), 1e-3)
        slow = gaussian_filter1d(rows[:, 1:], SLOW_S / apart_s, axis=0, mode="nearest")
        rows[:, 1:] = slow + by * (rows[:, 1:] - slow)
        streams[name] = SensorStream(streams[name].spec, rows)
    return replace(recording, streams=streams)


def without_rotation(recording: Recording) -> Recording:
    """The same walk by a phone that reports no rotation vector."""
    return replace(recording, streams={name: one for name, one in recording.streams.items() if name != "rotation"})


def place_errors_m(network: WindowNetwork, recordings: Iterable[Recording]) -> tuple[FloatArray, FloatArray]:
    """Errors at the surveyed places of walks.

    Returns:
        legs_m: (L,) by how much the end of each leg is missed, begun at the place before.
        places_m: (P,) by how much places are missed when a walk begins at the first and nothing else is known.
    """
    errors: list[tuple[FloatArray, FloatArray]] = []
    for recording in recordings:
        way = recording.reference
        found_m = reckon(network, recording).at(way.t_s)
        legs_m = np.hypot(*(np.diff(found_m, axis=0) - np.diff(way.xy_m, axis=0)).T)
        errors.append((legs_m, np.hypot(*((found_m - found_m[0]) - (way.xy_m - way.xy_m[0]))[1:].T)))
    legs, places = zip(*errors, strict=True)
    return np.concatenate(legs), np.concatenate(places)


def walk_figures(
    network: WindowNetwork,
    recordings: Iterable[Recording],
    changed: Callable[[Recording], Recording] = lambda walk: walk,
) -> dict[str, float]:
    """Means over walks; where places are rare, over the legs that were walked straight, see `bent_way`.

    Args:
        network: Is asked.
        recordings: With the places and steps that it is measured by.
        changed: Makes of each the recording that it is given.

    Returns:
        `distance_pct`, the mean relative error of the distance walked, `bias_pct` with its sign; `generic_pct`, that of
        a step model which is the same for every person; `turn_p95_deg`, 95 % of the errors of the change of heading
        from one second to the next; `sigma_m`, the mean standard deviation per axis that is stated for a second;
        `coverage_50_pct`, `coverage_90_pct`, `coverage_95_pct` of displacements in a second.
    """
    return reckoned_figures((recording, reckon(network, changed(recording))) for recording in recordings)


def reckoned_figures(walks: Iterable[tuple[Recording, Reckoned]]) -> dict[str, float]:
    """The figures of `walk_figures`, of walks and what was estimated of each."""
    own, generic, turns, squares, sigmas_m = [], [], [], [], []
    for recording, found in walks:
        way, known_s = recording.reference, None
        if not is_dense(recording):
            way, known_s = bent_way(recording)
        knots_s = np.concatenate([[found.end_s[0] - EVERY_S], found.end_s])
        knots_s = knots_s[knots_s <= way.t_s[-1]]
        place_m = np.column_stack([np.interp(knots_s, way.t_s, one) for one in way.xy_m.T])
        true_m, move_m = np.diff(place_m, axis=0), found.move_m[: len(knots_s) - 1]
        known = np.ones(len(true_m), dtype=np.bool_)
        if known_s is not None:
            inside = (knots_s[:-1, None] >= known_s[:, 0] + EDGE_S) & (knots_s[1:, None] <= known_s[:, 1] - EDGE_S)
            known = inside.any(axis=1)
        spans_s = np.column_stack([knots_s[:-1], knots_s[1:]])[known]
        length_m = float(np.sum(walked_m(way, spans_s[:, 0], spans_s[:, 1])))
        if length_m < SHORTEST_M:
            continue
        true_m, move_m = true_m[known], move_m[known]
        own.append(100.0 * (float(np.hypot(*move_m.T).sum()) / length_m - 1.0))
        generic.append(100.0 * abs(generic_length_m(recording, spans_s) / length_m - 1.0))
        turns.append(_turn_errors_rad(move_m, true_m))
        error_m = (true_m - move_m)[:, :, None]
        covariance_m2 = found.covariance_m2[: len(known)][known]
        sigmas_m.append(np.sqrt(np.trace(covariance_m2, axis1=1, axis2=2) / 2))
        squares.append((error_m * np.linalg.solve(covariance_m2, error_m)).sum(axis=(1, 2)))
    held = np.concatenate(squares)
    figures = {
        "distance_pct": float(np.mean(np.abs(own))),
        "bias_pct": float(np.mean(own)),
        "generic_pct": float(np.mean(generic)),
        "turn_p95_deg": math.degrees(float(np.percentile(np.concatenate(turns), 95))),
    }
    figures["sigma_m"] = float(np.mean(np.concatenate(sigmas_m)))
    for level in LEVELS:
        figures[f"coverage_{100 * level:.0f}_pct"] = 100.0 * float(np.mean(held <= -2.0 * math.log(1.0 - level)))
    return figures


def generic_length_m(recording: Recording, spans_s: FloatArray) -> float:
    """How far a walk is within spans (K, 2) by a f + b, one model for all people (Li et al. 2012, L14)."""
    stream = recording.streams["accel"]
    steps = StepDetector(stream.spec.rate_hz or 50.0).update(stream.rows)
    during = ((steps.end_s[:, None] > spans_s[:, 0]) & (steps.end_s[:, None] <= spans_s[:, 1])).any(axis=1)
    return float(sum(GENERIC.length_m(frequency_hz) for frequency_hz in steps.frequency_hz[during].tolist()))


def _turn_errors_rad(move_m: FloatArray, true_m: FloatArray) -> FloatArray:
    """(K,) absolute, wherever the person walks in two consecutive seconds."""
    walks = np.hypot(*true_m.T) > WALKS_M
    both = walks[1:] & walks[:-1]
    turns = [np.diff(np.arctan2(one[:, 1], one[:, 0]))[both] for one in (move_m, true_m)]
    errors: FloatArray = np.abs(wrap_rad(turns[0] - turns[1]))
    return errors
