"""Plans changed by chance for ten minutes of each kind: what readers leak, what takes them long, what takes memory.

    python -m pdrbench_lab.plans.fuzz FOLDER                     each kind until it has had 600 s of processor
    python -m pdrbench_lab.plans.fuzz FOLDER --kind dxf --piece 300
    python -m pdrbench_lab.plans.fuzz FOLDER --kind osm --guided  by coverage, with atheris

It runs in a checkout, from whose tests it takes its samples and its plain changes. One process; each piece goes on
where the last one ended: FOLDER/KIND/state.json has the sums, FOLDER/KIND/found/ each plan that was no building and no
documented error, or took more than 2 s of processor, or more than ten times its size of memory beyond what the
unchanged plan takes. A plan that gave a building, or an error with words that are new, is changed further.
"""

from __future__ import annotations

import argparse
import ctypes
import dataclasses
import gc
import importlib
import json
import logging
import os
import re
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from .changes import MAX_PLAN_BYTES, Files, changed_archive, changed_file, packed

TESTS: Final = Path(__file__).parents[3] / "tests" / "samples"
MAX_S: Final = 2.0  # of processor, for a plan
MAX_MEMORY: Final = 10.0  # times the size of the plan
NOISE_BYTES: Final = 8 << 20  # by which the peak of one and the same plan differs: pages come in arenas
HANG_S: Final = 30.0
POOL: Final = 300
ADDRESS_SPACE: Final = 8 << 30
SEEDS: Final[Mapping[str, tuple[str, ...]]] = {
    "imdf": ("imdf", "manifest without version"),
    "osm": ("osm_indoor", "doors as lines", "doors without level", "osm in utf-16"),
    "overpass": ("overpass out geom", "overpass out body"),
    "geojson_plan": ("geojson_plan", "closed lines as rooms", "levels with a point", "millimetres", "utf-16"),
    "tags": ("nested tags",),
    "indoorgml": ("indoorgml 1.0", "indoorgml 1.1", "shared faces"),
    "patches": ("patches",),
    "picture": ("picture",),
    "ros_map": ("ros_map", "nav2"),
    "dxf": ("dxf", "layer of a nested block", "layers with umlauts"),
    "shapefile": ("shapefile",),
    "layers": ("layers of a drawing",),
}
TOO_MUCH: Final = ("leaks", "slow", "big", "died")


class _Hangs(BaseException):
    """More than `HANG_S` of processor in one reader."""


@dataclasses.dataclass
class State:
    """What a kind has had so far; seconds are of the processor."""

    seconds: float = 0.0
    reading_s: float = 0.0
    plans: int = 0
    buildings: int = 0
    leaks: int = 0
    slow: int = 0
    big: int = 0
    died: int = 0
    slowest_s: float = 0.0
    most_memory: float = 0.0  # times the size, beyond the unchanged plan
    most_bytes: int = 0  # beyond the unchanged plan
    guided_s: float = 0.0  # of `seconds`


class Fuzzer:
    """One kind of plan, its samples, and what was found in it."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.folder, self.kind = folder / kind, kind
        self.found, self.work = self.folder / "found", self.folder / "work"
        for place in (self.found, self.work):
            place.mkdir(parents=True, exist_ok=True)
        stored = self.folder / "state.json"
        self.state = State(**json.loads(stored.read_text())) if stored.exists() else State()
        if any(self.work.iterdir()):  # the process ended in a reader
            self.state.died += 1
            shutil.copytree(self.work, self.found / f"died-{self.state.died}", dirs_exist_ok=True)
        self.rng = np.random.default_rng([*kind.encode(), self.state.plans])
        self.pool, self.main, self.zipped = _samples(kind, self.folder / "samples")
        self.num_samples, self.words = len(self.pool), set[str]()
        self.baseline = 0
        for content in (b"a,b\n1,2\n", b"<a/>", b"{}", b"\0"):  # loads what is loaded once to look at what is no plan
            self._read(dict.fromkeys(self.pool[0], content))
        for _ in range(2):  # the second time everything is compiled
            self.baseline = max(self._read(files)[3] for files in self.pool)
        self.began_s = time.process_time()

    def _read(self, files: Files) -> tuple[str, BaseException | None, float, int]:
        """How a plan ends: "building", "refused" or "leaks"; with what error, seconds of processor, rise of memory."""
        from pdrbench.building.connectivity import reachable_parts
        from pdrbench.errors import PdrbenchError
        from pdrbench_formats.detect import read_plan

        path = self._written(files)
        gc.collect(0)
        _TRIM(0)
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins anew
        before, began_s = _memory()[1], time.process_time()
        ends: str = "building"
        error: BaseException | None = None
        signal.setitimer(signal.ITIMER_PROF, HANG_S)
        try:
            plan = read_plan(path, doors="nearest")
            if len(reachable_parts(plan.building)) != len(plan.building.polygons):
                raise AssertionError("parts that the building does not count")
        except PdrbenchError as found:
            ends, error = "refused", found
            if str(self.work) not in str(found):
                ends = "leaks"  # it names no file
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as found:  # noqa: BLE001 - what readers leak is what is looked for
            ends, error = "leaks", found
        signal.setitimer(signal.ITIMER_PROF, 0)
        took_s = time.process_time() - began_s
        rise = _memory()[0] - before
        for left in self.work.iterdir():
            left.unlink()
        return ends, error, took_s, max(rise, 0)

    def _written(self, files: Files) -> Path:
        main = self.work / self.main[0]
        if self.zipped:
            main.write_bytes(files.get("", b"") or packed(files))
            return main
        for name, content in files.items():
            (self.work / name).write_bytes(content)
        return self.work / next((name for name in self.main if name in files), min(files))

    def play(self, files: Files) -> None:
        """Reads a plan, counts how it ended, and keeps it where that is a finding or is new."""
        ends, error, took_s, rise = self._read(files)
        state, size = self.state, sum(map(len, files.values()))
        most_bytes = self.baseline + MAX_MEMORY * size + NOISE_BYTES
        if took_s > MAX_S or rise > most_bytes:  # once more: a library may have been loaded, a processor shared
            _, _, again_s, again = self._read(files)
            took_s, rise = min(took_s, again_s), min(rise, again)
        beyond = max(rise - self.baseline, 0)
        state.plans += 1
        state.reading_s += took_s
        state.buildings += ends == "building"
        state.slowest_s = max(state.slowest_s, took_s)
        state.most_bytes = max(state.most_bytes, beyond)
        state.most_memory = max(state.most_memory, max(beyond - NOISE_BYTES, 0) / max(size, 1))
        faults = {"leaks": ends == "leaks", "slow": took_s > MAX_S}
        faults["big"] = rise > most_bytes
        for name in (name for name, is_one in faults.items() if is_one):
            setattr(state, name, getattr(state, name) + 1)
            place = self.found / f"{name}-{_where(error) if name == 'leaks' else int(time.time()) // 60}"
            if place.exists():  # one of each place, or of each minute, says as much
                continue
            place.mkdir()
            for file, content in files.items():
                (place / (Path(file).name or "whole")).write_bytes(content)
            lines = traceback.format_exception(error) if error else []
            (place / "error.txt").write_text(f"{took_s:.2f} s, {beyond} bytes of {size}\n" + "".join(lines))
        words = ends + re.sub(r"[\d.]+|'[^']*'|\"[^\"]*\"", "", str(error))[:200]
        is_new = words not in self.words or (ends == "building" and self.rng.random() < 0.2)
        if is_new and "" not in files and size < MAX_PLAN_BYTES and took_s < MAX_S / 4:
            self.words.add(words)
            self.pool.append(files)
            if len(self.pool) > POOL:
                del self.pool[int(self.rng.integers(self.num_samples, POOL))]

    def changed(self) -> Files:
        """A plan of the pool with some changes; RecursionError where it is nested too deep for that."""
        rng = self.rng
        sample = self.pool[int(rng.integers(self.num_samples if rng.random() < 0.3 else len(self.pool)))]
        files = dict(sample)
        for _ in range(int(rng.integers(1, 4))):
            name = str(rng.choice(sorted(files)))
            other = self.pool[int(rng.integers(len(self.pool)))].get(name, files[name])
            files[name] = changed_file(rng, name, files[name], other)
        if self.zipped and rng.random() < 0.1:
            files = changed_archive(rng, files)
        return files

    def store(self) -> None:
        """Adds the time since the last call to the sums, and writes them."""
        now_s = time.process_time()
        self.state.seconds += now_s - self.began_s
        self.began_s = now_s
        part = self.folder / "state.part"
        part.write_text(json.dumps(dataclasses.asdict(self.state), indent=1))
        part.replace(self.folder / "state.json")

    def run(self, until_s: float) -> None:
        """Changes and reads until the kind has had so many seconds."""
        dropped = 0
        while self.state.seconds < until_s:
            for _ in range(20):
                try:
                    files = self.changed()
                except RecursionError:  # of the changes, no finding: the plan is dropped
                    dropped += 1
                    continue
                self.play(files)
            self.store()
        print(f"{self.kind}: {dropped} dropped", file=sys.stderr)  # noqa: T201

    def run_guided(self, until_s: float) -> None:
        """As `run`, by coverage: half of the changes are of bytes, by libFuzzer. It does not return."""
        atheris: Any = importlib.import_module("atheris")

        corpus = self.folder / "corpus"
        corpus.mkdir(exist_ok=True)
        name = next(name for name in (*reversed(self.main), *self.pool[0]) if name in self.pool[0])
        for number, files in enumerate(self.pool[: self.num_samples]):
            (corpus / f"sample{number}").write_bytes(files.get(name, b""))
        beside = self.pool[0]

        def mutate(content: bytes, max_size: int, seed: int) -> bytes:
            rng = np.random.default_rng(seed)
            if rng.random() < 0.5:
                return bytes(atheris.Mutate(content, max_size))
            try:
                return changed_file(rng, name, content or b" ", content or b" ")[:max_size]
            except RecursionError:
                return content

        def one(content: bytes) -> None:
            self.play({**beside, name: content})
            if self.state.plans % 20 == 0:
                before = self.state.seconds
                self.store()
                self.state.guided_s += self.state.seconds - before
                if self.state.seconds >= until_s:
                    self.store()
                    os._exit(0)

        flags = [sys.argv[0], "-max_len=60000", "-timeout=600", "-rss_limit_mb=0", f"-artifact_prefix={self.folder}/"]
        atheris.Setup([*flags, str(corpus)], one, custom_mutator=mutate)
        atheris.Fuzz()


_TRIM: Final[Callable[[int], int]] = ctypes.CDLL(None).malloc_trim


def _where(error: BaseException | None) -> str:
    """The kind of an error and the last place of this house that it came through."""
    frames = traceback.extract_tb(error.__traceback__ if error else None)
    own = [frame for frame in frames if "pdrbench" in frame.filename and "fuzz" not in frame.filename]
    return f"{type(error).__name__}" + (f"-{Path(own[-1].filename).stem}-{own[-1].lineno}" if own else "")


def _memory() -> tuple[int, int]:
    """Bytes of memory of this process: the most so far, and now."""
    text = Path("/proc/self/status").read_text()
    return tuple(1024 * int(re.search(rf"{name}:\s*(\d+)", text)[1]) for name in ("VmHWM", "VmRSS"))  # type: ignore[index,return-value]


def _samples(kind: str, folder: Path) -> tuple[list[Files], list[str], bool]:
    """The unchanged plans of a kind as their files, or members of their archive; names of the file that is read."""
    from plan_samples import FOREIGN, MADE, house, plain  # type: ignore[import-not-found]

    made = {**{name: make for name, (make, _) in MADE.items()}, **FOREIGN}
    made["geojson_plan"] = lambda place: plain(house(), place / "house.geojson")
    pool, main, zipped = [], [], False
    for number, seed in enumerate(SEEDS[kind]):
        place = folder / str(number)
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        path = made[seed](place)
        main.append(path.name)
        if zipped := zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                pool.append({name: archive.read(name) for name in archive.namelist()})
        else:
            kept = place.iterdir() if kind in ("picture", "ros_map") else [path]
            pool.append({one.name: one.read_bytes() for one in sorted(kept)})
    return pool, main, zipped


def _hangs(*_: object) -> None:
    raise _Hangs


def print_sums(folder: Path) -> int:
    """One line for each kind; returns how many findings there are."""
    names = [field.name for field in dataclasses.fields(State)]
    print("kind".ljust(14), *(name.rjust(11) for name in names))  # noqa: T201
    found = 0
    for place in sorted(folder.glob("*/state.json")):
        one = json.loads(place.read_text())
        found += sum(one[name] for name in TOO_MUCH)
        print(place.parent.name.ljust(14), *(f"{one[name]:11.{2 * isinstance(one[name], float)}f}" for name in names))  # noqa: T201
    return found


def main() -> None:
    """Runs one piece; ends with 1 where anything was found so far."""
    parser = argparse.ArgumentParser(prog="python -m pdrbench_lab.plans.fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="State and findings; a later call goes on there.")
    parser.add_argument("--kind", choices=SEEDS, action="append", help="As often as wanted; without it, all.")
    parser.add_argument(
        "--seconds", type=float, default=600.0, help="Of processor, for each kind, all pieces together."
    )
    parser.add_argument("--piece", type=float, default=500.0, help="Of processor, for this call.")
    parser.add_argument("--guided", action="store_true", help="By coverage: one kind, for one piece beyond the others.")
    options = parser.parse_args()
    sys.path.insert(0, str(TESTS))
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    signal.signal(signal.SIGPROF, _hangs)
    logging.disable()
    warnings.simplefilter("ignore")  # of numbers that overflow
    if options.guided:
        atheris: Any = importlib.import_module("atheris")
        with atheris.instrument_imports(include=["pdrbench_formats", "pdrbench.building", "pdrbench.io"]):
            import pdrbench_formats.detect  # noqa: F401
        fuzzer = Fuzzer(options.folder, (options.kind or ["osm"])[0])
        fuzzer.run_guided(fuzzer.state.seconds + options.piece)
    left_s = options.piece
    for kind in options.kind or SEEDS:
        fuzzer = Fuzzer(options.folder, kind)
        had_s = fuzzer.state.seconds
        fuzzer.run(min(options.seconds, had_s + left_s))
        left_s -= fuzzer.state.seconds - had_s
    sys.exit(int(print_sums(options.folder) > 0))


if __name__ == "__main__":
    main()
