"""The particle part of `pdrbench bench phone`: a walk through the localizer of Li et al. 2012, and one step of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from pdrbench.bench.timing import Timing, median_s
from pdrbench.building import Building
from pdrbench.localizer import Briefing, Localizer, Observation
from pdrbench.recording import Recording
from pdrbench.registry import make_localizer
from pdrbench.trajectory import Start
from pdrbench_baselines.li2012.map_filter import StepModel, StepModelFilter

LOCALIZER: Final = "li2012-v0"
PERIOD_S: Final = 0.2
SENSORS: Final = ("accel", "rotation")
RATE_HZ: Final = 50.0
WALK_S: Final = 120.0
STEPS: Final = 20


def li_filter(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """Real-time factor of a walk, from samples to estimates, and the time of a step with 3000 particles.

    Args:
        quick: A shorter walk, fewer rounds.
        tell: Receives what comes next.
    """
    tell("a walk to play")
    rounds, recording = (3 if quick else 7), _walk(30.0 if quick else WALK_S)
    building = recording.building
    assert building is not None
    observations, briefing = _observations(recording), _briefing(recording)
    localizer = make_localizer(LOCALIZER)
    _play(localizer, briefing, observations[: int(10 / PERIOD_S)])
    tell("steps of 3000 particles")
    taken = median_s(
        {
            "walk": lambda: lambda: _play(localizer, briefing, observations),
            "step": lambda: _step(building, briefing.start),
        },
        rounds,
    )
    return [
        Timing("li2012_real_time", recording.end_s / taken["walk"], "s/s"),
        Timing("li2012_step_3000", 1e6 * taken["step"] / STEPS, "us"),
    ]


def _walk(duration_s: float) -> Recording:
    """A person with a phone in the hand."""
    from pdrbench_sim.buildings.office import make_office
    from pdrbench_sim.record import Setup, make_scene, simulate_walk

    rng = np.random.default_rng(1)
    scene = make_scene(rng, make_office(rng, num_levels=1, area_m2=1500))
    setup = Setup("hand", device="phone_mid", sensors=SENSORS, rate_hz=RATE_HZ)
    return simulate_walk(scene, 1, setup, duration_s=duration_s)


def _briefing(recording: Recording) -> Briefing:
    way = recording.reference
    start = Start(way.xy_m[0], int(way.level[0]), heading_rad=0.0)
    specs = {name: stream.spec for name, stream in recording.streams.items()}
    return Briefing(recording.building, specs, PERIOD_S, start, mounting="hand")


def _observations(recording: Recording) -> list[Observation]:
    """Everything that was recorded, in pieces of one period."""
    now_s = PERIOD_S * np.arange(int(recording.end_s / PERIOD_S) + 1)
    pieces = {}
    for name, stream in recording.streams.items():
        pieces[name] = np.split(stream.rows, np.searchsorted(stream.t_s, now_s, side="right"))
    return [Observation(t, {name: rows[i] for name, rows in pieces.items()}) for i, t in enumerate(now_s.tolist())]


def _play(localizer: Localizer, briefing: Briefing, observations: list[Observation]) -> None:
    localizer.reset(briefing, np.random.default_rng(0))
    for observation in observations:
        localizer.step(observation)


def _step(building: Building, start: Start | None) -> Callable[[], object]:
    """Some steps of the filter, from the start in all directions."""
    assert start is not None
    particles = StepModelFilter(building, np.random.default_rng(0))
    particles.start(start.xy_m, start.level, StepModel(0.2, 0.3))

    def act() -> None:
        for k in range(STEPS):
            particles.step(1.9, 0.3 * k)

    return act
