"""Blocks of the scorecard on the foot: its signals, what the filter makes of them, and integration without aid."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import LITERAL, navigate
from pdrbench.io.log import Log
from pdrbench.trajectory import Trajectory
from pdrbench_lab.realism.block import (
    Block,
    Control,
    Distribution,
    Figure,
    Part,
    RealismStatistic,
    Values,
    Within,
    clustered,
    statistics,
)
from pdrbench_lab.realism.classifier import PERSON
from pdrbench_lab.realism.foot_statistics import (
    LOOPS,
    ON_INSTEP,
    WALKING_MPS,
    FootSignals,
    closures_pct,
    foot_signals,
    free_error_m,
    inertial_columns,
    recorded_logs,
)
from pdrbench_lab.realism.foot_walks import FootProtocol, SyntheticFootWalk, draw_walker, foot_walk
from pdrbench_lab.stride_errors.error_file import read_error_file
from pdrbench_lab.stride_errors.stride_errors import (
    MAX_SPEED_MPS,
    MIN_STRIDES,
    WalkErrors,
    at_places,
    at_rests,
    stride_errors,
    summarise,
)
from pdrbench_sim.foot.shape import gait_shape
from pdrbench_sim.foot.site import INSTEP, SOLE
from pdrbench_sim.foot.style import SwingParams, draw_foot_style

# As the sets that judge were recorded: docs of `FootVicon-v1` and `FootLoops-v1`.
ROOM: Final = FootProtocol(
    width_m=(2.0, 3.0),  # a room of some three by three metres
    depth_m=(2.0, 3.0),
    corner_m=0.6,
    distance_m=(12.0, 35.0),
    speed_mps=(0.5, 1.3),  # 0.3 to 1.4 m/s; walks that fast in a small room are few
    still_s=(1.5, 3.0),
    device="3dm-gx3-25b",
)
LOOP: Final = FootProtocol(
    width_m=(9.0, 11.0),
    depth_m=(30.0, 33.0),
    corner_m=1.0,
    distance_m=(81.0, 89.0),
    speed_mps=(1.2, 1.55),  # 5 km/h
    still_s=(3.0, 5.0),
    device="3dm-gx3",
    site=SOLE,
)
MINUTE: Final = replace(
    LOOP, distance_m=(75.0, 85.0), speed_mps=(1.0, 1.3), still_s=(60.0, 61.0), device="mtx", site=INSTEP
)
WALKS_OF_PERSON: Final = {False: 5, True: 2}  # synthetic, on the instep and in the sole
LOOPS_OF_PERSON: Final = 3
WALKS_OF_SET: Final = 21  # recorded walks under motion capture with strides
SLOW_MPS: Final = (0.5, 0.8)  # of slow strides
_SMOOTH_CYCLES: Final = 6  # a stride without its heel strike
_FREE_S: Final = 60.0  # W20
_DRAWS: Final = 2  # of the intervals of `summarise`, which are not used here
ERRORS: Final = ("length_bias", "length_sigma", "height_sigma", "drift_size_median", "drift_sigma", "heading_residual")
GATE: Final = 0.3  # of the measured error model


# Signals.


def _real_signals(part: Part) -> Values:
    """Of the people to judge by; a classifier may learn from those that parameters were fitted on as well."""
    people, fitted = (
        [_signals(map(inertial_columns, recorded_logs([source]))) for source in ON_INSTEP[which]]
        for which in (part, "fit" if part == "judge" else "judge")
    )
    loops = [_signals(map(inertial_columns, recorded_logs(LOOPS[part])))]
    return {**_signal_values(people, loops), **walk_features(people, fitted)}


def _signals(walks: Iterable[tuple[FloatArray, FloatArray, FloatArray]]) -> list[FootSignals]:
    """Of the walks that have strides: some trials are shuffles from one place to the next."""
    found = []
    for walk in walks:
        try:
            found.append(foot_signals(*walk))
        except RecordingError:
            continue
    return found


def _synthetic_signals(seed: int, count: int, *, has_strike: bool = True) -> Values:
    """Values of `count` people, each with walks in a room and on a loop."""
    rooms, loops = (
        [_signals(_walks(np.random.default_rng([seed, person]), protocol, has_strike)) for person in range(count)]
        for protocol in (ROOM, LOOP)
    )
    return {**_signal_values(rooms, loops), **walk_features(rooms)}


def _walks(
    rng: np.random.Generator, protocol: FootProtocol, has_strike: bool
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Some walks of one person with one unit."""
    for_walker, for_walks = rng.spawn(2)
    walker = draw_walker(for_walker, protocol.device)
    params, gaits = SwingParams(), None
    if not has_strike:
        walk, run = (gait_shape(gait).smoothed(_SMOOTH_CYCLES) for gait in ("walk", "run"))
        params, gaits = replace(params, knocks=()), (walk, run)
    for stream in for_walks.spawn(WALKS_OF_PERSON[protocol.site.planted > 0]):
        yield foot_walk(stream, protocol, walker=walker, params=params, gaits=gaits).signals


def _signal_values(rooms: Sequence[Sequence[FootSignals]], loops: Sequence[Sequence[FootSignals]]) -> Values:
    """The rows of the block, from walks by person: what depends on the speed is of strides of one range of speeds."""

    def strides(name: str, low: float, high: float) -> list[FloatArray]:
        return [
            np.concatenate([np.zeros(0), *(getattr(walk, name)[walk.at_speeds(low, high)] for walk in walks)])
            for walks in rooms
        ]

    def walks(of: Callable[[FootSignals], float], people: Sequence[Sequence[FootSignals]] = rooms) -> list[FloatArray]:
        return [np.array([of(walk) for walk in walks]) for walks in people]

    by_person = {
        "stride_time": strides("stride_s", *WALKING_MPS),
        "stride_cv": walks(lambda walk: walk.stride_cv, loops),
        "peak_accel_slow": strides("peak_accel_mps2", 0.7, 0.9),
        "peak_accel": strides("peak_accel_mps2", 0.9, 1.1),
        "peak_accel_fast": strides("peak_accel_mps2", 1.1, 1.3),
        "peak_rate": strides("peak_rate_dps", 0.9, 1.1),
        "stance": strides("stance", *WALKING_MPS),
        "stance_slow": strides("stance", *SLOW_MPS),
        "rest": strides("stride_rest", *WALKING_MPS),
        "power_5": walks(lambda walk: walk.power[0]),
        "power_20": walks(lambda walk: walk.power[1]),
        "power_50": walks(lambda walk: walk.power[2]),
        "accel_noise": walks(lambda walk: walk.accel_noise_mps2),
        "rate_noise": walks(lambda walk: walk.rate_noise_dps),
    }
    return {key: values for name, of in by_person.items() for key, values in clustered(name, of).items()}


def walk_features(people: Sequence[Sequence[FootSignals]], others: Sequence[Sequence[FootSignals]] = ()) -> Values:
    """Features of every walk of people to judge by, and of others from whom a classifier only learns."""
    numbered = [*enumerate(people), *((-1 - k, walks) for k, walks in enumerate(others))]
    walks = [walk for _, of_person in numbered for walk in of_person]
    person = np.array([number for number, of_person in numbered for _ in of_person], dtype=np.float64)
    return {PERSON: person, **{name: np.array([of(walk) for walk in walks]) for name, of in FEATURES.items()}}


FEATURES: Final[Mapping[str, Callable[[FootSignals], float]]] = {
    "walk_peak_accel": lambda walk: float(np.median(walk.peak_accel_mps2)),
    "walk_peak_rate": lambda walk: float(np.median(walk.peak_rate_dps)),
    "walk_stance": lambda walk: float(np.median(walk.stance)),
    "walk_rest": lambda walk: walk.rest,
    "walk_power_5": lambda walk: walk.power[0],
    "walk_power_20": lambda walk: walk.power[1],
    "walk_power_50": lambda walk: walk.power[2],
}


def _row(name: str, what: str, unit: str, per: str) -> RealismStatistic:
    return RealismStatistic(name, what, unit, per, Distribution())


FOOT_IMU: Final = Block(
    name="Foot IMU",
    statistics=(
        _row("stride_time", "time of strides of 0.9 to 1.3 m/s", "s", "stride"),
        _row("stride_cv", "variation of stride times in a loop, the outer tenth left out", "", "walk"),
        _row("peak_accel_slow", "largest specific force in a stride of 0.7 to 0.9 m/s", "m/s2", "stride"),
        _row("peak_accel", "the same at 0.9 to 1.1 m/s", "m/s2", "stride"),
        _row("peak_accel_fast", "the same at 1.1 to 1.3 m/s", "m/s2", "stride"),
        _row("peak_rate", "largest rate in a stride of 0.9 to 1.1 m/s", "deg/s", "stride"),
        _row("stance", "fraction of a stride of 0.9 to 1.3 m/s in which it is slower than 0.15 m/s", "", "stride"),
        _row("stance_slow", "the same of strides of 0.5 to 0.8 m/s", "", "stride"),
        _row("rest", "fraction of a stride of 0.9 to 1.3 m/s at which SHOE detects rest", "", "stride"),
        _row("power_5", "power of the specific force above 5 Hz", "", "walk"),
        _row("power_20", "the same above 20 Hz", "", "walk"),
        _row("power_50", "the same above 50 Hz", "", "walk"),
        _row("accel_noise", "noise of a sample of specific force, standing", "m/s2", "walk"),
        _row("rate_noise", "noise of a sample of the rate, standing", "deg/s", "walk"),
    ),
    datasets=("foot_vicon", "foot_loops"),
    real=_real_signals,
    synthetic=_synthetic_signals,
    count=40,
    controls={
        "no heel strike": Control(
            "strides smoothed to six cycles, without oscillations",
            functools.partial(_synthetic_signals, has_strike=False),
            "power_50",
        )
    },
    features=tuple(FEATURES),
    max_auc=0.80,
)


# The inertial filter.


def _errors_of(log: Log, part: Part) -> WalkErrors | None:
    """Errors of the strides of a recorded walk; None of one that is too short or too fast, as in `error-model`."""
    try:
        states = navigate(*inertial_columns(log), LITERAL)
    except RecordingError:
        return None
    ends = at_places if part == "fit" else at_rests
    errors = stride_errors(log.reference, states, *ends(log.reference, states))
    return errors if len(errors) >= MIN_STRIDES and errors.speed_mps <= MAX_SPEED_MPS else None


def _real_ins(part: Part) -> Values:
    surveyed = [source for source in ON_INSTEP[part] if source[1] != "foot_short"]
    errors = [found for log in recorded_logs(surveyed) if (found := _errors_of(log, part)) is not None]
    closures = [closures_pct(*inertial_columns(log)) for log in recorded_logs(LOOPS[part])]
    return {**{name: np.array([value]) for name, value in _error_model(errors).items()}, **_closures([closures])}


def _synthetic_ins(seed: int, count: int) -> Values:
    """Values of `count` sets: as the recorded one, each is of one person, whose walks are all in it."""
    sets: list[list[WalkErrors]] = []
    closures: list[list[tuple[float, float]]] = []
    for person in range(count):
        for_style, for_walks, for_loops = np.random.default_rng([seed, person]).spawn(3)
        style = draw_foot_style(for_style)
        walks = (foot_walk(rng, ROOM, style=style) for rng in for_walks.spawn(WALKS_OF_SET))
        sets.append([errors for walk in walks if len(errors := _errors_of_synthetic(walk)) >= MIN_STRIDES])
        loops = (foot_walk(rng, LOOP, style=style) for rng in for_loops.spawn(LOOPS_OF_PERSON))
        closures.append([closures_pct(*walk.signals) for walk in loops])
    models = [_error_model(walks) for walks in sets]
    all_walks = _error_model([walk for walks in sets for walk in walks])
    return {
        **{name: np.array([model[name] for model in models]) for name in ERRORS},
        **{f"gate_{name}": np.array([all_walks[name]]) for name in ERRORS},
        **_closures(closures),
    }


def _closures(by_person: Sequence[Sequence[tuple[float, float]]]) -> Values:
    """Of loops by person, each with the gap of the literal and of the adaptive filter."""
    literal, adaptive = ([np.array([gaps[k] for gaps in loops]) for loops in by_person] for k in (0, 1))
    return {**clustered("closure_literal", literal), **clustered("closure_adaptive", adaptive)}


def _errors_of_synthetic(walk: SyntheticFootWalk) -> WalkErrors:
    states, motion = navigate(*walk.signals, LITERAL), walk.motion
    level, known = np.zeros(len(motion), dtype=np.int64), np.ones(len(motion), dtype=np.bool_)
    truth = Trajectory(t_s=motion.t_s, xy_m=motion.xyz_m[:, :2], level=level, surveyed=known, z_m=motion.xyz_m[:, 2])
    return stride_errors(truth, states, *at_rests(truth, states))


def _error_model(walks: Sequence[WalkErrors]) -> dict[str, float]:
    """The rows of `pdrbench error-model` that are compared."""
    values = {row.name: row.value for row in summarise(walks, _DRAWS)}
    return {name: np.nan if (value := values[name]) is None else value for name in ERRORS}


def _gates() -> tuple[RealismStatistic, ...]:
    """Rows that hold the simulated error model against the one that comes with pdrbench."""
    measured = {row.name: row for row in read_error_file().statistics}
    rows: list[RealismStatistic] = []
    for name in ERRORS:
        value = measured[name].value or 0.0
        low, high = sorted(((1 - GATE) * value, (1 + GATE) * value))
        rule = Within(low, high, "the error model measured here, 30 % either way")
        rows += statistics("set", rule, (f"gate_{name}", f"{name} against the error model", measured[name].unit))
    return tuple(rows)


FOOT_INS: Final = Block(
    name="Foot INS",
    statistics=(
        *statistics(
            "set",
            Figure(),
            ("length_bias", "bias of stride lengths, literal filter", "%"),
            ("length_sigma", "error of stride lengths about the bias", "m"),
            ("height_sigma", "error of the change of height in a stride", "m"),
            ("drift_size_median", "drift of the heading, without sign, in the median walk", "deg/stride"),
            ("drift_sigma", "drift of the heading, spread over walks", "deg/stride"),
            ("heading_residual", "error of the heading of a stride without the drift", "deg"),
        ),
        *_gates(),
        _row("closure_literal", "gap of a loop over its way, literal filter", "%", "walk"),
        _row("closure_adaptive", "gap of a loop over its way, adaptive filter", "%", "walk"),
    ),
    datasets=("foot_vicon", "foot_loops"),
    real=_real_ins,
    synthetic=_synthetic_ins,
    count=12,
)


# Without aid.


def _synthetic_free(seed: int, count: int) -> Values:
    """Error of the place after a minute of walking, the bias known from a minute at rest."""
    off = []
    for number in range(count):
        walk = foot_walk(np.random.default_rng([seed, number]), MINUTE)
        begin_s = MINUTE.still_s[0] - 2.0  # the foot lifts before the body passes over it
        reported = free_error_m(*walk.signals, begin_s, _FREE_S)
        at = np.searchsorted(walk.motion.t_s, [begin_s, begin_s + _FREE_S])
        true = np.diff(walk.motion.xyz_m[at], axis=0)[0]
        # The filter's own north is unknown: the distance that is wrong for every north.
        off.append(abs(float(np.hypot(*reported[:2])) - float(np.hypot(*true[:2]))))
    return {"error_60s": np.array(off)}


FREE_INERTIAL: Final = Block(
    name="Free inertial",
    statistics=statistics(
        "walk",
        Within(100.0, 300.0, "W20: more than 100 m after a minute; more than 150 m for the MTx"),
        ("error_60s", "place after 60 s of walking, Xsens MTx on the foot, no zero velocities", "m"),
    ),
    datasets=(),
    real=lambda part: {},
    synthetic=_synthetic_free,
    count=60,
)
