"""How feet, shoes and strides differ: what is drawn for a person, and the sizes of what differs between strides."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, read_only
from pdrbench_sim.foot.shape import TOE_HIGH, TOE_LOW

_MODES: Final = 16  # at most, of a learned shape
_LINGER_MPS: Final = 1.1  # speed for which `linger` is stated
_LINGER_LIMITS: Final = (0.2, 1.1)  # ours: beyond, the foot has to hurry where it leaves the floor
_MAX_SLOW: Final = 0.4  # ours: beyond, swings would be hurried
_CUT: Final = 2.0  # standard deviations at which people are cut


@dataclass(frozen=True, slots=True)
class KnockParams:
    """One burst of oscillations in a stride, beyond the learned mean.

    Its envelope is a logarithmic bell, which is smooth everywhere: at heel strike it rises fast and dies away slowly,
    at toe-off it runs backwards.
    """

    phase: float  # landmark of the stride about which it comes
    begins_s: float  # where the envelope begins, after the landmark; runs backwards where `is_backwards`
    peak_s: float  # from there to its largest value
    width: float  # of the logarithm of the time
    accel_mps2: float  # sigma of an axis at its largest, at 1.2 m/s
    hz: tuple[float, float]  # range of the frequencies
    is_backwards: bool = False  # it grows slowly and ends fast


TOE_OFF: Final = KnockParams(
    phase=TOE_LOW,
    begins_s=0.01,  # [M] above 40 Hz, largest 0.01 to 0.02 s before the toe is lowest
    peak_s=0.025,
    width=0.9,
    accel_mps2=2.75,  # [M] 2.3 is what the learned shape lacks; a fifth more for shoes that ring, see HEEL_STRIKE
    hz=(20.0, 75.0),  # [M] at 85 Hz a tenth of the power at 45 Hz
    is_backwards=True,
)
HEEL_STRIKE: Final = KnockParams(
    phase=TOE_HIGH,
    begins_s=0.004,  # [M] 6 m/s2 above 40 Hz from 0.01 s after the toe is highest, half of that after 0.05 s
    peak_s=0.015,
    width=0.85,
    # [M] 5.2 is what the learned shape lacks of 6.3 m/s2. A fifth more: above 50 Hz there is then 1.6 % of the power,
    # half way (of the logarithm) from the recordings learned from, 1.2 %, to what is printed, 2 % (sources.md 1.3).
    accel_mps2=6.2,
    hz=(25.0, 105.0),  # [M] even to the end of what a unit with 200 Hz records; sources.md 1.3: 20 to 40 Hz
)


@dataclass(frozen=True, slots=True)
class SwingParams:
    """What makes feet and strides differ.

    On the floor a foot is rigid: where it turns more or less than the learned mean, the unit moves along, as it sits
    above and behind the point that the foot turns about. Shoe and strap are not: the unit moves a little by itself.
    """

    lift_sigma: float = 0.12  # of people, relative, of how far the foot is lifted and tilted; ours
    # Size of a person's own deviation in each mode of the learned strides, over that of strides of several people; what
    # is left of the variance differs from stride to stride.
    person_fraction: float = 0.5  # ours
    # Of a stride, when the toe is lowest and highest, as a fraction of the stride.
    phase_sigma: float = 0.004  # [M] toe lowest to toe highest then varies by 0.8 % of a stride; recorded 0.7 to 1.0
    # Of people, range, at 1.1 m/s: by how much slower than in the learned mean the foot passes the middle of a stance.
    linger: tuple[float, float] = (0.4, 1.0)  # ours: SHOE then sees rest for as much of each stride as recorded
    # Change of that, the same on both ends, per m/s.
    linger_slope: float = -1.5  # [M] SHOE: rest for 0.19 of strides of 0.9 m/s, 0.12 at 1.05, 0.08 at 1.25
    # Width of that, as a fraction of the stride; the time is taken from before and after.
    linger_phase: float = 0.08  # ours
    # By how much longer stances are in slow strides, as a fraction, per m/s below 1.1 m/s; swings are quicker by that.
    # [M] stances fill 0.54 of strides of 0.6 m/s (`foot_dual`) and 0.43 of 0.93 m/s (`foot_stride_gcp`): 0.52 and 0.43
    # with this, 0.43 and 0.39 without.
    slow_stance: float = 0.5
    # Roll and yaw of runs vary at most so often in a stride; 0 as learned. Where the toe points down, up to 85 degrees,
    # roll and yaw of the recorded feet could not be separated: what was learned there makes 1300 to 1900 degrees/s in
    # runs, where 540 to 600 were recorded.
    run_roll_cycles: int = 4
    # Of runs, over what the speed makes of the oscillations.
    run_knock: float = 1.3
    # (pitch, roll, yaw) of stances: how fast the foot turns in their middle, beyond the learned mean, per duration of a
    # stride.
    roll_sigma_rad: tuple[float, float, float] = (0.03, 0.14, 0.045)  # [M] with the modes 3, 8, 2.3 degrees/s
    # Of people, mean and sigma: how fast the unit moves ahead in a stance beyond the learned mean, without turning, per
    # duration of a stride.
    creep_m: tuple[float, float] = (0.02, 0.018)  # ours: so that strides are 1.9 % short (sources.md 1.3)
    # (ahead, to the left, up) as `creep_m`, of the beginnings and ends of stances.
    give_sigma_m: tuple[float, float, float] = (0.045, 0.045, 0.05)  # ours: errors of strides (sources.md 1.3)
    knocks: tuple[KnockParams, ...] = field(default=(TOE_OFF, HEEL_STRIKE))  # bursts of oscillations
    knock_waves: int = 5  # oscillations in each burst; ours: more are hardly distinguished from noise
    # Over this the oscillations of specific force and of rate hang together.
    knock_lever_m: float = 0.065  # [M] 18 degrees/s above 40 Hz go with 6 m/s2
    knock_jitter_s: float = 0.004  # of when a burst comes; ours
    # Of people and shoes, of the logarithm of the size of these.
    knock_sigma: float = 0.3  # [R] peaks of people's impacts differ by 25 to 30 %
    # Of the tilt of a foot on the floor, slow.
    sway_rad: float = 0.0015  # [M] a standing foot turns by 0.4 to 0.8 degrees/s, slowly
    sway_s: float = 0.6  # between knots of that; ours
    # Of the tilt of a foot on the floor, fast: sigma of the rate.
    tremor_radps: float = 0.0027  # [M] 0.07 to 0.17 degrees/s from 4 to 25 Hz
    # Range of its frequencies; the rate has the same power at all of them.
    tremor_hz: tuple[float, float] = (4.0, 25.0)  # [M]
    tremor_sigma: float = 0.4  # of people, of the logarithm of `tremor_radps`; [M] of four people who stand

    def slow_at(self, speed_mps: FloatArray) -> FloatArray:
        """(S,) by how much longer stances are in strides of speeds (S,)."""
        return np.clip(self.slow_stance * (_LINGER_MPS - speed_mps), 0.0, _MAX_SLOW)

    def linger_at(self, linger: float, speed_mps: FloatArray) -> FloatArray:
        """(S,) a person's `linger` in strides of speeds (S,), within what leaves time in its order."""
        return np.clip(linger + self.linger_slope * (speed_mps - _LINGER_MPS), *_LINGER_LIMITS)


@dataclass(frozen=True, slots=True)
class FootStyle:
    """How one person moves a foot in one pair of shoes."""

    lift: float  # factor of lift and tilt
    modes: FloatArray  # (M,) deviation from the mean stride, in standard deviations of strides
    knock: float  # factor of the oscillations
    creep_m: float  # see `SwingParams`
    linger: float  # see `SwingParams`
    tremor: float = 1.0  # factor of the tremor
    is_mirrored: bool = False  # for the other foot than the one that was recorded


def draw_foot_style(rng: np.random.Generator, params: SwingParams | None = None) -> FootStyle:
    """Draws a person's foot."""
    params = params or SwingParams()
    lift, modes, knock, creep, linger, tremor, side = rng.spawn(7)
    return FootStyle(
        lift=1 + params.lift_sigma * _normal(lift),
        modes=read_only(params.person_fraction * np.clip(modes.standard_normal(_MODES), -_CUT, _CUT)),
        knock=math.exp(params.knock_sigma * _normal(knock)),
        creep_m=params.creep_m[0] + params.creep_m[1] * _normal(creep),
        linger=float(linger.uniform(*params.linger)),
        tremor=math.exp(params.tremor_sigma * _normal(tremor)),
        is_mirrored=bool(side.random() < 0.5),
    )


def _normal(rng: np.random.Generator) -> float:
    return float(np.clip(rng.standard_normal(), -_CUT, _CUT))
