"""Windows of recorded signals on an even grid, and how far the pedestrian moved meanwhile.

Samples lie in one file below the cache folder, which processes map; a window is cut out when it is asked for. What
changes draw follows from the seed and the numbers of the windows that are asked for together.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import PdrbenchError, unknown_name
from pdrbench.geometry import IntArray
from pdrbench.registry import EXCHANGES_GROUP, find_entry
from pdrbench.task import KNOWN_SPLITS

Floats = NDArray[np.float32]
MIN_MOVE_MPS: Final = 0.2  # slower than a heading of travel is known
TARGETS: Final[dict[str, Callable[[Floats, float], Floats]]] = {
    "displacement": lambda move_m, length_s: move_m,
    "velocity": lambda move_m, length_s: np.divide(move_m, length_s, dtype=np.float32),
    "heading": lambda move_m, length_s: move_m / np.hypot(*move_m.T)[:, None],
}


class About(NamedTuple):
    """What a change may ask: first channel and that after the last by sensor, and the device (B,) of each window."""

    channels: dict[str, tuple[int, int]]
    rate_hz: float
    device: list[str]


Change = Callable[[Floats, Floats, np.random.Generator, About], tuple[Floats, Floats]]  # of (B, C, L) and (B, 2)


class Cut(NamedTuple):
    """How windows are cut; `length` and `stride` in samples."""

    sensors: tuple[str, ...]
    length: int
    stride: int
    rate_hz: float
    frame: str


@dataclass(frozen=True, eq=False)
class Windows:
    """Data of a `torch.utils.data.DataLoader`: `[7]` is an input (C, L) and its target (2,), `[array]` has many."""

    folder: Path
    cut: Cut
    target: str  # one of `TARGETS`
    which: IntArray  # (N,) their numbers in the folder
    changes: tuple[Change, ...] = ()  # made one after the other whenever windows are asked for
    seed: int = 0  # of what changes draw

    def __len__(self) -> int:
        return len(self.which)

    def __getitem__(self, number: Any) -> tuple[Floats, Floats]:
        facts, rows, begin, move_m, walk = _opened(self.folder)
        which = np.atleast_1d(self.which[number])
        inputs = rows[begin[which][:, None] + np.arange(self.cut.length)].transpose(0, 2, 1).copy()
        targets = TARGETS[self.target](move_m[which], self.cut.length / self.cut.rate_hz)
        if self.changes:
            rng = np.random.default_rng([self.seed, *which.tolist()])
            about = About(facts[0]["channels"], self.cut.rate_hz, [facts[one]["device"] for one in walk[which]])
            for change in self.changes:
                inputs, targets = change(inputs, targets, rng, about)
        return (inputs[0], targets[0]) if np.ndim(self.which[number]) == 0 else (inputs, targets)

    def changed(self, *changes: Change, seed: int = 0) -> Windows:
        """The same windows, changed whenever they are asked for."""
        return replace(self, changes=changes, seed=seed)

    def take(self, which: Any) -> Windows:
        """Some of them: by number, or by a mask (N,)."""
        return replace(self, which=self.which[which])

    def groups(self, by: str) -> tuple[list[str], IntArray]:
        """Names of the groups by "walk", "building", "person" (or outing), "device" or "env", and that (N,) of each."""
        facts, *_, walk = _opened(self.folder)
        if by not in facts[0]:
            raise unknown_name("way of grouping windows", by, facts[0])
        names, number = np.unique([one[by] for one in facts], return_inverse=True)
        used, group = np.unique(number[walk[self.which]], return_inverse=True)
        return names[used].tolist(), group

    def leave_one_out(self, by: str) -> Iterator[tuple[str, Windows, Windows]]:
        """Each group by name: the windows of all others, and its own."""
        names, group = self.groups(by)
        return ((name, self.take(group != one), self.take(group == one)) for one, name in enumerate(names))

    def batches(
        self, size: int, evenly: Sequence[str] = (), *, seed: int = 0, count: int | None = None
    ) -> list[IntArray]:
        """Numbers of windows (size,) to be asked for together: `sampler` of a `DataLoader` with `batch_size=None`.

        They are drawn with replacement, as many as windows would fill, or `count`. Groups of `evenly` are equally
        likely, and then the groups in each, as ("building", "person"); without them all windows are.
        """
        chance, inside = np.ones(len(self)), np.zeros(len(self), np.int64)
        for by in evenly:
            pairs, finer = np.unique(np.stack([inside, self.groups(by)[1]]), axis=1, return_inverse=True)
            chance, inside = chance / np.bincount(pairs[0])[inside], finer.ravel()
        below = np.cumsum(chance / np.bincount(inside)[inside])
        drawn = np.random.default_rng(seed).random((len(self) // size if count is None else count, size))
        return list(np.searchsorted(below / below[-1], drawn, side="right"))


def windows(
    env: str | Sequence[str],
    split: str = "train",
    *,
    sensors: Sequence[str] = ("accel", "gyro"),
    length_s: float = 1.0,
    stride_s: float = 0.1,
    target: str = "displacement",
    rate_hz: float = 50.0,
    frame: str = "level",
    walks: int | None = None,
    jobs: int = 1,
) -> Windows:
    """Windows of the walks of a split, cut once and kept below the cache folder.

    Args:
        env: As `make_task` takes it, or several.
        split: "train" or "val": windows hold the truth.
        sensors, rate_hz: Each sample is the mean of a sensor over a cell of the grid.
        length_s, stride_s: Of windows, and between their beginnings.
        target: "displacement" (m), "velocity" (m/s) or "heading" (a unit vector) from beginning to end of a window, in
            the frame of the building. Between places that are rare the way is straight, as fast as steps are taken.
        frame: "level": vectors turned by the rotation vector, z up, with the errors of the compass; "device".
        walks: Only the first so many of each environment.
        jobs: Processes that cut; the numbers are the same for any.

    Raises:
        PdrbenchError: Truth that is not public, no such sensor or target, or not one window.
    """
    if split not in KNOWN_SPLITS:
        raise PdrbenchError(f"windows hold the truth, which is for {' and '.join(KNOWN_SPLITS)} only; got {split!r}")
    for kind, name, known in (("target", target, TARGETS), ("frame", frame, ("level", "device"))):
        if name not in known:
            raise unknown_name(kind, name, known)
    length, stride = length_s * rate_hz, stride_s * rate_hz
    if min(length, stride) < 1 or abs(length - round(length)) + abs(stride - round(stride)) > 1e-6:
        raise PdrbenchError(f"length_s {length_s:g} and stride_s {stride_s:g} are no whole samples at {rate_hz:g} Hz")
    cut = Cut(tuple(sensors), round(length), round(stride), float(rate_hz), frame)
    keep = find_entry(EXCHANGES_GROUP, "exchange", "kept_windows").load()
    folder: Path = keep((env,) if isinstance(env, str) else tuple(env), split, walks, cut, jobs)
    least_m = MIN_MOVE_MPS * length_s if target == "heading" else 0.0
    which = np.flatnonzero(np.hypot(*_opened(folder)[3].T) >= least_m)
    if not len(which):
        raise PdrbenchError(f"no window of {split!r} is {length_s:g} s long, of {', '.join(sensors)} without a gap")
    return Windows(folder, cut, target, which)


@functools.lru_cache(maxsize=8)
def _opened(folder: Path) -> tuple[list[dict[str, Any]], Floats, IntArray, Floats, IntArray]:
    """Facts on walks, samples (n, C) of all, and of windows first samples (N,), moves (N, 2) and walks (N,)."""
    facts = json.loads((folder / "facts.json").read_text(encoding="utf-8"))
    rows, begin, move_m, walk = (np.load(folder / f"{name}.npy", "r") for name in ("rows", "begin", "move_m", "walk"))
    return facts, rows, begin, move_m, walk
