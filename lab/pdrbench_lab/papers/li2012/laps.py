"""Laps of the corridor of Li et al. 2012 by one set of people, and a localizer followed on them step by step.

The paper labels where its people were at every step, and scores the place that is shown when a step is taken. So here a
localizer is asked whenever a step becomes known, and what it answers is held against where the body was when that step
ended: how late a step becomes known does not count. Scores of `CorridorPhone-v1` contain that delay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench.inertial import STAGES
from pdrbench.inertial.step_detection import find_steps
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import Recording
from pdrbench.trajectory import Trajectory
from pdrbench_baselines.li2012.localizer import LI2012, Li2012
from pdrbench_baselines.li2012.map_filter import StepModel
from pdrbench_lab.papers.li2012.corridor_phone.corridor import (
    CORRIDOR,
    PHONES,
    Laps,
    draw_laps,
    make_corridor_scene,
    record_laps,
    start_heading_rad,
    tapped,
)
from pdrbench_lab.papers.li2012.handling import record_handling
from pdrbench_lab.papers.li2012.model import walked_m
from pdrbench_lab.papers.settings import merged
from pdrbench_sim.people.person import Person, draw_person
from pdrbench_sim.record import BuildingScene

REFERENCE_S: Final = 0.1  # of the true way: finer than the environment's, to know where a step ended
PERIOD_S: Final = 0.5
SETUPS: Final = {place: replace(setup, reference_s=REFERENCE_S) for place, setup in PHONES.items()}
_SCENE, _PERSON, _LAPS, _WALK, _TAP, _FILTER, _HANDLING = range(7)  # one stream of random numbers each


# Fields of `Li2012Params`: the three algorithms of the paper's Fig. 11. The third is `li2012` as it is registered.
ALGORITHMS: Final[Mapping[str, Mapping[str, Any]]] = {
    "alg1": {"generic": True, "warping": False},
    "alg2": {"generic": True},
    "alg3": {},
}
LOST_M: Final = 6.0  # L22
LOST_STEPS: Final = 10  # L22


class Crowd:
    """People of one seed who walk laps of a corridor, with its own magnetic field.

    Args:
        seed: Everything is drawn from it.
        stream: Another number, another crowd of the same seed.
    """

    def __init__(self, seed: int, stream: int) -> None:
        self._entropy = (seed, 2012, stream)
        self.scene: BuildingScene = make_corridor_scene(self._rng(_SCENE))

    def person(self, number: int) -> Person:
        """One of them, of any size."""
        return draw_person(self._rng(_PERSON, number))

    def laps(self, number: int, count: int = 1) -> Laps:
        """Where one of the walks goes."""
        return draw_laps(self._rng(_LAPS, number), count)

    def walk(self, number: int, person: int, place: str, count: int = 1) -> tuple[Recording, Briefing]:
        """A walk with a phone at a place, and what is given of it, as in `CorridorPhone-v1`."""
        laps = self.laps(number, count)
        seed = [*self._entropy, _WALK, number]
        recording = record_laps(self.scene, seed, laps, self.person(person), SETUPS[place])
        specs = {name: stream.spec for name, stream in recording.streams.items()}
        start = tapped(recording.reference.xy_m[0], self._rng(_TAP, number), start_heading_rad(laps, place))
        return recording, Briefing(recording.building, specs, PERIOD_S, start, mounting=place)

    def handled_walk(self, number: int, place: str, before_s: float) -> tuple[Recording, Briefing]:
        """The same walk after its bearer has stood where it begins, handling the phone, since the tap."""
        recording, briefing = self.walk(number, number, place)
        stands = self.laps(number).places(self.scene.building)[0]
        seed = [*self._entropy, _HANDLING, number]
        first = record_handling(self.scene, seed, stands, duration_s=before_s, reference_s=REFERENCE_S)
        return _joined(first, recording, before_s), briefing

    def filter_rng(self, number: int) -> np.random.Generator:
        """Of a localizer on a walk; the same for every algorithm."""
        return self._rng(_FILTER, number)

    def _rng(self, *stream: int) -> np.random.Generator:
        return np.random.default_rng([*self._entropy, *stream])


@dataclass(frozen=True, slots=True)
class Followed:
    """What a localizer answered after every step that it took.

    Attributes:
        end_s: (S,) when each step ended.
        xy_m: (S, 2) answers.
        true_xy_m: (S, 2) where the body was then.
        frequency_hz: (S,) of the step.
        model: (S, 2) mean a and b of the cloud after it.
        true_length_m: (S,) of the step, from its begin to its end.
        heading_rad: (S,) of the step.
        corrected_rad: (S,) the same with the correction of eq. (2), with which particles were moved.
        corridor_rad: (S,) of the corridor there, the way the walk goes: the paper's ground truth.
        turns: (S,) corners that the walker has passed.
        resets: How often all particles died.
        failures: How often the tracking was lost, and begun anew where the user tapped.
        personal: The model of this person to keep.
    """

    end_s: FloatArray
    xy_m: FloatArray
    true_xy_m: FloatArray
    frequency_hz: FloatArray
    model: FloatArray
    true_length_m: FloatArray
    heading_rad: FloatArray
    corrected_rad: FloatArray
    corridor_rad: FloatArray
    turns: IntArray
    resets: int
    failures: int
    personal: StepModel

    def since(self, begin_s: float) -> Followed:
        """The same without the steps that ended before a time."""
        kept = self.end_s >= begin_s
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        by_step: dict[str, Any] = {name: value[kept] for name, value in values.items() if isinstance(value, np.ndarray)}
        return replace(self, **by_step)

    @property
    def length_m(self) -> FloatArray:
        """(S,) of the step, by the mean model of the cloud."""
        return np.asarray(self.model[:, 0] * self.frequency_hz + self.model[:, 1])

    @property
    def euclidean_m(self) -> FloatArray:
        """(S,) distance from the body."""
        return np.asarray(np.hypot(*(self.xy_m - self.true_xy_m).T))

    @property
    def along_m(self) -> FloatArray:
        """(S,) L2: both projected on the middle line of the corridor, the shorter arc between."""
        apart_m = np.abs(CORRIDOR.along_m(self.xy_m) - CORRIDOR.along_m(self.true_xy_m))
        return np.minimum(apart_m, CORRIDOR.lap_m - apart_m)

    def heading_error_deg(self, *, is_corrected: bool) -> FloatArray:
        """(S,) size of the heading's error, 0 to 180 (L12)."""
        claimed_rad = self.corrected_rad if is_corrected else self.heading_rad
        return np.degrees(np.abs(wrap_rad(claimed_rad - self.corridor_rad)))


def follow(
    recording: Recording,
    briefing: Briefing,
    rng: np.random.Generator,
    params: Mapping[str, Any],
    *,
    model: StepModel | None = None,
    taps_again: bool = False,
    lost_m: float = LOST_M,
) -> Followed:
    """Runs the localizer over a walk and asks it after every step.

    Where one observation makes two steps known, the later one is looked at.

    Args:
        recording: The walk.
        briefing: What is given of it.
        rng: Of the localizer.
        params: Its parameters, as of `ALGORITHMS`.
        model: Of this person, from an earlier walk.
        taps_again: Whether a lost user says where they are (L22): after the death of all particles, and after
            `LOST_STEPS` answers on end more than `lost_m` off. A finger taps as it does at the start.
        lost_m: See `taps_again`.
    """
    localizer = Li2012(merged(LI2012, params, "li2012"), model=model)
    localizer.reset(briefing, rng)
    (finger,) = rng.spawn(1)
    particles = localizer.filter
    steps = find_steps(
        recording.streams["accel"].rows, 50.0, stage=STAGES[-1] if params.get("warping", True) else STAGES[-2]
    )
    reference = recording.reference
    true_xy_m = np.column_stack([np.interp(steps.end_s, reference.t_s, column) for column in reference.xy_m.T])
    true_length_m = walked_m(reference, steps.begin_s, steps.end_s)
    found: list[tuple[float, ...]] = []
    lost_steps, failures, taken = 0, 0, 0
    for observation in _pieces(recording, steps.found_s):
        before_rad, resets = particles.correction_rad, particles.resets
        estimate = localizer.step(observation)
        if particles.num_steps == taken:
            continue
        taken, step, model = particles.num_steps, particles.num_steps - 1, particles.model
        assert estimate.heading_rad is not None
        found.append((step, *estimate.xy_m.tolist(), estimate.heading_rad, before_rad, model.a_m_per_hz, model.b_m))
        off_m = float(np.hypot(*(estimate.xy_m - true_xy_m[step])))
        lost_steps = lost_steps + 1 if off_m > lost_m else 0
        if taps_again and (particles.resets > resets or lost_steps >= LOST_STEPS):
            particles.start(tapped(true_xy_m[step], finger).xy_m, 0, model)  # what was learned of the person stays
            failures, lost_steps = failures + 1, 0
    number, x_m, y_m, heading_rad, correction_rad, a, b = np.array(found).T
    row = number.astype(np.int64)
    corridor_rad, turns = _corridor(true_xy_m[row])
    return Followed(
        end_s=steps.end_s[row],
        xy_m=np.column_stack([x_m, y_m]),
        true_xy_m=true_xy_m[row],
        frequency_hz=steps.frequency_hz[row],
        model=np.column_stack([a, b]),
        true_length_m=true_length_m[row],
        heading_rad=heading_rad,
        corrected_rad=heading_rad + correction_rad,
        corridor_rad=corridor_rad,
        turns=turns,
        resets=particles.resets,
        failures=failures,
        personal=localizer.personal_model(),
    )


def _pieces(recording: Recording, found_s: FloatArray) -> Iterator[Observation]:
    """The streams, cut where steps become known."""
    cuts_s = np.unique(found_s)
    rows = {name: stream.rows for name, stream in recording.streams.items()}
    ends = {name: np.searchsorted(of[:, 0], cuts_s + 1e-9, side="right") for name, of in rows.items()}
    begin = dict.fromkeys(rows, 0)
    for k, now_s in enumerate(cuts_s.tolist()):
        yield Observation(now_s, {name: of[begin[name] : ends[name][k]] for name, of in rows.items()})
        begin = {name: int(end[k]) for name, end in ends.items()}


def _joined(first: Recording, then: Recording, begin_s: float) -> Recording:
    """Two recordings of one phone, the second one from `begin_s` on."""

    def follows(one: FloatArray, other: FloatArray) -> FloatArray:
        later = np.column_stack([other[:, 0] + begin_s, other[:, 1:]])
        return np.concatenate([one[one[:, 0] < later[0, 0]], later])

    streams = {
        name: replace(stream, rows=follows(first.streams[name].rows, stream.rows))
        for name, stream in then.streams.items()
    }
    standing, walking = first.reference, then.reference
    stood = standing.t_s < begin_s
    reference = Trajectory(
        t_s=np.concatenate([standing.t_s[stood], walking.t_s + begin_s]),
        xy_m=np.concatenate([standing.xy_m[stood], walking.xy_m]),
        level=np.concatenate([standing.level[stood], walking.level]),
        surveyed=np.concatenate([standing.surveyed[stood], walking.surveyed]),
    )
    return replace(then, streams=streams, reference=reference)


def _corridor(xy_m: FloatArray) -> tuple[FloatArray, IntArray]:
    """(n,) direction of the corridor at places along a walk, the way it goes, and (n,) corners passed by then."""
    along_m = np.unwrap(CORRIDOR.along_m(xy_m), period=CORRIDOR.lap_m)
    is_back = along_m[-1] < along_m[0]
    lap = np.floor(along_m / CORRIDOR.lap_m)
    side = 4 * lap + np.searchsorted(CORRIDOR.corners_m, along_m - lap * CORRIDOR.lap_m, side="right")
    turns = np.maximum.accumulate(side[0] - side if is_back else side - side[0])
    return CORRIDOR.heading_rad(along_m) + (np.pi if is_back else 0.0), turns.astype(np.int64)
