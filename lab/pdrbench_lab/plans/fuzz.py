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
import io
import json
import logging
import os
import re
import resource
import shutil
import signal
import struct
import sys
import time
import traceback
import warnings
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

TESTS: Final = Path(__file__).parents[3] / "tests" / "samples"
MOST_S: Final = 2.0  # of processor, for a plan
MOST_MEMORY: Final = 10.0  # times the size of the plan
NOISE_BYTES: Final = 8 << 20  # by which the peak of one and the same plan differs: pages come in arenas
HANG_S: Final = 30.0
MOST_BYTES: Final = 300_000  # of a plan: larger ones are not changed further
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

Files = dict[str, bytes]


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
            main.write_bytes(files.get("", b"") or _zip(files))
            return main
        for name, content in files.items():
            (self.work / name).write_bytes(content)
        return self.work / next((name for name in self.main if name in files), min(files))

    def play(self, files: Files) -> None:
        """Reads a plan, counts how it ended, and keeps it where that is a finding or is new."""
        ends, error, took_s, rise = self._read(files)
        state, size = self.state, sum(map(len, files.values()))
        most_bytes = self.baseline + MOST_MEMORY * size + NOISE_BYTES
        if took_s > MOST_S or rise > most_bytes:  # once more: a library may have been loaded, a processor shared
            _, _, again_s, again = self._read(files)
            took_s, rise = min(took_s, again_s), min(rise, again)
        beyond = max(rise - self.baseline, 0)
        state.plans += 1
        state.reading_s += took_s
        state.buildings += ends == "building"
        state.slowest_s = max(state.slowest_s, took_s)
        state.most_bytes = max(state.most_bytes, beyond)
        state.most_memory = max(state.most_memory, max(beyond - NOISE_BYTES, 0) / max(size, 1))
        faults = {"leaks": ends == "leaks", "slow": took_s > MOST_S}
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
        if is_new and "" not in files and size < MOST_BYTES and took_s < MOST_S / 4:
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


def changed_file(rng: np.random.Generator, name: str, content: bytes, other: bytes) -> bytes:
    """A file with one change that its format invites, or a plain one of the tests; `other` lends parts of itself."""
    from plan_mutations import changed  # type: ignore[import-not-found]

    if not content:
        return bytes(rng.bytes(int(rng.integers(1, 40))))
    what = rng.random()
    if what < 0.03:
        return _changed_text(rng, content)
    if what < 0.5:
        head = content[:3]
        if head == b"\x89PN":
            return changed_png(rng, content)
        if head[:2] == b"P5":
            return changed_pgm(rng, content)
        if name.endswith(".dxf"):
            return changed_dxf(rng, content, other)
        if b"<" in content[:200] and b"\0" not in content[:200]:
            return changed_xml(rng, content, other)
        if name.endswith((".json", ".geojson")):
            return changed_document(rng, content, other)
        if name.endswith((".shp", ".dbf", ".shx")):
            return changed_words(rng, content)
    as_json = name + ".geojson" if name.endswith(".json") else name
    return bytes(changed(rng, content, as_json))


def _changed_text(rng: np.random.Generator, content: bytes) -> bytes:
    """Another encoding, a mark of one, an end too early, bytes that are no text, brackets in brackets."""
    what, place = int(rng.integers(6)), int(rng.integers(len(content) + 1))
    if what == 0:
        return content.decode("utf-8", "replace").encode(
            str(rng.choice(["utf-16", "utf-32", "utf-16-be", "utf-8-sig"]))
        )
    if what == 1:
        return content[:place]
    if what == 2:
        return content[:place] + bytes(rng.choice(list(b"\0\xff\xed\xa0\x80\x1a\r"), 3).tolist()) + content[place:]
    if what == 3:
        deep = int(rng.choice([30, 990, 5_000, 100_000]))
        return content[:place] + b"[" * deep + b"]" * deep + content[place:]
    if what == 4:
        deep = int(rng.choice([30, 990, 5_000]))
        return content[:place] + b"<a>" * deep + b"</a>" * deep + content[place:]
    return content + content


def changed_document(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """JSON in which members are moved between documents, repeated many times with a shift, put in lists, or renamed."""
    from plan_mutations import VALUES, pick, places

    try:
        document, lender = json.loads(content), json.loads(other)
    except ValueError:
        return content[::-1] if rng.random() < 0.01 else content
    every, lent = places(document), places(lender)
    if not every or not lent:
        return content
    (node, key), (from_node, from_key) = pick(rng, every), pick(rng, lent)
    what, value = int(rng.integers(6)), node[key]
    if what == 0:
        node[key] = from_node[from_key]
    elif what == 1 and isinstance(value, list) and value:
        shift = float(pick(rng, (0.0, 1e-9, 1e-5, 0.01, 3.0)))
        node[key] = [_moved(one, k * shift) for k in range(int(pick(rng, (3, 30, 300)))) for one in value[:3]]
    elif what == 2:
        for _ in range(int(pick(rng, (1, 2, 20)))):
            value = [value]
        node[key] = value
    elif what == 3 and isinstance(node, dict) and isinstance(from_node, dict):
        node[str(pick(rng, from_node))] = node.pop(key)
    elif what == 4:
        scale = float(pick(rng, (1e-12, 1e-6, 1e3, 1e6, 1e15, 1e300, -1.0)))
        node[key] = _scaled(value, scale)
    else:
        for _ in range(8):
            node, key = pick(rng, every)
            if not isinstance(node, list) or key < len(node):
                node[key] = pick(rng, VALUES)
    return json.dumps(document).encode()


def _moved(node: Any, shift: float) -> Any:
    return _each_number(node, lambda number: number + shift)


def _scaled(node: Any, scale: float) -> Any:
    return _each_number(node, lambda number: number * scale)


def _each_number(node: Any, change: Callable[[float], float]) -> Any:
    if isinstance(node, list):
        return [_each_number(one, change) for one in node]
    if isinstance(node, dict):
        return {key: _each_number(value, change) for key, value in node.items()}
    return change(node) if isinstance(node, float) else node


_ELEMENT: Final = re.compile(rb"<([A-Za-z:_]+)(?:\s[^<>]*)?(?:/>|>(?:(?!<\1[\s>]).)*?</\1>)", re.DOTALL)
_ATTRIBUTE: Final = re.compile(rb"=(?:'[^']*'|\"[^\"]*\")")
_ENTITIES: Final = (
    b"<!DOCTYPE a [<!ENTITY b 'bbbbbbbbbb'><!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;'><!ENTITY d '&c;&c;&c;&c;&c;&c;'>]>",
    b"<!DOCTYPE a SYSTEM 'file:///etc/passwd'>",
    b"<?xml version='1.0' encoding='cp037'?>",
    b"<?xml version='1.0' encoding='rot13'?>",
)


def changed_xml(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """XML in which elements are left out, moved, repeated or put in one another, attributes changed, entities added."""
    from plan_mutations import VALUES, pick

    elements, lent = list(_ELEMENT.finditer(content[:MOST_BYTES])), list(_ELEMENT.finditer(other[:MOST_BYTES]))
    attributes = list(_ATTRIBUTE.finditer(content))
    if not elements or not lent:
        return content
    one, there, what = pick(rng, elements), pick(rng, lent)[0], int(rng.integers(8))
    before, inner, after = content[: one.start()], one[0], content[one.end() :]
    if what == 0:
        return bytes(before + after)
    if what == 1:
        return bytes(before + there + after)
    if what == 2:
        return bytes(before + inner * int(pick(rng, (2, 10, 200))) + after)
    if what == 3:
        return bytes(before + there + inner + after)
    if what == 4 and b">" in inner:
        return bytes(before + inner.replace(b">", b">" + there, 1) + after)
    if what == 5:
        where = content.find(b"?>") + 2 if b"?>" in content[:100] else 0
        return content[:where] + bytes(pick(rng, _ENTITIES)) + content[where:]
    if attributes and rng.random() < 0.1:
        where = pick(rng, attributes).end()
        name: bytes = pick(rng, (b"srsDimension", b"xlink:href", b"gml:id", b"action", b"id", b"lat"))
        return content[:where] + b" " + name + b"='" + str(pick(rng, VALUES)).encode() + b"'" + content[where:]
    if attributes:
        value = pick(rng, attributes)
        text: bytes = pick(rng, attributes)[0] if what == 6 else b"='" + str(pick(rng, VALUES)).encode() + b"'"
        return content[: value.start()] + text + content[value.end() :]
    return content


def changed_dxf(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """A drawing in which pairs of code and value, or whole entities, are changed, left out, repeated or moved."""
    from plan_mutations import VALUES, pick

    pairs, lent = (one.replace(b"\r", b"").split(b"\n") for one in (content, other))
    rows, there = [pairs[k : k + 2] for k in range(0, len(pairs) - 1, 2)], lent
    inside = [k for k, row in enumerate(rows) if row[1] == b"ENTITIES"] or [0]
    starts = [k for k, row in enumerate(rows) if row[0].strip() == b"0" and k > inside[-1]] or [0]
    late = rng.random() < 0.8
    row, what = int(rng.integers(inside[-1] if late else 0, len(rows))), int(rng.integers(7))
    if what == 0:
        rows[row][1] = str(pick(rng, VALUES)).encode()
    elif what == 1:
        rows[row][0] = str(
            pick(rng, (0, 1, 2, 5, 8, 10, 11, 20, 40, 41, 50, 51, 62, 70, 90, 210, 230, 330, -1))
        ).encode()
    elif what == 2:
        del rows[row]
    elif what == 3:
        start = int(rng.choice(starts))
        end = next((k for k in starts if k > start), len(rows))
        rows[start:start] = rows[start:end] * int(pick(rng, (1, 3, 100)))
    elif what == 4 and len(there) > 60:
        start = 2 * int(rng.integers(0, len(there) // 2 - 20))
        rows[row:row] = [there[k : k + 2] for k in range(start, start + 40, 2)]
    elif what == 5:
        kind = pick(rng, ("INSERT", "LWPOLYLINE", "POLYLINE", "CIRCLE", "ARC", "ELLIPSE", "SPLINE", "HATCH", "LINE"))
        name = pick(rng, ("PLAN", "WALLS", "*Model_Space", "", "A-WALL"))
        start = int(rng.choice(starts))
        values = {8: pick(rng, ("A-WALL", "A-DOOR", "0")), 2: name, 10: 0, 20: 0, 40: pick(rng, (1, 1e9, 0, -1))}
        values |= {70: pick(rng, (0, 1, 3, 32767)), 71: pick(rng, (0, 3, 1000)), 11: 5, 21: pick(rng, (5, 1e300))}
        rows[start:start] = [[b"0", kind.encode()], *([str(k).encode(), str(v).encode()] for k, v in values.items())]
    else:
        scale = float(pick(rng, (1e-9, 1e6, 1e30, 1e300, -1)))
        for one in rows[inside[-1] :]:
            if one[0].strip() in (b"10", b"20", b"11", b"21", b"40"):
                try:
                    one[1] = repr(float(one[1]) * scale).encode()
                except ValueError:
                    continue
    return b"\n".join(part for one in rows for part in one) + b"\n"


def changed_png(rng: np.random.Generator, content: bytes) -> bytes:
    """A picture with another head or chunk under a sound sum, or with other pixels."""
    from plan_mutations import pick

    what = int(rng.integers(4))
    if what == 0:
        return _redrawn(rng, content)
    place = 8
    chunks: list[list[bytes]] = []
    while place + 12 <= len(content) and len(chunks) < 100:
        (length,) = struct.unpack(">I", content[place : place + 4])
        chunks.append([content[place + 4 : place + 8], content[place + 8 : place + 8 + length]])
        place += 12 + length
    if not chunks:
        return content
    chosen = chunks[int(rng.integers(len(chunks)))]
    if what == 1 and len(chunks[0][1]) == 13:
        head = list(struct.unpack(">IIBBBBB", chunks[0][1]))
        field = int(rng.integers(7))
        head[field] = pick(
            rng, ((0, 1, 2, 7, 600, 8000, 30_000, 2**31 - 1) if field < 2 else (0, 1, 2, 3, 4, 6, 8, 16))
        )
        chunks[0][1] = struct.pack(">IIBBBBB", *head)
    elif what == 2:
        kind = pick(
            rng, (b"tRNS", b"PLTE", b"gAMA", b"iCCP", b"tEXt", b"zTXt", b"iTXt", b"pHYs", b"acTL", b"fcTL", b"IDAT")
        )
        inner = pick(rng, (b"", b"\0", bytes(256), b"a\0\0" + zlib.compress(bytes(10**7)), rng.bytes(6), chosen[1]))
        chunks.insert(int(rng.integers(len(chunks) + 1)), [kind, inner])
    else:
        at = int(rng.integers(len(chosen[1]) + 1))
        chosen[1] = chosen[1][:at] + rng.bytes(2) + chosen[1][at + 2 :]
    made = content[:8]
    for kind, inner in chunks:
        made += struct.pack(">I", len(inner)) + kind + inner + struct.pack(">I", zlib.crc32(kind + inner))
    return made


def _redrawn(rng: np.random.Generator, content: bytes) -> bytes:
    """Lines, specks, noise, another size or mode: a sound picture of another plan."""
    from PIL import Image, ImageDraw

    try:
        image: Any = Image.open(io.BytesIO(content))
        if image.width * image.height > 4_000_000:
            return content
        image = image.convert("L")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return content
    draw, what = ImageDraw.Draw(image), int(rng.integers(8))
    for _ in range(int(rng.choice([1, 5, 60]))):
        ends = rng.integers(-20, max(image.size) + 20, 4).tolist()
        draw.line(ends, fill=int(rng.choice([0, 255, 128])), width=int(rng.integers(1, 6)))
    if what == 0:
        pixels = np.asarray(image).copy()
        speckled = rng.random(pixels.shape) < float(rng.choice([0.001, 0.05, 0.5]))
        pixels[speckled] = 255 - pixels[speckled]
        image = Image.fromarray(pixels)
    elif what == 1:
        image = image.resize(tuple(rng.choice([1, 3, 40, 600, 1500], 2).tolist()))
    elif what == 2:
        image = image.convert(str(rng.choice(["1", "P", "RGBA", "LA", "I;16", "CMYK"])).replace("CMYK", "RGB"))
    elif what == 3:
        pixels = 255 - np.asarray(image)
        image = Image.fromarray(pixels)
    elif what > 5:
        image = Image.fromarray(noise(rng))
    made = io.BytesIO()
    image.save(made, "PNG")
    return made.getvalue()


def noise(rng: np.random.Generator) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """(H, W) black and white of at most a million pixels: blocks, blobs, meshes, rings; no plan."""
    from scipy import ndimage

    high, wide = (int(side) for side in rng.choice([300, 600, 900, 1000], 2))
    fraction, size = float(rng.uniform(0.2, 0.9)), int(rng.choice([1, 2, 3, 4, 6, 8, 12, 20, 40]))
    row, column = np.mgrid[:high, :wide]
    what = int(rng.integers(6))
    if what == 0:  # blocks
        blocks = rng.random((high // size + 1, wide // size + 1)) < fraction
        is_bright = np.kron(blocks, np.ones((size, size), bool))[:high, :wide]
    elif what == 1:  # blobs
        smooth = ndimage.gaussian_filter(rng.random((high, wide)), size / 2)
        is_bright = smooth < np.quantile(smooth, fraction)
    elif what == 2:  # a mesh with gaps
        is_line = (row % (4 * size) < 2) | (column % (4 * size) < 2)
        is_bright = ~is_line | (
            ndimage.zoom(rng.random((high // size + 1, wide // size + 1)), size, order=0)[:high, :wide] > fraction
        )
    elif what == 3:  # rings, cut by spokes
        far, turn = np.hypot(row - high / 2, column - wide / 2), np.arctan2(row - high / 2, column - wide / 2)
        is_bright = (far % (2 * size + 2) >= 2) & ((turn * size % 1.0 > 0.05) | (rng.random() < 0.5))
    elif what == 4:  # a chess-board
        is_bright = (row // size + column // size) % 2 > 0
    else:  # one corridor with side corridors
        is_bright = (column % (2 * size + 2) >= 2) | ((row < 9) | (row >= high - 9)) & (
            column // (2 * size + 2) % 2 > 0
        )
    return is_bright.astype(np.uint8) * np.uint8(255)


def changed_pgm(rng: np.random.Generator, content: bytes) -> bytes:
    """A grey map with another head, fewer rows, or other cells."""
    from plan_mutations import pick

    lines = content.split(b"\n", 3)
    if len(lines) < 4:
        return content
    what = int(rng.integers(3))
    if what == 0:
        lines[1] = b" ".join(str(pick(rng, (0, 1, -1, 99, 120, 100, 10**5, 10**9))).encode() for _ in range(2))
    elif what == 1:
        lines[2] = str(pick(rng, (0, 1, 254, 256, 65535, 65536, -1))).encode()
    else:
        cells = bytearray(lines[3])
        for _ in range(int(pick(rng, (1, 20, 2000)))):
            if cells:
                cells[int(rng.integers(len(cells)))] = int(pick(rng, (0, 100, 205, 254, 255)))
        lines[3] = bytes(cells)
    return b"\n".join(lines)


def changed_words(rng: np.random.Generator, content: bytes) -> bytes:
    """A binary file in which a word of four or eight bytes has another value."""
    from plan_mutations import pick

    size, order = (8, "<d") if rng.random() < 0.4 else (4, str(pick(rng, ("<i", ">i"))))
    at = int(rng.integers(0, max(len(content) - size, 1)))
    if order == "<d":
        word = struct.pack(order, pick(rng, (0.0, -1.0, 1e9, 1e300, float("nan"), float("inf"), 3.28)))
    else:
        word = struct.pack(order, pick(rng, (0, 1, 2, 3, 5, 13, 15, 31, 100, 10**6, 2**31 - 1, -1)))
    return content[:at] + word + content[at + size :]


def changed_archive(rng: np.random.Generator, files: Files) -> Files:
    """An archive that lacks a member, names one otherwise, or whose own bytes are changed."""
    name, what = str(rng.choice(sorted(files))), int(rng.integers(4))
    rest = {key: content for key, content in files.items() if key != name}
    if what == 0 and rest:
        return rest
    if what == 1:
        return rest | {
            str(rng.choice(["unit.geojson", "../x", "a" * 300, "x.shp", name.upper(), "é.dbf"])): files[name]
        }
    whole = _zip(files)
    at = int(rng.integers(len(whole)))
    return {"": whole[:at] if what == 2 else whole[:at] + rng.bytes(2) + whole[at + 2 :]}


def _zip(files: Files) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return made.getvalue()


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
