"""The particle filter of Woodman & Harle 2008 on the replica of their building, beside alternatives."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numba
import numpy as np

from pdrbench.building import Building, FloorRegion
from pdrbench.building.building import snapped_edges
from pdrbench.building.kernels import walk_segment
from pdrbench.compiled import compiled, in_threads
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench_baselines.woodman2008.map_filter import WoodmanFilter
from pdrbench_baselines.woodman2008.params import HeadingPrior, WoodmanFilterParams
from pdrbench_baselines.woodman2008.warm import warm_up
from pdrbench_lab.papers.woodman2008.gpu_localizer import why_no_gpu
from pdrbench_lab.papers.woodman2008.literal import FILTERS, LiteralFilter
from pdrbench_lab.speed.timing import Prepared, Timing, median_s

PARTICLES: Final = 4_530_000  # W11: the uniform prior of the paper
PAPER_PER_S: Final = 274_000 / 1.1  # W12
WALKS: Final = 256  # tracked at once on a GPU
STRIDE: Final = (1.2, 0.0, 0.05)  # length, rise, turn of the stride that is timed
NUMPY: Final = "tuned NumPy filter in float32 without a map, one thread"
SIMPLE: Final = "simple float64 kernel, one thread"


def run(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """All rows; `tell` receives what comes next."""
    from pdrbench_lab.papers.woodman2008.lab_stride.lab import make_lab

    tell("compiling")
    warm_up()
    building = make_lab(np.random.default_rng(0))
    count = PARTICLES // 10 if quick else PARTICLES
    rounds = 3 if quick else 7
    reason = why_no_gpu()
    if reason:
        tell(f"left out the GPU: {reason}")
    tell(f"{count:,} particles")
    rows = _large(building, count, rounds, gpu=not reason)
    tell("tracking")
    rows += _tracking(building, 200 if quick else 2000)
    if not reason:
        tell(f"tracking {WALKS} walks at once")
        rows.append(_walks_at_once(building, 50 if quick else 500))
    tell("first step")
    return [*rows, _first_step()]


def _large(building: Building, count: int, rounds: int, *, gpu: bool) -> list[Timing]:
    """Full step, its parts and the alternatives, all with the same number of particles."""
    fixed = WoodmanFilterParams(min_particles=count, max_particles=count)
    fast = WoodmanFilter(building, np.random.default_rng(1), fixed)
    region = FloorRegion.whole(building)
    plain = NumpyFilter.draw(np.random.default_rng(2), building, count)
    few = count // 10
    literal = LiteralFilter(building, np.random.default_rng(3), replace(fixed, min_particles=few, max_particles=few))
    simple = simple_step(np.random.default_rng(4), building, few)
    source, target = np.zeros(count * 5, np.float32), np.zeros(count * 5, np.float32)

    def from_prior(particles: Any, act: Callable[..., object]) -> Prepared:
        def prepare() -> Callable[[], object]:
            particles.start(region)
            return lambda: act(*STRIDE)

        return prepare

    things: dict[str, Prepared] = {
        "fast": from_prior(fast, fast.update),
        "numpy": lambda: lambda: plain.step(*STRIDE),
        "advance": from_prior(fast, fast.propagate),
        "simple": lambda: simple,
        "literal": from_prior(literal, literal.update),
        "copy": lambda: lambda: in_threads(_copy, (len(source) + _PART - 1) // _PART, source, target),
    }
    if gpu:
        from pdrbench_lab.papers.woodman2008.gpu_filter import GpuFilter

        device = GpuFilter(building, np.random.default_rng(1), fixed)
        from_prior(device, device.update)()()  # compiles
        things["gpu"] = from_prior(device, device.update)
    taken = median_s(things, rounds)
    per_s = {name: count / s for name, s in taken.items()} | {name: few / taken[name] for name in ("simple", "literal")}
    bandwidth = 2 * source.nbytes / taken["copy"]
    threads = numba.get_num_threads()
    on_gpu = [_rate("full_step_on_gpu", per_s["gpu"], per_s["fast"], f"full_step, {threads} threads")] if gpu else []
    return [
        _rate("full_step", per_s["fast"], per_s["numpy"], NUMPY),
        _rate("full_step_against_paper", per_s["fast"], PAPER_PER_S, "Java on a 2.6 GHz machine of 2008 (W12)"),
        _rate("full_step_against_literal", per_s["fast"], per_s["literal"], "literal mode, one thread"),
        _rate("propagate_correct", per_s["advance"], per_s["simple"], SIMPLE),
        *(_rate(name, per_s[name]) for name in ("numpy", "simple", "literal")),
        Timing(
            "bandwidth_share",
            BYTES_MOVED * per_s["fast"] / bandwidth,
            "",
            f"copying memory at {bandwidth / 1e9:.0f} GB/s",
            None,
        ),
        Timing("memory", fast.nbytes / fast.num_particles, "B/particle"),
        Timing("threads", float(threads), ""),
        *on_gpu,
    ]


# Memory traffic of a full step per particle, at least: resampling reads weight and cell twice and the state once; it is
# written sorted, then read, moved and written, with a weight. 8 + 8 + 12 + 16 + 16 + 20 bytes.
BYTES_MOVED: Final = 80
_PART: Final = 1 << 16  # bytes that are copied at a time


def _rate(name: str, per_s: float, other_per_s: float | None = None, against: str = "") -> Timing:
    ratio = None if other_per_s is None else per_s / other_per_s
    return Timing(name, per_s / 1e6, "M particles/s", against, ratio)


def _tracking(building: Building, strides: int) -> list[Timing]:
    """A stride of a converged filter, walking on the spot in the middle of a corridor."""
    rows = []
    region = _corridor(building)
    for count in (170, 500):
        params = WoodmanFilterParams(min_particles=count, max_particles=count)

        def walk(kind: type[WoodmanFilter] | type[LiteralFilter], params: WoodmanFilterParams) -> Prepared:
            particles = kind(building, np.random.default_rng(1), params)

            def act() -> None:
                for stride in range(strides):
                    particles.update(0.3 if stride % 2 else -0.3, 0.0, 0.0)

            def prepare() -> Callable[[], object]:
                particles.start(region, HeadingPrior(0.0, 0.1))
                return act

            return prepare

        taken = median_s({name: walk(kind, params) for name, kind in FILTERS.items()}, 5)
        ratio = taken["literal"] / taken["fast"]
        rows.append(Timing(f"tracking_{count}", taken["fast"] / strides * 1e6, "us/stride", "literal mode", ratio))
    return rows


def _walks_at_once(building: Building, strides: int) -> Timing:
    """A stride of each of many converged filters on a GPU, beside one after the other on one thread."""
    from pdrbench_lab.papers.woodman2008.gpu_filter import GpuFilters

    region, heading, count = _corridor(building), HeadingPrior(0.0, 0.1), 500
    params = WoodmanFilterParams(min_particles=count, max_particles=count)
    one = WoodmanFilter(building, np.random.default_rng(1), params)
    many = GpuFilters(building, np.random.default_rng(1).spawn(WALKS), params)

    def walk_one() -> None:
        for stride in range(strides):
            one.update(0.3 if stride % 2 else -0.3, 0.0, 0.0)

    def walk_many() -> None:
        for stride in range(strides):
            many.update(np.tile([0.3 if stride % 2 else -0.3, 0.0, 0.0], (WALKS, 1)))

    def prepare(particles: Any, act: Callable[[], object]) -> Prepared:
        def begin() -> Callable[[], object]:
            particles.start(region, heading)
            return act

        return begin

    prepare(many, walk_many)()()  # compiles
    taken = median_s({"one": prepare(one, walk_one), "many": prepare(many, walk_many)}, 5)
    ratio = taken["one"] * WALKS / taken["many"]
    per_stride_us = taken["many"] / strides / WALKS * 1e6
    return Timing(f"tracking_{count}_on_gpu_{WALKS}_walks", per_stride_us, "us/stride", "one thread", ratio)


def _corridor(building: Building) -> FloorRegion:
    """About a square metre of the largest corridor."""
    corridors = [(p.area_m2, i) for i, p in enumerate(building.polygons) if "corridor" in p.id]
    polygon = max(corridors)[1]
    place = building.polygons[polygon].outline_xy_m.mean(axis=0)
    a, b, c, d = place + 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return FloorRegion(np.array([[a, b, c], [a, c, d]]), np.array([polygon, polygon]))


_FIRST = """
import time, numpy as np
from pdrbench.building import FloorRegion
from pdrbench_baselines.woodman2008.map_filter import WoodmanFilter
from pdrbench_sim.buildings.office import make_office
building = make_office(np.random.default_rng(0), num_levels=2, area_m2=1500.0)
began = time.perf_counter()
particles = WoodmanFilter(building, np.random.default_rng(0))
particles.start(FloorRegion.whole(building))
particles.update(1.2, 0.0, 0.0)
print(time.perf_counter() - began)
"""


def _first_step() -> Timing:
    """In a new process, compiled code in the cache: loading it, cutting the map into cells, prior and first stride."""
    taken = [
        float(subprocess.run([sys.executable, "-c", _FIRST], check=True, capture_output=True, text=True).stdout)
        for _ in range(3)
    ]
    return Timing("first_step", min(taken), "s")


@compiled
def _copy(part: Any, source: Any, target: Any) -> None:
    for b in range(part[0], part[1]):
        target[b * _PART : (b + 1) * _PART] = source[b * _PART : (b + 1) * _PART]


@dataclass(slots=True)
class NumpyFilter:
    """The same step in NumPy, without a map: float32, in blocks that fit into the cache, nothing allocated in a block.

    Weights come from a smooth function of the place, since there are no walls.
    """

    rng: np.random.Generator
    x: Any
    y: Any
    heading: Any
    weight: Any
    marks: BoolArray
    origin_xy_m: FloatArray

    BLOCK = 1 << 14

    @classmethod
    def draw(cls, rng: np.random.Generator, building: Building, count: int) -> NumpyFilter:
        """Uniform over the floor."""
        _, xy_m = building.sample_uniform(rng, count)
        origin = np.floor(xy_m.min(axis=0)) - 8
        size = np.ceil(xy_m.max(axis=0) - origin).astype(np.int64) + 16
        x, y = (xy_m - origin).T.astype(np.float32)
        heading = rng.uniform(-np.pi, np.pi, count).astype(np.float32)
        marks = np.zeros(int(size.prod()) * 36, dtype=np.bool_)
        return cls(rng, x.copy(), y.copy(), heading, np.ones(count, np.float32), marks, size)

    def step(self, length_m: float, rise_m: float, turn_rad: float) -> None:
        """Resample, perturb, move, weigh, count bins."""
        count = len(self.x)
        running = np.cumsum(self.weight, dtype=np.float64)
        below = np.ceil(running * (count / running[-1]) - self.rng.random()).astype(np.int64)
        copies = np.diff(np.minimum(below, count), prepend=0)
        chosen = np.repeat(np.arange(count, dtype=np.int32), copies)
        self.x, self.y, self.heading = self.x[chosen], self.y[chosen], self.heading[chosen]
        self.weight = np.empty(len(chosen), np.float32)
        self.marks[:] = False
        width, height = self.origin_xy_m
        f = np.float32
        noise = np.empty(self.BLOCK, np.float32)
        for low in range(0, len(chosen), self.BLOCK):
            part = slice(low, min(low + self.BLOCK, len(chosen)))
            x, y, heading, z = self.x[part], self.y[part], self.heading[part], noise[: part.stop - low]
            self.rng.standard_normal(out=z, dtype=np.float32)
            z *= f(math.radians(0.6))
            heading += z
            heading += f(turn_rad)
            heading -= f(2 * np.pi) * np.floor((heading + f(np.pi)) / f(2 * np.pi))
            self.rng.standard_normal(out=z, dtype=np.float32)
            z *= f(0.15)
            z += f(length_m)
            x += z * np.cos(heading)
            y += z * np.sin(heading)
            self.weight[part] = np.exp(f(-0.5) * np.square((x - f(width / 2)) / f(width)))
            column = np.clip(x.astype(np.int32), 0, width - 1)
            row = np.clip(y.astype(np.int32), 0, height - 1)
            turn = ((heading + f(np.pi)) * f(18 / np.pi)).astype(np.int32)
            self.marks[(row * width + column) * 36 + np.clip(turn, 0, 35)] = True
        np.count_nonzero(self.marks)


def simple_step(rng: np.random.Generator, building: Building, count: int) -> Callable[[], object]:
    """Propagates and corrects with the float64 kernel of `Building.move`, particle by particle.

    They are uniform over the floor and sorted by polygon as the fast ones are; they stay, so that every round does the
    same.
    """
    polygon, xy_m = building.sample_uniform(rng, count)
    order = np.argsort(polygon, kind="stable")
    particles = polygon[order], xy_m[order], rng.uniform(-np.pi, np.pi, count)
    heights = building.height(np.arange(len(building.polygons)))
    return lambda: _simple(rng, *particles, STRIDE, heights, snapped_edges(building))


@compiled
def _simple(rng: Any, polygon: Any, xy_m: Any, heading_rad: Any, stride: Any, heights: Any, edges: Any) -> Any:
    length_m, rise_m, turn_rad = stride
    weight = np.empty(len(polygon))
    for i in range(len(polygon)):
        length = length_m + 0.15 * rng.standard_normal()
        heading = heading_rad[i] + turn_rad + math.radians(0.6) * rng.standard_normal()
        x, y = xy_m[i, 0] + length * math.cos(heading), xy_m[i, 1] + length * math.sin(heading)
        end, alive = walk_segment(polygon[i], xy_m[i, 0], xy_m[i, 1], x, y, edges)
        off = rise_m - (heights[end] - heights[polygon[i]])
        weight[i] = math.exp(-off * off / (2 * 0.1 * 0.1)) if alive else 0.0
    return weight
