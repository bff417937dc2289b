"""Made-up leaderboards."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.evaluation import Results
from pdrbench.recording import Recording, SensorSpec
from pdrbench.result import COMPLETE, OFFLINE, ONLINE, UNSUITABLE, Result
from pdrbench.task import Task
from pdrbench.trajectory import Estimates, Start, Trajectory
from pdrbench_leaderboard import collection
from pdrbench_leaderboard.card import Card
from pdrbench_leaderboard.entry import Entry
from pdrbench_leaderboard.held_out import LOOP_RANKING
from pdrbench_leaderboard.ranking import RANKING, Board, make_board
from pdrbench_leaderboard.site import write_site
from pdrbench_leaderboard.verification import HeldOut, Verification
from pdrbench_sim.buildings.office import make_office

STEPS: Final = 21
WALKS: Final = tuple(f"walk-{i:02d}" for i in range(12))
ENV: Final = "Corridor-v0"
ROUND: Final = "0" * 64  # of the secret


@pytest.fixture(scope="session")
def office() -> Building:
    """A small building of two levels."""
    return make_office(np.random.default_rng(3), num_levels=2, area_m2=800.0)


class World:
    """A made-up environment: twelve straight walks, known errors."""

    def __init__(self, building: Building | None, **changes: Any) -> None:
        self.building = building
        spec = SensorSpec("stride", ("t_s", "length_m"), [0, 0], [1e3, 5], None, "A stride of one foot.")
        wifi = SensorSpec("wifi", ("t_s", "rssi_dbm"), [0, -120], [1e3, 0], None, "A scan.")
        fields: dict[str, Any] = {
            "id": ENV,
            "summary": "A corridor.",
            "description": "Nothing but a corridor.",
            "sensors": (spec, wifi),
            "capacity": {"stride": 4, "wifi": 4},
            "period_s": 1.0,
            "start": "pose",
            "walks": {"train": ("a",), "test": WALKS},
            "load": self.recording,
            "tell_start": lambda recording: Start(recording.reference.xy_m[0], 0),
            "licence": "MIT",
            "source": "generated",
            "radio_map": lambda _: None,
            "units": {walk: walk for walk in ("a", *WALKS)},
            "unit_kind": "walk",
        }
        self.task = Task(**(fields | changes))

    def recording(self, walk: str) -> Recording:
        """A walk of 20 m in 20 s; the second half of odd ones is on level 1."""
        t_s = np.arange(float(STEPS))
        low = (0.0, 0.0) if self.building is None else self.building.bounds_m()[:2]
        level = ((t_s >= 10) & (int(walk[-2:]) % 2 == 1)).astype(int)
        reference = Trajectory(t_s, np.column_stack([low[0] + t_s, np.full(STEPS, low[1] + 5)]), level, t_s > 0)
        return Recording(id=walk, building=self.building, streams={}, reference=reference)

    def result(self, name: str, walk: str, offset_m: float, **changes: Any) -> Result:
        """Every estimate is `offset_m` beside the reference."""
        reference = self.recording(walk).reference
        count = 0 if changes.get("status") == UNSUITABLE else STEPS
        none = np.full(count, np.nan)
        xy_m = (reference.xy_m + np.array([0.0, offset_m]))[:count]
        estimates = Estimates(reference.t_s[:count], xy_m, reference.level.astype(float)[:count], none, none, none)
        return Result(ENV, "test", walk, name, estimates=estimates, step_s=none, **({"seed": 0} | changes))

    def entry(
        self, name: str, offsets_m: Sequence[float], card: Mapping[str, Any] | None = None, **changes: Any
    ) -> Entry:
        """An entry with these errors on the first walks; NaN where it declined.

        It is verified, unless its tier is another, and its held-out walks went as the public ones did.
        """
        division = changes.pop("division", ONLINE)
        results = changes.pop("results", None) or tuple(
            self.result(
                name,
                walk,
                0.0 if np.isnan(offset_m) else offset_m,
                status=UNSUITABLE if np.isnan(offset_m) else COMPLETE,
                division=division,
            )
            for walk, offset_m in zip(WALKS, offsets_m, strict=False)
        )
        row: dict[str, Any] = {"name": "mine", "authors": ("A. Author",), "licence": "MIT", "training_data": "none"}
        row |= {"sensors_used": ("stride",), "map_used": False, "survey_used": False, "division": division}
        record = SimpleNamespace(env=ENV, walks=results)
        facts = {"localizer": name, "suite": "corridors-v1", "spec": "file.py:Mine", "environments": (record,)}
        manifest: Any = SimpleNamespace(**(facts | {"isolation": (), "machine": {}} | changes.pop("manifest", {})))
        tier = changes.pop("tier", "verified")
        verification = None if tier == "self-reported" else self.verification(name, results, tier)
        return Entry(Card(**(row | dict(card or {}))), manifest, b"", results, results, verification)

    def verification(self, name: str, results: Sequence[Result], tier: str = "verified") -> Verification:
        """What maintainers found, with held-out walks as the public ones."""
        frame = Results(tuple(results)).walks().groupby("walk", sort=False)[[RANKING, LOOP_RANKING]].mean()
        values = {
            metric: tuple(None if math.isnan(value) else value for value in frame[metric])
            for metric in frame
            if not frame[metric].isna().all()
        }
        held_out = HeldOut(
            round=ROUND,
            estimates_sha256="1" * 64,
            seeds=1,
            statuses="c" * len(frame),
            units=tuple(range(len(frame))),
            values=values,
        )
        return Verification(
            schema=2,
            suite="corridors-v1",
            env=ENV,
            localizer=name,
            entry_sha256="2" * 64,
            tier=tier,  # type: ignore[arg-type]
            date=datetime.date(2026, 1, 1),
            nonce="",
            reran=len(results),
            of=len(results),
            versions={},
            machine={},
            isolation=(),
            held_out=held_out if tier == "verified" else None,
        )

    def board(self, *entries: Entry) -> Board:
        """Scored and in order."""
        return make_board(entries)


MODULES: Final = (
    "pdrbench.evaluation.scoring",
    "pdrbench.evaluation.rows",
    "pdrbench.evaluation.tables",
    "pdrbench_leaderboard.ranking",
    "pdrbench_leaderboard.page_data",
)


def enter(world: World, monkeypatch: pytest.MonkeyPatch) -> World:
    """Every module lives in this world."""
    for module in MODULES:
        monkeypatch.setattr(f"{module}.make_task", lambda *_, **__: world.task)
    monkeypatch.setattr("pdrbench.evaluation.scoring.code_sha256", lambda _: "code")
    monkeypatch.setattr("pdrbench_leaderboard.ranking.find_suite", lambda _: SimpleNamespace(round_of=lambda _: ROUND))
    monkeypatch.setattr("pdrbench_leaderboard.site.flags_of", lambda _: [])  # made-up entries are of no suite
    monkeypatch.setattr("pdrbench_leaderboard.collection.rules", lambda _: [])
    monkeypatch.setattr("pdrbench_leaderboard.collection.held_out_findings", lambda *_: [])
    return world


@pytest.fixture
def make_world(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes a world, in which every module then lives."""
    return lambda building=None, **changes: enter(World(building, **changes), monkeypatch)


@pytest.fixture
def world(make_world: Any) -> World:
    """Without a building."""
    found: World = make_world()
    return found


def offsets(middle_m: float, seed: int = 0, spread_m: float = 0.1) -> list[float]:
    """One error for each walk, with exactly this mean, the same for the same seed."""
    noise_m = spread_m * np.random.default_rng(seed).uniform(-1, 1, len(WALKS))
    return list(middle_m + noise_m - noise_m.mean())


def make_five(world: World) -> Board:
    """A leader, two nearly equal entries, an offline one, one that chose its walks."""
    declined = [0.9] * 6 + [np.nan] * 6
    return world.board(
        world.entry("far", offsets(9.0, 1), {"survey_used": True, "sensors_used": ("stride", "wifi")}),
        world.entry("near", offsets(1.0, 2), {"map_used": True}),
        world.entry("alike", offsets(9.001, 3), {"sensors_used": ("wifi",)}),
        world.entry("smooth", offsets(0.5, 4), division=OFFLINE),
        world.entry("choosy", declined, tier="self-reported"),
    )


@pytest.fixture(scope="session")
def scored_five(office: Building) -> tuple[World, Board]:
    """`make_five`, scored and tested once for all."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        world = enter(World(office), monkeypatch)
        board = make_five(world)
        assert len(board.pairs) == 6
        return world, board


@pytest.fixture(scope="session")
def built(scored_five: tuple[World, Board], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of that board, to be read and not to be changed."""
    root = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as monkeypatch:
        enter(scored_five[0], monkeypatch)
        write_site([scored_five[1]], root)
    return root


@pytest.fixture
def five(scored_five: tuple[World, Board], monkeypatch: pytest.MonkeyPatch) -> Board:
    """That board, in its world."""
    enter(scored_five[0], monkeypatch)
    return scored_five[1]


class Folder:
    """A folder of entries that are made up."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, root: Path, entries: dict[str, Any]) -> None:
        self.root, self.entries = root, entries
        monkeypatch.setattr(collection, "list_entries", lambda _: [root / name for name in sorted(entries)])
        monkeypatch.setattr(collection, "read_entry", self.read)
        for name in entries:
            (root / name).mkdir(parents=True)

    def read(self, folder: Path) -> Any:
        found = self.entries["/".join(folder.parts[-2:])]
        if isinstance(found, Exception):
            raise found
        return found

    def check(self) -> dict[str, str]:
        """The reasons of failing checks, by name."""
        return {check.name: check.why for check in collection.check_boards(self.root) if not check.passed}


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, world: World) -> Folder:
    names = ("near", "far")
    entries = {f"Corridor-v0/{name}": world.entry(name, [1.0 + i] * 12) for i, name in enumerate(names)}
    return Folder(monkeypatch, tmp_path, entries)
