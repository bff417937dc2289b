"""People who differ, and what bags, carts and other phones make of their walks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench_sim.people.strides import stances
from pdrbench_sim.people.walk import SimulatedWalk
from pdrbench_sim.phone.carry import PLACES, CarryParams
from pdrbench_sim.phone.containers import CartParams, pendulum_rad, second_difference, stretched_m, wheel_vibration_m
from pdrbench_sim.phone.gait import GaitMotionParams
from pdrbench_sim.phone.phone import phone_motion
from pdrbench_sim.phone.population import KINDS, PhoneManner, draw_bearer, rigid_rise_mps2
from pdrbench_sim.record import ON_FOOT, Setup, SimulationError
from pdrbench_sim.units.motion import GRAVITY_MPS2, RigidMotion
from pdrbench_sim.units.phone_profiles import PhoneLaw, draw_phone_profile

from .conftest import straight_walk

HZ = 200.0


@pytest.fixture(scope="module")
def straight() -> SimulatedWalk:
    return straight_walk(40.0)


def carried(walk: SimulatedWalk, place: str, params: CarryParams, trunk: GaitMotionParams | None = None) -> RigidMotion:
    feet = stances(walk, np.random.default_rng(1))
    return phone_motion(walk, feet, np.random.default_rng(3), carry=((0.0, place),), gait=trunk, carried=params)


def lengths(motion: RigidMotion, walk: SimulatedWalk) -> np.ndarray:
    inside = (motion.t_s > walk.bouts[0].t_s[0] + 4) & (motion.t_s < walk.end_s - 4)
    return np.linalg.norm(motion.ideal_signals()[0], axis=1)[inside]


def power(values: np.ndarray, low_hz: float, high_hz: float) -> float:
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    frequency = np.fft.rfftfreq(len(values), 1 / HZ)
    return float(spectrum[(frequency >= low_hz) & (frequency < high_hz)].sum())


def test_a_bag_hangs_against_a_steady_pull_and_swings_at_its_own_rate():
    hang_m, t_s = 0.5, np.arange(4000) / HZ
    pulled = pendulum_rad(np.full(len(t_s), 0.3), hang_m, 0.3, HZ)
    assert pulled[-1] == pytest.approx(-0.3 / GRAVITY_MPS2, rel=1e-3)
    kicked = pendulum_rad((t_s < 0.01) * 10.0, hang_m, 0.01, HZ)
    crossings = t_s[1:][np.diff(np.sign(kicked)) > 0]
    assert np.diff(crossings).mean() == pytest.approx(2 * np.pi * np.sqrt(hang_m / GRAVITY_MPS2), rel=0.01)


@pytest.mark.parametrize("hz", [0.5, 6.0, 12.0])
def test_a_strap_passes_slow_motion_swells_at_its_resonance_and_holds_back_the_rest(hz):
    natural_hz, damping, t_s = 6.0, 0.3, np.arange(4000) / HZ
    found = stretched_m(np.cos(2 * np.pi * hz * t_s), natural_hz, damping, HZ)[2000:]
    ratio = hz / natural_hz
    response = ratio**2 / (1 - ratio**2 + 2j * damping * ratio)
    # At 200 Hz the bilinear transform moves 12 Hz by 1 %.
    assert np.abs(found).max() == pytest.approx(abs(1 + response), rel=0.08)


def test_wheels_shake_by_the_roughness_of_the_floor_and_not_while_they_stand():
    even = CartParams(rough_mps2=(1.0, 1.0), joint_mps2=(0.0, 0.0), frame_damping=(0.2, 0.2))
    rms = []
    for speed in (0.0, 0.25, 1.0):
        height_m, _ = wheel_vibration_m(np.full(40_000, speed), np.random.default_rng(2), even, HZ)
        rms.append(second_difference(height_m, HZ)[200:].std())
    # 200 s of a resonance 2 Hz wide are some 400 independent values: 5 % at one sigma of 3.5 %.
    assert rms[0] == 0.0
    assert rms[2] == pytest.approx(1.0, rel=0.07)
    assert rms[1] == pytest.approx(rms[2] / 2, rel=0.01)


def test_a_cart_hides_the_steps_that_a_bag_shows(straight):
    in_bag, on_cart = (lengths(carried(straight, place, CarryParams()), straight) for place in ("bag", "cart"))
    step_hz = 1.9
    fraction = [power(a, step_hz - 0.3, step_hz + 0.3) / power(a, 0.5, 50.0) for a in (in_bag, on_cart)]
    assert fraction[0] > 0.4
    assert fraction[1] < 0.1


def test_a_rigid_leg_lifts_the_hip_as_a_compass_does():
    """(2 pi f)^2 s^2 / (16 l) for a leg of 0.901 m, whatever the step: 2 Hz and 0.6 m, or 1 Hz and 1.2 m."""
    leg_m, speed_mps = 0.53 * 1.7, 1.2
    for cadence_hz in (1.0, 2.0):
        arc_m = (speed_mps / cadence_hz) ** 2 / (8 * leg_m)
        expected = (2 * np.pi * cadence_hz) ** 2 * arc_m / 2
        assert rigid_rise_mps2(1.7, speed_mps) == pytest.approx(expected)


@pytest.mark.parametrize("kind", KINDS)
def test_people_of_a_kind_differ_and_the_same_seed_is_the_same_person(kind):
    one, same, other = (draw_bearer(np.random.default_rng(seed), KINDS[kind]) for seed in (1, 1, 2))
    assert one == same != other
    assert one.mounting in PLACES
    assert (one.manner.profile is not None) == (kind == "other phone")


def test_phones_are_drawn_within_their_law_and_a_unit_on_the_foot_without():
    law = PhoneLaw()
    for seed in range(50):
        phone = draw_phone_profile(np.random.default_rng(seed), law)
        assert law.accel_density[0] <= phone.accel.density <= law.accel_density[1]
        assert law.accel_step[0] <= phone.accel.step <= law.accel_step[1]
        assert phone.accel.limit in law.accel_limit
        assert phone.accel.bandwidth_hz <= 0.45 * phone.rate_hz
    with pytest.raises(SimulationError, match="no manner of a phone"):
        replace(ON_FOOT, manner=PhoneManner(trunk=GaitMotionParams()))
    assert Setup("hand", device="phone_mid", sensors=("accel",)).profile.rate_hz == 100.0
