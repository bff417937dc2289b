"""`pdrbench bench phone`: step detection and warping beside plain NumPy and a fast library, then the filter."""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import firwin

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.inertial.step_detection import GRAVITY_MPS2, RATE_HZ, Stage, StepDetector, StepParams, find_steps
from pdrbench.inertial.warping import warped_distance, z_scored
from pdrbench.localizer import Briefing, Localizer, Observation
from pdrbench.recording import Recording
from pdrbench.registry import make_localizer
from pdrbench.trajectory import Start
from pdrbench_baselines.li2012.map_filter import StepModel, StepModelFilter
from pdrbench_lab.papers.li2012.warping import warped_distances
from pdrbench_lab.speed.timing import Timing, median_s

OTHER: Final = "dtaidistance"  # a library whose C code is known to be fast
WITHOUT_OTHER: Final = "not compared: dtaidistance is not installed"
PERIOD_S: Final = 0.2  # of a localizer that is asked five times a second
NUM_WAVES: Final = 400
LOCALIZER: Final = "li2012"
WALK_S: Final = 120.0
STEPS: Final = 20


def run(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """Rows of the table; `tell` receives what comes next."""
    rounds = 3 if quick else 9
    tell("step detection")
    rows = _detection(60.0 if quick else 600.0, rounds)
    tell("dynamic time warping")
    rows += _warping(60 if quick else NUM_WAVES, rounds)
    return rows + _filter(quick, tell)


def walk(duration_s: float, seed: int = 1) -> FloatArray:
    """(n, 4) accelerometer rows of something like a walk: steps of two alternating shapes, and noise."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    phase = 2 * np.pi * 1.8 * (t_s + 0.1 * np.sin(2 * np.pi * 0.03 * t_s))
    up_mps2 = 9.81 + 3.0 * np.sin(phase) + 0.8 * np.sin(phase / 2) + 0.6 * np.sin(2 * phase + 1.0)
    return np.column_stack([t_s, rng.normal(0, 0.3, (len(t_s), 2)), up_mps2 + rng.normal(0, 0.3, len(t_s))])


def _detection(duration_s: float, rounds: int) -> list[Timing]:
    """A whole recording, and one that comes in pieces; the plain detector gets a twentieth."""
    rows = walk(duration_s)
    few = rows[: len(rows) // 20]
    pieces = np.array_split(rows, round(duration_s / PERIOD_S))

    def stream() -> None:
        detector = StepDetector(RATE_HZ)
        for piece in pieces:
            detector.update(piece)

    find_steps(few, RATE_HZ)
    taken = median_s(
        {
            "whole": lambda: lambda: find_steps(rows, RATE_HZ),
            "stream": lambda: stream,
            "plain": lambda: lambda: plain_steps(few),
        },
        rounds,
    )
    per_s, plain_per_s = len(rows) / taken["whole"], len(few) / taken["plain"]
    return [
        Timing("steps", per_s / 1e3, "k samples/s", "plain NumPy", per_s / plain_per_s),
        Timing("steps_real_time", duration_s / taken["stream"], "s/s"),
    ]


def _warping(count: int, rounds: int) -> list[Timing]:
    """Every two of so many steps, and one step with one other; one core."""
    rng = np.random.default_rng(2)
    waves = [z_scored(np.cumsum(rng.normal(size=int(size)))) for size in rng.integers(22, 33, count)]
    pairs = count * (count - 1) / 2
    band = StepParams().band
    few = waves[: max(count // 10, 8)]
    things: dict[str, Callable[[], Callable[[], object]]] = {
        "all": lambda: lambda: warped_distances(waves, band),
        "one": lambda: lambda: [warped_distance(waves[0], wave, band) for wave in waves],
        "plain": lambda: lambda: [plain_warped_distance(waves[0], wave, band) for wave in few],
    }
    other = _other()
    if other is not None:
        window = None if band is None else band + 1  # it counts the diagonal
        things["other all"] = lambda: (
            lambda: other.distance_matrix_fast(waves, window=window, parallel=False, compact=False)
        )
        things["other one"] = lambda: lambda: [other.distance_fast(waves[0], wave, window=window) for wave in waves]
    for prepare in things.values():
        prepare()()
    taken = median_s(things, rounds)
    plain = Timing("warping_twin", len(few) / taken["plain"] / 1e3, "k pairs/s")
    rows = []
    for name, per_s in (("all", pairs / taken["all"]), ("one", count / taken["one"])):
        if other is None:
            rows.append(Timing(f"warping_{name}", per_s / 1e3, "k pairs/s", WITHOUT_OTHER))
            continue
        other_per_s = (pairs if name == "all" else count) / taken[f"other {name}"]
        rows.append(Timing(f"warping_{name}", per_s / 1e3, "k pairs/s", f"{OTHER}, C, one core", per_s / other_per_s))
    return [*rows, plain]


def _other() -> Any:
    """The other library where it is installed with its compiled part, else None."""
    if importlib.util.find_spec(OTHER) is None:
        return None
    dtw = importlib.import_module(f"{OTHER}.dtw")
    return dtw if dtw.try_import_c() else None


def _filter(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """Real-time factor of a walk, from samples to estimates, and the time of a step with 3000 particles."""
    tell("a walk to play")
    rounds, recording = (3 if quick else 7), _simulated(30.0 if quick else WALK_S)
    way = recording.reference
    specs = {name: stream.spec for name, stream in recording.streams.items()}
    start = Start(way.xy_m[0], int(way.level[0]), heading_rad=0.0)
    observations, briefing = (
        _observations(recording),
        Briefing(recording.building, specs, PERIOD_S, start, mounting="hand"),
    )
    localizer = make_localizer(LOCALIZER)
    _play(localizer, briefing, observations[: int(10 / PERIOD_S)])
    tell("steps of 3000 particles")
    taken = median_s(
        {
            "walk": lambda: lambda: _play(localizer, briefing, observations),
            "step": lambda: _steps(recording.building, start),
        },
        rounds,
    )
    return [
        Timing("li2012_real_time", recording.end_s / taken["walk"], "s/s"),
        Timing("li2012_step_3000", 1e6 * taken["step"] / STEPS, "us"),
    ]


def _simulated(duration_s: float) -> Recording:
    """A person with a phone in the hand."""
    from pdrbench_sim.buildings.office import make_office
    from pdrbench_sim.record import Setup, make_scene, simulate_walk

    rng = np.random.default_rng(1)
    scene = make_scene(rng, make_office(rng, num_levels=1, area_m2=1500))
    setup = Setup("hand", device="phone_mid", sensors=("accel", "rotation"), rate_hz=RATE_HZ)
    return simulate_walk(scene, 1, setup, duration_s=duration_s)


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


def _steps(building: Building | None, start: Start) -> Callable[[], object]:
    """Some steps of the filter, from the start in all directions."""
    particles = StepModelFilter(building, np.random.default_rng(0))
    particles.start(start.xy_m, start.level, StepModel(0.2, 0.3))

    def act() -> None:
        for k in range(STEPS):
            particles.step(1.9, 0.3 * k)

    return act


def plain_steps(accel: FloatArray, stage: Stage = "PD+H+DTW") -> FloatArray:
    """What `find_steps` finds with the default settings, one wave after the other.

    Args:
        accel: (n, 4) t_s, x, y, z in m/s2, without a gap.
        stage: See `StepDetector`.

    Returns:
        (k, 4) times at which steps begin, peak and end, and their swing in g.
    """
    params, t_s = StepParams(), accel[:, 0]
    edges_s = t_s[0] + np.arange(math.floor((t_s[-1] - t_s[0]) * RATE_HZ + 1e-9) + 1) / RATE_HZ
    grid_s = np.union1d(t_s, edges_s)
    area = cumulative_trapezoid(np.interp(grid_s, t_s, np.linalg.norm(accel[:, 1:4], axis=1)), grid_s, initial=0)
    even = np.diff(area[np.searchsorted(grid_s, edges_s)]) * RATE_HZ
    taps = firwin(params.num_taps, params.cutoff_hz, fs=RATE_HZ)
    smooth = np.convolve(np.append(np.full(params.num_taps // 2, even[0]), even), taps, mode="valid")
    waves = _waves(smooth, params)
    if stage != "PD":
        low, high = np.array(params.swing_g) * GRAVITY_MPS2
        waves = [one for one in waves if one[2] - one[0] <= params.longest_s * RATE_HZ and low <= one[3] <= high]
    if stage == "PD+H+DTW":
        valid: set[int] = set()
        shapes = [z_scored(smooth[begin : end + 1]) for begin, _, end, _ in waves]
        for i in range(2, len(waves)):
            is_near = waves[i][2] - waves[i - 2][2] <= params.wait_s * RATE_HZ
            if is_near and plain_warped_distance(shapes[i], shapes[i - 2], params.band) < params.warp_limit:
                valid |= {i - 2, i}
        waves = [waves[i] for i in sorted(valid)]
    found = np.array(waves).reshape(-1, 4)
    return np.column_stack([t_s[0] + (found[:, :3] + 0.5) / RATE_HZ, found[:, 3] / GRAVITY_MPS2])


def _waves(smooth: FloatArray, params: StepParams) -> list[tuple[int, int, int, float]]:
    """Begin, peak, end and swing in m/s2 of waves from valley to valley, see `step_kernels.turning_points`."""
    least_mps2 = params.amplitude_g * GRAVITY_MPS2
    waves: list[tuple[int, int, int, float]] = []
    high_at = low_at = 0
    valley_at = peak_at = -1
    seeks_valley = True
    for i, now in enumerate(smooth.tolist()):
        if not seeks_valley:
            high_at = i if now > smooth[high_at] else high_at
            if now < smooth[high_at] - least_mps2:
                seeks_valley, low_at, peak_at = True, i, high_at
            continue
        low_at = i if now < smooth[low_at] else low_at
        if now > smooth[low_at] + least_mps2 or i - low_at >= params.longest_s * RATE_HZ:
            is_new = valley_at < 0 or low_at - valley_at >= params.gap_s * RATE_HZ
            if is_new and valley_at >= 0 and peak_at >= 0:
                waves.append((valley_at, peak_at, low_at, smooth[peak_at] - min(smooth[valley_at], smooth[low_at])))
            if is_new or smooth[low_at] < smooth[valley_at]:
                valley_at = low_at
            seeks_valley, high_at = False, i
    return waves


def plain_warped_distance(one: FloatArray, other: FloatArray, band: int | None = None) -> float:
    """`warping.warped_distance`, cell by cell."""
    n, m = len(one), len(other)
    width = n + m if band is None else band
    least = np.full((n + 1, m + 1), np.inf)
    least[0, 0] = 0.0
    for i in range(n):
        for j in range(max(0, i - width - max(0, n - m)), min(m, i + width + max(0, m - n) + 1)):
            before = min(least[i, j], least[i, j + 1], least[i + 1, j])
            least[i + 1, j + 1] = (one[i] - other[j]) ** 2 + before
    return math.sqrt(least[n, m])
