"""Replays: pages hold the shown frames, and no partial file is left."""

from __future__ import annotations

import base64
import dataclasses
import json
import shutil
import subprocess
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.errors import ResultError
from pdrbench.localizer import Estimate
from pdrbench.recording import Recording
from pdrbench.result import Result
from pdrbench.trajectory import Estimates, Trajectory
from pdrbench_formats.replays import plan_replay, replay, write_replay
from pdrbench_formats.replays.page import MAX_DOTS_IN_ALL, STEPS, max_dots_of_page, page_data, replay_page
from pdrbench_formats.replays.replay import ReplayFrame, WalkReplay, errors_at, shown_reference
from pdrbench_formats.replays.view import Dots, dots_of, level_height_m

NASTY = '</script><b>&"walk"'
NUM_FRAMES = 6


def make_replay(building: Building | None, walk: str = "walk") -> WalkReplay:
    """Six seconds along x, on level 0."""
    t_s = np.arange(float(NUM_FRAMES))
    xy_m = np.column_stack([5.0 + t_s, np.full(NUM_FRAMES, 1.0)])
    reference = Trajectory(t_s, xy_m, np.zeros(NUM_FRAMES, int), np.ones(NUM_FRAMES, bool))
    none = np.full(NUM_FRAMES, np.nan)
    estimates = Estimates(t_s, xy_m + np.array([0.0, 0.5]), np.zeros(NUM_FRAMES), none, none, none)
    result = Result("Corridor-v0", "test", walk, "near", 0, estimates, none)
    return WalkReplay(result, Recording(walk, building, {}, reference), np.arange(NUM_FRAMES), 1, 1.0, 10)


def make_shots(shown: WalkReplay, num_dots: int = 50) -> list[ReplayFrame]:
    """The first estimate is missing, the last one on the wrong level; particles until the middle."""
    rng = np.random.default_rng(8)
    shots = []
    for k, xy_m in enumerate(shown.result.estimates.xy_m):
        dots = _dots(rng, shown.recording.building, num_dots) if k < 3 else None
        shots.append(
            ReplayFrame(
                now_s=float(k),
                estimate=Estimate(xy_m, int(k == 5), sigma_m=0.5, converged=k > 2) if k else None,
                dots=dots,
                num_particles=4_500_000 if dots is not None else None,
                num_clusters=k,
                reference=np.array([5.0 + k, 1.0, 0.0]),
                error_m=0.5 if k else np.nan,
                is_level_right=k != 5,
            )
        )
    return shots


def _dots(rng: np.random.Generator, building: Building | None, count: int) -> Dots | None:
    if building is None:
        return dots_of({"particles_xy_m": np.column_stack([rng.uniform(4, 11, count), rng.uniform(0, 2, count)])})
    polygon, xy_m = building.sample_uniform(rng, count)
    weight = np.where(rng.random(count) < 0.4, 0.0, 1.0)
    return dots_of({"particles_xy_m": xy_m, "particles_polygon": polygon, "particles_weight": weight}, building)


class Reader(HTMLParser):
    """Tags of a page with their attributes, and the text of each element that has an id."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        tag, attributes = self.tags[-1] if self.tags else ("", {})
        name = attributes.get("id") or tag
        self.texts[name] = self.texts.get(name, "") + data

    @property
    def walk(self) -> dict[str, Any]:
        return json.loads(self.texts["walk"], parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def particles(walk: dict[str, Any], frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (N, 3), place of the level (N,) and whether it is not alive (N,), decoded from base64."""
    cloud = walk["cloud"]
    rows = slice(cloud["first"][frame], cloud["first"][frame + 1])
    packed = np.frombuffer(base64.b64decode(cloud["places"]), "<u2").reshape(-1, 3)[rows]
    marks = np.frombuffer(base64.b64decode(cloud["marks"]), "u1")[rows]
    low, high = np.array(walk["low"]), np.array(walk["high"])
    return low + packed / STEPS * (high - low), marks & 127, marks >= 128


def test_a_page_holds_the_shown_frames(office: Building) -> None:
    shown = make_replay(office)
    shots = make_shots(shown)
    walk = Reader(replay_page(shown, shots)).walk
    half_a_step_m = (np.array(walk["high"]) - walk["low"]) / STEPS / 2
    assert (half_a_step_m < 0.002).all()
    for frame, shot in enumerate(shots):
        places, level, is_dead = particles(walk, frame)
        if shot.dots is None:
            assert not len(places)
            continue
        wanted = np.column_stack([shot.dots.xy_m, shot.dots.height_m])
        assert (np.abs(places - wanted) <= half_a_step_m + 1e-9).all()
        np.testing.assert_array_equal(level, shot.dots.level)
        np.testing.assert_array_equal(is_dead, ~shot.dots.alive)
        assert is_dead.any() and not is_dead.all()
    frames = walk["frames"]
    assert frames["t_s"] == [0, 1, 2, 3, 4, 5]
    assert frames["estimate"][0] is None and frames["estimate"][2] == [7.0, 1.5, 0.0, 0.0]
    assert frames["estimate"][5][2:] == [1.0, round(level_height_m(office, 1), 3)]
    assert frames["error_m"] == [None, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert frames["converged"] == [None, False, False, True, True, True]
    assert frames["particles"] == [4_500_000] * 3 + [None] * 3
    assert [row[:3] for row in walk["reference"]] == [[5.0 + k, 1.0, 0.0] for k in range(NUM_FRAMES)]


def test_a_page_holds_every_floor_and_wall(office: Building) -> None:
    shown = make_replay(office)
    levels = page_data(shown, make_shots(shown))["levels"]
    parts = [part for level in levels for part in (level["floors"], level["stairs"])]
    assert [level["level"] for level in levels] == [0, 1]
    assert sum(len(part["rings"]) for part in parts) == len(office.polygons)
    is_wall = office.edge_neighbour == -1
    found = np.concatenate([np.reshape(part["walls"], (-1, 5)) for part in parts])
    wanted = np.column_stack([office.edge_start_xy_m, office.edge_end_xy_m, office.height(office.edge_polygon)])[
        is_wall
    ]
    np.testing.assert_allclose(found[np.lexsort(found.T)], wanted[np.lexsort(wanted.round(3).T)], atol=0.00051)


def test_a_page_is_self_contained_and_names_cannot_break_it(office: Building) -> None:
    shown = make_replay(office, NASTY)
    page = replay_page(shown, make_shots(shown))
    reader = Reader(page)
    assert not [attributes for _, attributes in reader.tags if {"src", "href"} & set(attributes)]
    assert "://" not in page and "@import" not in page and "url(" not in page
    assert [tag for tag, _ in reader.tags].count("script") == 2 and "b" not in [tag for tag, _ in reader.tags]
    assert reader.texts["h1"].strip() == shown.title and NASTY in shown.title
    assert reader.walk["title"] == shown.title


def test_a_walk_without_map_or_particles_or_reference_has_a_page() -> None:
    shown = make_replay(None)
    bare = dataclasses.replace(
        shown, recording=Recording("walk", None, {}, shown.recording.reference.rows(np.zeros(NUM_FRAMES, bool)))
    )
    shots = [dataclasses.replace(s, dots=None, reference=np.full(3, np.nan), error_m=np.nan) for s in make_shots(bare)]
    walk = Reader(replay_page(bare, shots)).walk
    assert walk["cloud"]["first"] == [0] * (NUM_FRAMES + 1) and walk["reference"] == []
    assert walk["frames"]["reference"] == [None] * NUM_FRAMES == walk["frames"]["error_m"]
    assert len(particles(Reader(replay_page(shown, make_shots(shown))).walk, 1)[0]) == 50


def test_the_player_decodes_and_prints_what_was_shown(office: Building, tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node was not found: the player's functions run in it")
    shown = make_replay(office)
    walk = page_data(shown, make_shots(shown))
    (tmp_path / "walk.json").write_text(json.dumps(walk))
    code = f"""
        const player = require({json.dumps(str(Path(replay.__file__).with_name("templates") / "replay.js"))});
        const walk = JSON.parse(require("fs").readFileSync({json.dumps(str(tmp_path / "walk.json"))}));
        const cloud = player.decodeCloud(walk.cloud);
        const dots = [];
        for (let i = cloud.first[1]; i < cloud.first[2]; i++) dots.push(player.dotAt(walk, cloud, i));
        const drawing = player.fit(walk.matrix, player.corners(walk), 800, 600);
        console.log(JSON.stringify({{
            dots,
            words: [0, 2, 5].map((k) => player.words(walk, k)),
            last: player.lastEstimate(walk, 0),
            trail: player.trail(walk, 4),
            corners: player.corners(walk).map((corner) => drawing.place(...corner)),
            runs: player.runs([[0, 0, 0, 0], null, [1, 0, 0, 0], [2, 0, 1, 0], [3, 0, 0, 0]], (row) => row[2] === 0,
                player.around(0, 0, 10, 100, 100)),
        }}));
    """
    answer = subprocess.run([node, "-e", code], capture_output=True, text=True, check=True)
    found = json.loads(answer.stdout)
    places, level, is_dead = particles(walk, 1)
    np.testing.assert_allclose([[dot["x"], dot["y"], dot["z"]] for dot in found["dots"]], places, atol=1e-9)
    assert [dot["level"] for dot in found["dots"]] == level.tolist()
    assert [dot["dead"] for dot in found["dots"]] == is_dead.tolist()
    assert found["words"][0] == [
        ["time", "0.0 s"],
        ["level", "no estimate"],
        ["particles", "4,500,000"],
        ["clusters", "0"],
    ]
    assert ["error", "0.50 m"] in found["words"][1] and ["converged", "no"] in found["words"][1]
    assert ["error", "0.50 m, on the wrong level"] in found["words"][2]
    assert found["last"] is None
    assert found["trail"] == [None, None, None, [8.0, 1.5, 0.0, 0.0], [9.0, 1.5, 0.0, 0.0]]  # of what has converged
    pixels = np.array(found["corners"])
    assert (pixels >= 11.9).all() and (pixels <= [788.1, 588.1]).all()
    assert max(np.ptp(pixels[:, 0]) / 776, np.ptp(pixels[:, 1]) / 576) == pytest.approx(1)
    assert found["runs"] == [[[50, 50]], [[60, 50]], [[80, 50]]]


def test_the_page_plays_in_a_browser(office: Building, tmp_path: Path, browser: Any) -> None:
    shown = make_replay(office, NASTY)
    page = replay_page(shown, make_shots(shown))
    (tmp_path / "page.html").write_text(page.replace("  draw();\n}\n", "  go(2);\n}\n", 1))  # begins at the third frame
    browser.open(tmp_path / "page.html")
    cells = browser.run("[...document.querySelectorAll('td')].map((cell) => cell.textContent)")
    assert cells[:4] == ["time", "2.0 s", "level", "0"] and cells[-2:] == ["error", "0.50 m"]
    text = browser.run("document.documentElement.outerHTML")
    assert "particles, level 1" in text and "all levels" in text


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("walk.gif", r"a replay is a page, \.html; got '\.gif'"),
        ("walk", "got 'no suffix'"),
        ("gone/walk.html", r"cannot write .*walk\.html: No such file or directory"),
    ],
)
def test_an_unwritable_output_is_an_error_before_any_walk(
    office: Building, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, message: str
) -> None:
    monkeypatch.setattr(replay, "retrace", lambda *_, **__: pytest.fail("played"))
    with pytest.raises(ResultError, match=message):
        write_replay(make_replay(office), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_failed_replay_leaves_the_old_file(office: Building, tmp_path: Path) -> None:
    shown = make_replay(office)

    def ending() -> Iterator[ReplayFrame]:
        yield make_shots(shown)[0]
        raise ResultError("the answers are not the stored ones")

    path = tmp_path / "walk.html"
    path.write_text("before")
    with pytest.raises(ResultError, match="not the stored ones"):
        _write(shown, path, ending())
    assert [file.name for file in tmp_path.iterdir()] == [path.name] and path.read_text() == "before"


def test_frames_are_chosen_by_time(monkeypatch: pytest.MonkeyPatch, corridor: SimpleNamespace) -> None:
    monkeypatch.setattr(replay, "make_task", lambda env: corridor.task())
    result = corridor.result("near", corridor.WALKS[0], 1.0)
    assert plan_replay(result).index.tolist() == list(range(20))
    part = plan_replay(result, from_s=2.5, to_s=9.0, every=3)
    assert part.index.tolist() == [3, 6, 9] and part.span_s == 9.0
    assert plan_replay(result, from_s=4.2, to_s=5.0, every=50).index.tolist() == [5]
    with pytest.raises(ResultError, match="nothing to show from 30 s to inf s; its answers are from 0 s to 19 s"):
        plan_replay(result, from_s=30.0)


def test_long_walks_have_six_hundred_frames_by_default(
    monkeypatch: pytest.MonkeyPatch, corridor: SimpleNamespace
) -> None:
    monkeypatch.setattr(replay, "make_task", lambda env: corridor.task(period_s=0.1))
    count = 9600
    none = np.full(count, np.nan)
    estimates = Estimates(np.arange(count) / 10, np.zeros((count, 2)), np.zeros(count), none, none, none)
    result = dataclasses.replace(corridor.result("near", corridor.WALKS[0], 1.0), estimates=estimates, step_s=none)
    assert len(plan_replay(result)) == 600
    assert len(plan_replay(result, to_s=100.0)) == 101  # one a second
    shown = plan_replay(result, every=1)
    assert len(shown) == count
    assert max_dots_of_page(count) * count <= MAX_DOTS_IN_ALL


def test_the_reference_is_joined_by_straight_lines() -> None:
    reference = Trajectory(np.array([1.0, 3.0]), np.array([[0.0, 0], [4, 2]]), np.array([0, 1]), np.ones(2, dtype=bool))
    found = shown_reference(reference, np.array([0.9, 1.0, 1.9, 2.5, 3.0, 3.1]))
    none = [np.nan] * 3
    np.testing.assert_allclose(found, [none, [0, 0, 0], [1.8, 0.9, 0], [3, 1.5, 1], [4, 2, 1], none])
    assert np.isnan(shown_reference(reference.rows(np.zeros(2, dtype=bool)), np.array([1.0]))).all()


def test_the_error_is_that_of_the_last_reference_position() -> None:
    reference = Trajectory(
        np.array([0.5, 1.0, 3.0]), np.array([[0.0, 0], [3, 4], [9, 9]]), np.array([0, 0, 1]), np.ones(3, dtype=bool)
    )
    none = np.full(3, np.nan)
    xy_m = np.array([[0.0, 0], [np.nan, np.nan], [9, 8]])
    estimates = Estimates(np.array([1.0, 2.0, 3.0]), xy_m, np.array([0, np.nan, 0]), none, none, none)
    error_m, is_level_right = errors_at(estimates, reference, np.array([0.0, 0.7, 1.0, 2.9, 3.0, 9.0]))
    np.testing.assert_allclose(error_m, [np.nan, np.nan, 5, 5, 1, 1])
    assert is_level_right[2:].tolist() == [True, True, False, False]
    unscored = reference.rows(np.zeros(3, dtype=bool))
    assert np.isnan(errors_at(estimates, unscored, np.array([1.0]))[0]).all()


def _write(shown: WalkReplay, path: Path, shots: Any, advance: Any = lambda: None) -> Path:
    """Writes given frames instead of those of a localizer."""

    class Given(WalkReplay):
        def shots(self, *_: object, **__: object) -> Iterator[ReplayFrame]:
            return iter(shots)

    return write_replay(
        Given(*(getattr(shown, field.name) for field in dataclasses.fields(shown))), path, advance=advance
    )
