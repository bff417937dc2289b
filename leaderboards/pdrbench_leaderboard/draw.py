"""Draw: of the walks of a board, what a localizer may see, and apart from it what only scoring may.

A drawn part is two folders of plain files. `observations` can be played anywhere: it is a task without references,
whose walks have names that say nothing, canaries among them. `truth` stays with whoever scores. Neither holds the
secret.
"""

from __future__ import annotations

import functools
import hashlib
import hmac
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.building import Building
from pdrbench.errors import ResultError
from pdrbench.evaluation.origin import environment_version, package_sha256, versions
from pdrbench.evaluation.progress import reporting
from pdrbench.evaluation.randomness import secret_nonce
from pdrbench.evaluation.store import make_folder, write_whole
from pdrbench.files import sha256_of
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench.process.serialise import decoder, encoder
from pdrbench.recording import Recording, SensorSpec, SensorStream
from pdrbench.registry import environment_packages
from pdrbench.result import COMPLETE
from pdrbench.task import StartKnowledge, Task
from pdrbench.trajectory import Start, Trajectory
from pdrbench_leaderboard.boards import PRIVATE, BoardEnvironment, Part
from pdrbench_leaderboard.canaries import Canary, crossed, cut_short, plan

OBSERVATIONS, TRUTH, INDEX_FILE, TASK_FILE = "observations", "truth", "index", "task.py"
CANARIES_FILE, MADE_BY_FILE = "canaries", "made_by"  # beside the truth
SUFFIX: Final = ".walk"
LEVEL: Final = 1  # of zlib: a fifth of the time of level 6 for a tenth more bytes
NAME_DIGITS: Final = 16
HELD_OUT_PART: Final = "held-out"  # which ranks: only there are canaries
FREQUENCY_HZ: Final = 1.0  # at most so many scored moments
# Makes the folder an environment for `evaluate`, as any file with a function is
TASK_SOURCE: Final = '''"""Walks of a board without their references."""

from pathlib import Path

from pdrbench_leaderboard.draw import drawn_task

INDEX_SHA256 = "{sha256}"  # no two of these files are alike


def task():
    return drawn_task(Path(__file__).parent)
'''


class DrawnWalk(msgspec.Struct, array_like=True, frozen=True):
    """What a localizer may see of a walk."""

    briefing: Briefing
    rows: dict[str, FloatArray]  # (T, C) of each sensor
    end_s: float


class Index(msgspec.Struct, frozen=True):
    """What is the same for all walks of a drawn part."""

    env: str
    nonce: str  # of the localizers' randomness
    sensors: tuple[SensorSpec, ...]
    capacity: dict[str, int]
    period_s: float
    start: StartKnowledge
    walks: dict[str, str]  # sha256 of the file of each, by name
    means: dict[str, str]  # magnitudes of what is in all files, to four digits
    random_as: dict[str, str] = {}  # name of the walk whose random numbers a walk has, where they are not its own


class Truth(msgspec.Struct, array_like=True, frozen=True):
    """What only scoring may see of a walk."""

    reference: Trajectory  # moments that are scored, one a second at most
    plan: bytes  # of `building`, which many walks share
    fallback: Start  # where the pedestrian counts as being before the first answer
    unit: str
    groups: tuple[str, ...]
    duration_s: float
    walk: str  # id in its environment

    @property
    def building(self) -> Building | None:
        """Where it was."""
        return _building(self.plan)


@dataclass(frozen=True, slots=True)
class DrawnPart:
    """Where the walks of one part of an environment lie, in a folder for all parts."""

    env: str
    part: Part
    folder: Path

    @property
    def observations(self) -> Path:
        """What a machine needs that plays."""
        return self.folder / OBSERVATIONS / self.env / self.part

    @property
    def truth(self) -> Path:
        """What a machine needs that scores."""
        return self.folder / TRUTH / self.env / self.part

    @property
    def index(self) -> Index:
        """What is known of all walks."""
        return read_index(self.observations)

    @property
    def made_by(self) -> str:
        """Versions of what drew it; not of the index, which says what was given: the same walks of a newer version are
        those that were played."""
        path = self.truth / MADE_BY_FILE
        return path.read_text(encoding="ascii") if path.is_file() else ""

    @property
    def canaries(self) -> dict[str, Canary]:
        """By name; raises `ResultError`."""
        found: dict[str, Canary] = _unpacked(self.truth / CANARIES_FILE, dict[str, Canary])
        return found

    @property
    def walks(self) -> list[str]:
        """Names of those that are scored."""
        canaries = self.canaries
        return [name for name in self.index.walks if name not in canaries]


def made_by(listed: BoardEnvironment, part: Part) -> str:
    """Versions of what draws the walks of a part, and how many: what agrees is used again."""
    packages = sorted({"pdrbench_leaderboard", *environment_packages()})
    numbers = (listed.walks, listed.held_out_walks)
    parts = [
        environment_version(listed.spec),
        numbers,
        versions()["numpy"],
        *(package_sha256(name) for name in packages),
    ]
    if part == PRIVATE or listed.spec != listed.env:
        task = listed.task(part)
        place = str(listed.private) if part == PRIVATE else listed.spec
        parts += [environment_version(place), *map(task.files_sha256, task.split("test"))]
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def draw(
    listed: BoardEnvironment,
    part: Part,
    secret: str,
    folder: Path,
    *,
    beside: Sequence[BoardEnvironment] = (),
    jobs: int = 1,
    progress: bool = False,
) -> DrawnPart:
    """Writes the walks of one part of an environment, unless they lie there already.

    Args:
        listed: The environment, as a board has it.
        part: Of the environment.
        secret: Of the round. Everything that is secret in `folder` follows from it; it is not written itself.
        folder: For this round.
        beside: Of these, the generated ones that have the same walks are drawn as well: what they share is made once.
        jobs: Processes.
        progress: Shows on stderr how far it is.

    Raises:
        DatasetError: The recorded data of the environment is not found.
    """
    import joblib

    drawn = DrawnPart(listed.env, part, folder)
    is_there = all(of.is_file() for of in (drawn.observations / INDEX_FILE, drawn.truth / CANARIES_FILE))
    if is_there and drawn.made_by == made_by(listed, part) and drawn.index.nonce == secret_nonce(secret):
        return drawn
    walks = listed.walks_of(part, secret)
    twins = [of for of in beside if of.env != listed.env and part in of.parts and of.is_generated]
    drawing = [(of, DrawnPart(of.env, part, folder)) for of in (listed, *twins) if of.walks_of(part, secret) == walks]
    names = [opaque_names(of, part, secret) for of, _ in drawing]
    for _, place in drawing:
        make_folder(place.observations)
        make_folder(place.truth).chmod(0o700)
    called = zip(walks, zip(*names, strict=True), strict=True)
    tasks = (joblib.delayed(_draw_walk)(secret, drawing, *of_walk) for of_walk in called)
    written = []
    with reporting(len(walks), 0, shown=progress, what=f"walks of {listed.env}, {part}, drawn") as advance:
        for one in joblib.Parallel(n_jobs=jobs, return_as="generator")(tasks):
            written.append(one)
            advance(COMPLETE, listed.env)
    for (of, place), known_as, files in zip(drawing, names, zip(*written, strict=True), strict=True):
        task = of.task(part, secret)
        digests, ends_s, means = (dict(zip(known_as, facts, strict=True)) for facts in zip(*files, strict=True))
        canaries = _draw_canaries(task, part, secret, place, ends_s, jobs) if part == HELD_OUT_PART else {}
        write_whole(place.truth / CANARIES_FILE, _packed(canaries))
        digests |= {name: sha256_of(place.observations / f"{name}{SUFFIX}") for name in canaries}
        index = Index(
            env=of.env,
            nonce=secret_nonce(secret),
            sensors=task.sensors,
            capacity=dict(task.capacity),
            period_s=task.period_s,
            start=task.start,
            walks=dict(sorted(digests.items())),  # the order says nothing
            means=_rounded_means(list(means.values())),
            random_as={name: one.of for name, one in canaries.items()},
        )
        content = encoder().encode(index)
        source = TASK_SOURCE.format(sha256=hashlib.sha256(content).hexdigest())
        write_whole(place.observations / TASK_FILE, source.encode())
        write_whole(place.observations / INDEX_FILE, content)
        write_whole(place.truth / MADE_BY_FILE, made_by(of, part).encode())
    return drawn


def _draw_canaries(
    task: Task, part: Part, secret: str, drawn: DrawnPart, ends_s: Mapping[str, float], jobs: int
) -> dict[str, Canary]:
    """Writes canaries of walks that lie there, under names like theirs."""
    import joblib

    key = hmac.new(secret.encode(), f"{task.id}\n{part}\ncanaries".encode(), hashlib.sha256).digest()
    canaries = plan(ends_s, task.period_s, np.random.default_rng(np.frombuffer(key, "<u4")))
    names = [hmac.new(key, f"{of.kind} {of.of}".encode(), hashlib.sha256).hexdigest()[:NAME_DIGITS] for of in canaries]
    tasks = (joblib.delayed(_draw_canary)(drawn, *of, ends_s) for of in zip(names, canaries, strict=True))
    joblib.Parallel(n_jobs=jobs)(tasks)
    return dict(zip(names, canaries, strict=True))


def _draw_canary(drawn: DrawnPart, name: str, canary: Canary, ends_s: Mapping[str, float]) -> None:
    walk = _drawn_walk(drawn, canary.of)
    if canary.kind == "cut":
        rows, end_s = cut_short(walk.rows, canary.since_s), canary.since_s
    else:
        rows = crossed(walk.rows, _drawn_walk(drawn, canary.other).rows, canary)
        end_s = min(walk.end_s, canary.since_s + ends_s[canary.other] - canary.other_s)
        rows = cut_short(rows, end_s)
    write_whole(drawn.observations / f"{name}{SUFFIX}", _packed(DrawnWalk(walk.briefing, rows, end_s)))


def _drawn_walk(drawn: DrawnPart, name: str) -> DrawnWalk:
    found: DrawnWalk = _unpacked(drawn.observations / f"{name}{SUFFIX}", DrawnWalk)
    return found


def opaque_names(listed: BoardEnvironment, part: Part, secret: str) -> dict[str, str]:
    """Ids of the walks of a part by the names that localizers' machines know them under."""
    key = hmac.new(secret.encode(), f"{listed.env}\n{part}".encode(), hashlib.sha256).hexdigest()
    return {
        hmac.new(key.encode(), walk.encode(), hashlib.sha256).hexdigest()[:NAME_DIGITS]: walk
        for walk in listed.walks_of(part, secret)
    }


def _draw_walk(
    secret: str, drawing: Sequence[tuple[BoardEnvironment, DrawnPart]], walk: str, names: Sequence[str]
) -> list[tuple[str, float, dict[str, float]]]:
    """Writes one walk under a name in each place; the sha256 of what a localizer may see, its end, `magnitudes`."""
    found = []
    for (listed, drawn), name in zip(drawing, names, strict=True):
        task = listed.task(drawn.part, secret)
        recording = task.load(walk)
        rows = {spec.name: recording.streams[spec.name].rows for spec in task.sensors if spec.name in recording.streams}
        walk_file = DrawnWalk(task.brief(recording), rows, recording.end_s)
        content = _packed(walk_file)
        write_whole(drawn.observations / f"{name}{SUFFIX}", content)
        write_whole(drawn.truth / f"{name}{SUFFIX}", _packed(make_truth(task, recording)))
        found.append((hashlib.sha256(content).hexdigest(), recording.end_s, magnitudes(walk_file)))
    return found


def magnitudes(walk: DrawnWalk) -> dict[str, float]:
    """Means over what a localizer may see of a walk, which another processor gives but for rounding."""
    columns = {name: np.abs(rows[:, 1:]).mean(axis=0) for name, rows in walk.rows.items() if len(rows)}
    if (survey := walk.briefing.radio_map) is not None:
        columns["survey"] = np.array([len(survey.level), np.abs(survey.rssi_dbm).mean()])
    return {f"{name} {k}": float(value) for name, values in columns.items() for k, value in enumerate(values)}


def _rounded_means(walks: Sequence[Mapping[str, float]]) -> dict[str, str]:
    return {name: f"{np.mean([of.get(name, 0.0) for of in walks]):.4g}" for name in sorted(set().union(*walks))}


def make_truth(task: Task, recording: Recording) -> Truth:
    """What only scoring may see of a recording."""
    building = recording.building
    return Truth(
        reference=scored_moments(recording.reference),
        plan=encoder().encode(building),
        fallback=task.fallback(recording),
        unit=task.units.get(recording.id, "" if building is None else building.name),
        groups=task.groups.get(recording.id, ()),
        duration_s=recording.end_s,
        walk=recording.id,
    )


def scored_moments(reference: Trajectory) -> Trajectory:
    """The surveyed rows of a reference, at most one in each second: the first."""
    surveyed = reference.scored()
    rows = np.unique(np.floor(surveyed.t_s * FREQUENCY_HZ), return_index=True)[1]
    keep = np.zeros(len(surveyed), bool)
    keep[rows] = True
    return surveyed.rows(keep)


def _packed(record: msgspec.Struct | dict[str, Canary]) -> bytes:
    return zlib.compress(encoder().encode(record), LEVEL)


def _unpacked(path: Path, kind: Any) -> Any:
    try:
        return decoder(kind).decode(zlib.decompress(path.read_bytes()))
    except (OSError, zlib.error, msgspec.MsgspecError, ValueError) as error:
        raise ResultError(f"cannot read {path}: {error}; delete {path.parent}, and it is drawn again") from None


@functools.lru_cache(maxsize=2)
def _building(plan: bytes) -> Building | None:
    found: Building | None = decoder(Building | None).decode(plan)
    return found


def read_truth(drawn: DrawnPart, name: str) -> Truth:
    """The truth of a walk by its name; raises `ResultError`."""
    found: Truth = _unpacked(drawn.truth / f"{name}{SUFFIX}", Truth)
    return found


def read_index(folder: Path) -> Index:
    """What a folder of observations says of all its walks; raises `ResultError`."""
    path = folder / INDEX_FILE
    try:
        found: Index = decoder(Index).decode(path.read_bytes())
    except (OSError, msgspec.MsgspecError, ValueError) as error:
        raise ResultError(f"{folder} holds no drawn walks: {error}") from None
    return found


def drawn_task(folder: Path) -> Task:
    """The task of drawn walks: as the environment, without references."""
    return _drawn_task(folder, (folder / INDEX_FILE).stat().st_mtime_ns)


@functools.lru_cache(maxsize=16)
def _drawn_task(folder: Path, mtime_ns: int) -> Task:
    index = read_index(folder)
    specs = {spec.name: spec for spec in index.sensors}

    @functools.lru_cache(maxsize=2)
    def walk_of(name: str) -> DrawnWalk:
        found: DrawnWalk = _unpacked(folder / f"{name}{SUFFIX}", DrawnWalk)
        return found

    def briefing(recording: Recording) -> Briefing:
        return walk_of(recording.id).briefing

    def load(name: str) -> Recording:
        walk = walk_of(name)
        streams = {sensor: SensorStream(specs[sensor], rows) for sensor, rows in walk.rows.items()}
        brief = walk.briefing
        end = Trajectory(np.array([walk.end_s]), np.zeros((1, 2)), np.zeros(1, np.int64), np.zeros(1, bool))  # no more
        return Recording(name, brief.building, streams, end, brief.subject, "", brief.mounting)

    def tell_start(recording: Recording) -> Start:
        start = briefing(recording).start
        assert start is not None
        return start

    return Task(
        id=index.env,
        summary="Walks of a board without their references.",
        description="",
        sensors=index.sensors,
        capacity=index.capacity,
        period_s=index.period_s,
        start=index.start,
        walks={"test": tuple(index.walks)},
        load=load,
        tell_start=tell_start,
        radio_map=lambda recording: briefing(recording).radio_map,
        magnetic_map=lambda recording: briefing(recording).magnetic_map,
        licence="",
        source="a board",
        files_sha256=lambda name: index.walks[name],
        random_as=index.random_as,
    )


def walks_sha256(index: Index) -> str:
    """What walks are known by: digest of their names and means, the same on every processor."""
    return hashlib.sha256(repr((sorted(index.walks), sorted(index.means.items()))).encode()).hexdigest()
