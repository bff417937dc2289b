"""A phone that is carried, and one that is handled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.errors import UnknownNameError
from pdrbench_sim.people.strides import stances
from pdrbench_sim.people.walk import SimulatedWalk, body_path
from pdrbench_sim.phone.carry import PLACES, CarryParams
from pdrbench_sim.phone.gait import COARSE_HZ, Gait, GaitMotionParams, trunk_of
from pdrbench_sim.phone.phone import phone_motion
from pdrbench_sim.units.motion import MotionError, RigidMotion

from .conftest import straight_walk

EVEN = GaitMotionParams(
    rise_log_sigma=0.0,
    harmonics=(),
    harmonics_log_sigma=(),
    harmonics_phase_rad=(),
    harmonics_phase_sigma_rad=(),
    step_log_sigma=0.0,
    timing_sigma=0.0,
    uneven_fraction=0.0,
)
CALM = CarryParams(
    jitter_rad=(0.0, 0.0), shake_mps2=(0.0, 0.0, 0.0), shake_radps=(0.0, 0.0, 0.0), hand_yield_rad_per_mps2=0.0
)


@pytest.fixture(scope="module")
def straight() -> SimulatedWalk:
    return straight_walk(80.0)


def feet_of(walk: SimulatedWalk):
    return stances(walk, np.random.default_rng(1))


def carried(walk: SimulatedWalk, *, seed: int = 3, **facts) -> RigidMotion:
    return phone_motion(walk, feet_of(walk), np.random.default_rng(seed), **facts)


def lengths(motion: RigidMotion) -> np.ndarray:
    return np.linalg.norm(motion.ideal_signals()[0], axis=1)


def steady(motion: RigidMotion, walk: SimulatedWalk) -> np.ndarray:
    return (motion.t_s > walk.bouts[0].t_s[0] + 5) & (motion.t_s < walk.end_s - 5)


@pytest.mark.parametrize(("place", "height_m"), [("hand", 1.2), ("pocket", 0.8), ("ear", 1.58), ("swing", 0.75)])
def test_it_is_carried_at_its_height_beside_the_body(walks, place, height_m):
    walk = walks[0]
    motion = carried(walk, carry=((0.0, place),))
    path = body_path(walk, 200.0)
    fraction = walk.person.height_m / 1.7
    up_m = motion.xyz_m[:, 2] - path.z_m
    assert np.median(up_m) == pytest.approx(height_m * fraction, abs=0.12)
    assert np.hypot(*(motion.xyz_m[:, :2] - path.xy_m).T).max() < 0.9


def test_no_step_throws_it_out_of_the_hand():
    """A logarithm that varies by a factor that is itself log-normal has tails that reach the floor unless cut."""
    params = GaitMotionParams()
    t_s = np.arange(0, 40, 1 / COARSE_HZ)
    ones = np.ones(len(t_s))
    gait = Gait(t_s, 1.9 * t_s, 1.9 * ones, 1.3 * ones, ones, 0 * ones)
    up_m = [np.ptp(trunk_of(gait, t_s, np.random.default_rng(seed), params).up_m) for seed in range(300)]
    assert 0.03 < np.median(up_m) < 0.2
    assert max(up_m) < 0.6


def test_it_is_still_while_the_person_stands(walks):
    walk = walks[0]
    length, t_s = lengths(carried(walk)), carried(walk).t_s
    standing = np.zeros(len(t_s), dtype=bool)
    for one, other in zip(walk.bouts[:-1], walk.bouts[1:], strict=True):
        standing |= (t_s > one.t_s[-1] + 1.0) & (t_s < other.t_s[0] - 2.5)
    assert standing.sum() > 1000
    assert length[standing].std() < 0.15
    assert length[~standing].std() > 10 * length[standing].std()


@pytest.mark.parametrize("place", list(PLACES))
def test_the_pose_is_continuous(walks, place):
    motion = carried(walks[1], carry=((0.0, place),))
    accel, gyro = motion.ideal_signals()
    # A swing of 15 Hz and 30 m/s2, more than what is put in, changes by 14 m/s2 in a sample of 5 ms.
    assert np.abs(np.diff(accel, axis=0)).max() < 14.0
    assert np.abs(accel).max() < 80.0
    assert np.abs(gyro).max() < 15.0


def test_the_body_is_highest_over_its_feet(straight):
    gait = replace(EVEN, peak_phase=0.5)
    motion = carried(straight, gait=gait, carried=CALM)
    left, right = feet_of(straight)
    mids = np.sort(np.concatenate([left.mid_s[3:-3], right.mid_s[3:-3]]))
    up = np.interp(mids, motion.t_s, motion.xyz_m[:, 2])
    between = np.interp((mids[1:] + mids[:-1]) / 2, motion.t_s, motion.xyz_m[:, 2])
    assert (up[1:] - between).min() > 0.02
    assert (up[:-1] - between).min() > 0.02


def test_the_rise_follows_the_speed(straight):
    power = 2.0
    gait = replace(EVEN, rise_power=power)
    motion = carried(straight, gait=gait, carried=CALM)
    part = steady(motion, straight)
    up_mps2 = np.gradient(np.gradient(motion.xyz_m[:, 2], motion.t_s), motion.t_s)[part]
    speed_mps = straight.person.speed_mps
    # Over many whole steps the root of twice the variance is the amplitude; steps vary by 3 %, hence 10 %.
    assert np.sqrt(2) * up_mps2.std() == pytest.approx(EVEN.rise_mps2 * speed_mps**power, rel=0.1)


def test_a_switch_changes_nothing_before_it_and_is_smooth(straight):
    hand = carried(straight)
    pocket = carried(straight, carry=((0.0, "pocket"),))
    both = carried(straight, carry=((0.0, "hand"), (30.0, "pocket")))
    early, late = both.t_s < 29.4, both.t_s > 30.6
    assert np.array_equal(both.xyz_m[early], hand.xyz_m[early])
    np.testing.assert_allclose(both.xyz_m[late], pocket.xyz_m[late])
    during = ~early & ~late
    same = np.abs(np.einsum("ij,ij->i", both.quaternion[during][1:], both.quaternion[during][:-1]))
    assert same.min() > np.cos(
        np.radians(8.0) / 2
    )  # less than 8 degrees a sample: half a turn takes no less than a half second
    assert np.linalg.norm(np.diff(both.xyz_m[during], axis=0), axis=1).max() < 0.03
    assert np.abs(both.ideal_signals()[0][during]).max() < 40.0


@pytest.mark.parametrize(
    ("carry", "words"),
    [
        ((), "carried somewhere"),
        (((0.0, "hand"), (5.0, "pocket"), (5.5, "ear")), "further apart"),
        (((0.0, "hand"), (float("nan"), "pocket")), "further apart"),
    ],
)
def test_impossible_carrying_is_refused(straight, carry, words):
    with pytest.raises(MotionError, match=words):
        carried(straight, carry=carry)


def test_an_unknown_place_is_refused_with_a_suggestion(straight):
    with pytest.raises(UnknownNameError, match="pocket"):
        carried(straight, carry=((0.0, "pocked"),))
