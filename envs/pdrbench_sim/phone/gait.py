"""How the trunk of a walking person moves about the even path of the body: up and down, to and fro, from side to side.

The phase counts steps and is locked to the footfalls; the amplitudes follow the speed. Everything is a smooth
function of time: it is nothing while the person stands, and comes and goes within a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_sim.noise import autoregressive
from pdrbench_sim.people.strides import LEFT, Stances
from pdrbench_sim.people.walk import BodyPath, SimulatedWalk

COARSE_HZ: Final = 50.0  # of what changes slowly: path, phase, amplitudes, jitter; splines lead to finer samples
PATH_SMOOTH_S: Final = 0.12  # ours: a fifth of a step; takes the corners off speed, heading and stairs
PHASE_SMOOTH_S: Final = 0.06  # ours
EARLY_S: Final = 0.1  # ours: before the first movement and after the last rest
RAMP_S: Final = 0.5  # ours: a step, in which the oscillation comes and goes
CLOSING_S: Final = 0.6  # a foot that comes to rest this long after the body has belongs to the bout
ARM_PASSES: Final = {1: 1.0, 2: 0.36}  # [M] part of each harmonic of the rise to which a wrist gives way
CUT: Final = 2.0  # standard deviations at which people and steps are cut: tails of a logarithm reach the floor
MIN_STEP_HZ: Final = 1.0  # of steps, where an amplitude of acceleration becomes one of displacement


@dataclass(frozen=True, slots=True)
class GaitMotionParams:
    """How a trunk moves; logarithmic spreads are sigmas of natural logarithms, all laws are cut at `CUT`."""

    # Amplitude of the vertical acceleration at the step rate and a speed of 1 m/s.
    rise_mps2: float = 3.65  # [M] site 1 train walks of ILC20
    # It grows with this power of the speed, the product of step rate and step length.
    rise_power: float = 1.1  # [M] the same walks; an inverted pendulum has 2
    rise_log_sigma: float = 0.15  # its spread from walk to walk; [M]
    run_mps2: float = 11.0  # the same amplitude of a person who runs, whatever the speed; [R] 4 cm at 2.6 Hz
    # Amplitudes at 2, 3, 4 and 5 times the step rate over the first one, at `harmonics_at_mps2`.
    harmonics: tuple[float, ...] = (0.32, 0.12, 0.075, 0.055)  # [M] the same walks; the first by the line, 0.12 to 0.14
    # Amplitude of the first at which the others have those ratios; they grow with its root.
    harmonics_at_mps2: float = 4.2  # [M]
    harmonics_log_sigma: tuple[float, ...] = (0.12, 0.35, 0.35, 0.4)  # spread of each from walk to walk; [M]
    harmonics_phase_rad: tuple[float, ...] = (0.0, 0.0, 1.6, 1.9)  # where each is when the first has its peak; [M]
    harmonics_phase_sigma_rad: tuple[float, ...] = (0.1, 0.8, 0.9, 0.9)  # spread of that from walk to walk; [M]
    # When the first has its peak: this part of a step after the body has passed over the foot.
    peak_phase: float = 0.58  # ours: soon after the other heel comes down, at half a step
    ahead_fraction: float = 0.15  # amplitude to and fro over that of the rise, at the step rate; [M]
    ahead_phase_rad: float = 1.2  # its phase; [M] before the peak the body gains speed
    sway_mps2: tuple[float, float] = (0.40, 0.25)  # amplitudes from side to side at 1/2 and 3/2 of the step rate; [M]
    sway_log_sigma: float = 0.4  # spread from walk to walk; [M]
    step_log_sigma: float = 0.40  # spread of all amplitudes from step to step; [M] 0.38 are left of it by the cut
    step_memory: float = 0.5  # correlation of that from one step to the next; [M]
    harmonic_step_log_sigma: float = 0.34  # spread of each harmonic from step to step, on top; [M]
    # Standard deviation of the phase against the feet, in steps.
    timing_sigma: float = 0.12  # [M] times of steps vary by 11 % in a walk, here by 10 %
    # Correlation of that from one step to the next: steps in a row are alike quick or slow.
    timing_memory: float = 0.8  # [M] neighbouring times correlate by 0.1, here by -0.06; without memory by -0.3
    unsteady_log_sigma: float = 0.35  # spread of the variation from step to step from walk to walk; [M]
    # Amplitude of the vertical acceleration at half the step rate over that at the step rate: one side pushes harder.
    uneven_fraction: float = 0.035  # [M] the line of strides
    uneven_log_sigma: float = 0.4  # its spread from walk to walk; [M]


@dataclass(frozen=True, slots=True, eq=False)
class Gait:
    """The rhythm of a walk, evenly sampled at `COARSE_HZ`; (n,) each."""

    t_s: FloatArray  # seconds
    step: FloatArray  # phase in steps, a whole number when the body passes over a foot, even over the left one
    rate_hz: FloatArray  # steps per second, at least `MIN_STEP_HZ`
    speed_mps: FloatArray  # of the body, along the slope of stairs
    going: FloatArray  # 0 standing to 1 walking
    running: FloatArray  # 0 walking to 1 running


def smooth(values: FloatArray, sigma_s: float) -> FloatArray:
    """(n, ...) coarse samples smoothed by a Gaussian in time; the ends last on."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(values, sigma_s * COARSE_HZ, axis=0, mode="nearest"))


def ease(fraction: FloatArray) -> FloatArray:
    """0 below 0, 1 above 1, and between them with two vanishing derivatives at either end."""
    x = np.clip(fraction, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


def gait_of(walk: SimulatedWalk, feet: tuple[Stances, Stances], path: BodyPath) -> Gait:
    """The rhythm of a walk from the times at which its feet rest; `path` is the way of its body at `COARSE_HZ`."""
    from scipy.interpolate import PchipInterpolator

    t_s = path.t_s
    knots_s, knots_step = [t_s[0] - 10.0], [0.0]
    going, running = np.zeros(len(t_s)), np.zeros(len(t_s))
    for bout in walk.bouts:
        begin_s, last_s = float(bout.t_s[0]), float(bout.t_s[-1]) + CLOSING_S
        mids = [foot.mid_s[(foot.mid_s > begin_s) & (foot.mid_s <= last_s)] for foot in feet]
        mid_s = np.sort(np.concatenate(mids))
        if not len(mid_s):
            continue
        starts_left = bool(len(mids[LEFT])) and mids[LEFT][0] == mid_s[0]
        first = math.ceil(knots_step[-1]) + 1
        first += (first + (0 if starts_left else 1)) % 2
        knots_s += [begin_s, *mid_s]
        knots_step += [first - 1.0, *(first + np.arange(len(mid_s)))]
        end_s = float(mid_s[-1])
        part = slice(*np.searchsorted(t_s, [begin_s - EARLY_S, end_s + EARLY_S]))
        inside = ease((t_s[part] - begin_s + EARLY_S) / RAMP_S) * ease((end_s + EARLY_S - t_s[part]) / RAMP_S)
        going[part] += inside
        running[part] += inside * float(bout.is_run)
    step = smooth(PchipInterpolator([*knots_s, t_s[-1] + 10.0], [*knots_step, knots_step[-1]])(t_s), PHASE_SMOOTH_S)
    climb_mps = np.gradient(smooth(path.z_m, PATH_SMOOTH_S), t_s)
    return Gait(
        t_s=t_s,
        step=step,
        rate_hz=np.maximum(np.gradient(step, t_s), MIN_STEP_HZ),
        speed_mps=smooth(np.hypot(path.speed_mps, 2 * climb_mps), PATH_SMOOTH_S),
        going=np.clip(going, 0.0, 1.0),
        running=np.clip(running, 0.0, 1.0),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Trunk:
    """Oscillation of a trunk, evenly sampled."""

    ahead_m: FloatArray  # (n,) displacement from the even path, in the frame of the heading
    left_m: FloatArray  # (n,) likewise
    up_m: FloatArray  # (n,) likewise
    nod_mps2: FloatArray  # (n,) vertical acceleration of the lower two harmonics, as an arm that yields follows it
    strength: FloatArray  # (n,) amplitude of the vertical acceleration, 1 at an ordinary walk
    per_rate2: FloatArray  # (n,) displacement over acceleration of an oscillation at the step rate, s^2
    step: FloatArray  # (n,) phase in steps
    going: FloatArray  # (n,) 0 standing to 1 walking
    running: FloatArray  # (n,) 0 walking to 1 running


def trunk_of(
    gait: Gait,
    t_s: FloatArray,
    rng: np.random.Generator,
    params: GaitMotionParams,
    *,
    variation: float = 1.0,
    overtones: float = 1.0,
) -> Trunk:
    """Oscillation of the trunk, as it arrives at a phone.

    Amplitudes of acceleration a become displacements a / (2 pi k f)^2, with f the step rate of the moment.

    Args:
        gait: The rhythm.
        t_s: (n,) times within those of the gait.
        rng: Two calls with generators in the same state give the same steps.
        params: How a trunk moves.
        variation: Part of the variation from step to step that arrives.
        overtones: Part of the harmonics of the step rate that arrives.
    """
    from scipy.interpolate import CubicSpline

    personal, *varying = rng.spawn(3 + len(params.harmonics))
    drawn = np.clip(personal.standard_normal(5 + 2 * len(params.harmonics)), -CUT, CUT)
    unsteady = variation * math.exp(params.unsteady_log_sigma * drawn[4])
    uneven = params.uneven_fraction * math.exp(params.uneven_log_sigma * drawn[0])
    walking = (
        params.rise_mps2
        * np.maximum(gait.speed_mps, 0.0) ** params.rise_power
        * math.exp(params.rise_log_sigma * drawn[1])
    )
    first = (walking + gait.running * (params.run_mps2 - walking)) * gait.going
    first *= np.exp(unsteady * params.step_log_sigma * _by_step(gait, varying[0], params.step_memory))
    late = unsteady * params.timing_sigma * _by_step(gait, varying[1], params.timing_memory)
    strength = np.sqrt(first / params.harmonics_at_mps2)
    amplitudes, phases_rad = [first], [0.0]
    for k, fraction in enumerate(params.harmonics):
        spread = params.harmonics_log_sigma[k] * drawn[5 + 2 * k]
        wobble = unsteady * params.harmonic_step_log_sigma * _by_step(gait, varying[2 + k], 0.0)
        amplitudes.append(overtones * first * strength * fraction * np.exp(spread + wobble))
        shift = params.harmonics_phase_rad[k] + params.harmonics_phase_sigma_rad[k] * drawn[6 + 2 * k]
        phases_rad.append(shift)

    per_rate2 = 1 / (2 * np.pi * gait.rate_hz) ** 2
    sway = math.exp(params.sway_log_sigma * drawn[2]) * gait.going * (1 + gait.running)
    slow = np.column_stack(
        [gait.step + late, gait.going, gait.running, params.ahead_fraction * first * per_rate2]
        + [sway * amplitude * per_rate2 for amplitude in params.sway_mps2]
        + [amplitude * per_rate2 for amplitude in amplitudes]
        + [first, per_rate2]
    )
    fine = CubicSpline(gait.t_s, slow)(t_s)
    step, going, running, ahead, sway_1, sway_3, *rises = fine.T
    per_rate2_fine, first_fine = rises.pop(), rises.pop()
    angle = 2 * np.pi * (step - params.peak_phase)
    up_m, nod = np.zeros(len(t_s)), np.zeros(len(t_s))
    for k, (rise, phase_rad) in enumerate(zip(rises, phases_rad, strict=True), start=1):
        wave = rise * np.cos(k * angle + phase_rad)
        up_m -= wave / k**2
        nod += ARM_PASSES.get(k, 0.0) * wave
    half = np.pi * step
    up_m -= 4 * uneven * rises[0] * np.cos(half + drawn[3])
    return Trunk(
        ahead_m=-ahead * np.cos(angle + params.ahead_phase_rad),
        # The body leans over the foot it stands on: to the left at even steps.
        left_m=4 * sway_1 * np.cos(half) + 4 / 9 * sway_3 * np.cos(3 * half + drawn[3]),
        up_m=up_m,
        nod_mps2=nod / per_rate2_fine,
        strength=first_fine / params.harmonics_at_mps2,
        per_rate2=per_rate2_fine,
        step=step,
        going=going,
        running=running,
    )


def smooth_noise(count: int, rng: np.random.Generator, time_s: float, smooth_s: float) -> FloatArray:
    """(count, 3) coarse Ornstein-Uhlenbeck processes of unit variance, smoothed so that they can be differentiated."""
    keep = math.exp(-1 / (time_s * COARSE_HZ))
    return smooth(autoregressive(rng.standard_normal((count, 3)), keep), smooth_s)


def _by_step(gait: Gait, rng: np.random.Generator, memory: float) -> FloatArray:
    """(n,) coarse samples of a process that is drawn anew at each step, standard normal there, cut at `CUT`."""
    count = math.ceil(gait.step[-1]) + 2
    drawn = np.clip(autoregressive(rng.standard_normal(count), memory), -CUT, CUT)
    return smooth(np.interp(gait.step, np.arange(count), drawn), PHASE_SMOOTH_S)
