"""`leaderboard run`: draw, play, score, and what is kept of it."""

from __future__ import annotations

import dataclasses
import datetime
import re
import shutil
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from pdrbench.errors import BundleError, UnsuitableError
from pdrbench.evaluation import answers
from pdrbench.metrics import METRICS
from pdrbench.registry import make_task
from pdrbench.task import HELD_OUT, commitment
from pdrbench_leaderboard import record, score, table
from pdrbench_leaderboard.boards import Board, BoardEnvironment, Round, boards, find_round
from pdrbench_leaderboard.bundle import write_bundle
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.checking import check_board, compare_entries, disagree
from pdrbench_leaderboard.confine.read_permissions import hidden_places
from pdrbench_leaderboard.draw import INDEX_FILE, DrawnPart, draw, drawn_task, read_truth, walks_sha256
from pdrbench_leaderboard.entrants import Entrant
from pdrbench_leaderboard.run import Outcome, Settings, run
from pdrbench_leaderboard.signing import new_key
from pdrbench_leaderboard.standings import read_tables
from pdrbench_leaderboard.submission import make_bundle

from .conftest import DEAF, ENV, ONE, ROUND, SECRET, STAY, TOY, card_named


def test_boards_name_registered_environments_and_round_0_is_published() -> None:
    for board in boards().values():
        for listed in board.environments:
            assert listed.parts[-1] == "held-out"
            assert make_task(listed.env).id == listed.env
            assert not re.search("Loops|Counts|Handling|Survey|Dual", listed.env), "no walk to localise"
    assert len(find_round(0).secret) >= 32


def test_the_secret_of_a_round_is_the_one_that_was_committed_to() -> None:
    closed = Round(number=1, commitment=commitment(SECRET))
    assert closed.secret_of(SECRET) == ROUND.secret_of(None) == SECRET
    with pytest.raises(BundleError, match="not published"):
        closed.secret_of(None)
    with pytest.raises(BundleError, match="sha256 differs"):
        closed.secret_of("0" * 32)


def test_what_has_the_same_walks_is_drawn_with_them_as_it_is_drawn_alone(tmp_path: Path) -> None:
    known, lost = (BoardEnvironment(env=f"CampusPhone{of}-v1", walks=1, held_out_walks=1) for of in ("", "Lost"))
    strides = BoardEnvironment(env="CampusStride-v1", walks=1, held_out_walks=1)
    drawn = draw(known, "held-out", SECRET, tmp_path / "together", beside=[strides, known, lost])
    beside, alone = DrawnPart(lost.env, "held-out", drawn.folder), draw(lost, "held-out", SECRET, tmp_path / "alone")
    one, other = ((of.observations / INDEX_FILE).read_bytes() for of in (beside, alone))  # with digests of all walks
    assert (one, beside.made_by, beside.canaries) == (other, alone.made_by, alone.canaries)
    assert drawn.index.walks.keys().isdisjoint(beside.index.walks)
    on_another_processor = msgspec.structs.replace(drawn.index, walks=dict.fromkeys(drawn.index.walks, "other bytes"))
    assert walks_sha256(on_another_processor) == walks_sha256(drawn.index) != walks_sha256(beside.index)
    assert not DrawnPart(strides.env, "held-out", drawn.folder).observations.exists()


def test_drawn_walks_hold_neither_truth_nor_names(tmp_path: Path) -> None:
    drawn = draw(TOY.environment(ENV), "held-out", SECRET, tmp_path)
    secret_task, task = make_task(ENV, SECRET), drawn_task(drawn.observations)
    names = drawn.walks
    assert set(names).isdisjoint(secret_task.split(HELD_OUT))
    for name in names:
        truth = read_truth(drawn, name)
        original, recording = secret_task.load(truth.walk), task.load(name)
        brief, wanted = task.brief(recording), secret_task.brief(original)
        assert recording.end_s == original.end_s
        assert not recording.reference.surveyed.any() and not recording.reference.xy_m.any()
        for sensor, stream in original.streams.items():
            assert np.array_equal(recording.streams[sensor].rows, stream.rows)
        assert brief.start is not None and wanted.start is not None
        assert np.array_equal(brief.start.xy_m, wanted.start.xy_m)
        assert (np.diff(truth.reference.t_s) >= 1.0).all()
    for path in drawn.observations.iterdir():
        assert SECRET.encode() not in path.read_bytes()
    before = (drawn.observations / INDEX_FILE).stat().st_mtime_ns
    draw(TOY.environment(ENV), "held-out", SECRET, tmp_path)  # lies there already
    assert (drawn.observations / INDEX_FILE).stat().st_mtime_ns == before


@pytest.fixture(scope="module")
def ran(submitted: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Settings, list[Outcome]]:
    """A folder where `Mine` was played on both environments, and what came of it; copied before it is changed."""
    place = tmp_path_factory.mktemp("ran")
    card = place / "card.toml"
    card.write_bytes(card_toml(card_named("mine")))
    found = Settings(root=place / "leaderboards", work=place / "work", round=ROUND, isolation="none")
    return found, list(run([TOY], [f"{submitted}:Mine"], found, card=card))


@pytest.fixture
def copied(ran: tuple[Settings, list[Outcome]], settings: Settings) -> Settings:
    """A copy of that folder."""
    shutil.copytree(ran[0].root, settings.root)
    return dataclasses.replace(settings, work=ran[0].work)


def test_entries_hold_scores_of_their_answers(ran: tuple[Settings, list[Outcome]]) -> None:
    settings, outcomes = ran
    assert [(of.env, of.part, len(of.played), len(of.declined)) for of in outcomes] == [
        (ENV, "public", 1, 0),
        (ENV, "held-out", 1, 0),
        (DEAF, "public", 0, 1),
        (DEAF, "held-out", 0, 1),
    ]
    folder = settings.root / "toy" / "mine"
    entry, _ = record.read_entry(folder)
    assert (entry.spec, [part.place for part in entry.parts]) == (
        "localizer.py:Mine",
        [(ENV, "held-out"), (ENV, "public")],
    )
    walks = record.read_walks(settings.root / "toy")
    for part in entry.parts:
        found = part.divisions[0]
        assert found.statuses == "c" * len(walks[part.place].walks)
        for name in score.METRICS:
            assert all(value is not None for value in found.values[name]) == (name != "coverage")
        whole, _ = answers.decode(record.answers_of(entry, record.read_answers(folder), part), "mine")
        drawn = draw(TOY.environment(ENV), part.part, SECRET, settings.work)
        first = 0
        for name, stated in zip(drawn.walks, found.values["p75_m"], strict=True):
            truth = read_truth(drawn, name)
            last = first + len(truth.reference)
            estimates = answers.from_whole_numbers(whole[:, first:last], truth.reference.t_s, answers.COARSE)
            assert score.walk_values(estimates, truth)["p75_m"] == pytest.approx(stated, rel=1e-3)
            first = last


def test_what_is_done_is_skipped_and_what_lies_with_an_entry_is_played(copied: Settings, tmp_path: Path) -> None:
    folder = copied.root / "toy" / "mine"
    before = (folder / record.ENTRY_FILE).read_bytes()
    again = list(run([TOY], [f"{folder / 'localizer.py'}:Mine"], copied))
    assert all(of.kept == ("mine",) for of in again)
    (folder / record.ENTRY_FILE).unlink()
    fresh = dataclasses.replace(copied, work=tmp_path / "elsewhere")
    played = list(run([TOY], [f"{folder / 'localizer.py'}:Mine"], fresh))
    assert played[0].played == ("mine",)
    assert _without_times(before) == _without_times((folder / record.ENTRY_FILE).read_bytes())


def test_what_is_not_installed_here_is_left_out_with_a_line(copied: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """As adapters of the laboratory are in a clone of the product alone, and without the package that they adapt."""
    folder = copied.root / "toy" / "mine"
    (folder / "localizer.py").unlink()
    path = folder / record.ENTRY_FILE
    path.write_text(path.read_text("utf-8").replace('"localizer.py:Mine"', '"of_elsewhere"'), "utf-8")
    monkeypatch.setattr("pdrbench_leaderboard.entrants.OURS", "no other one")
    first, *others = run([TOY], [], copied)
    assert first.why == "mine is not installed here"
    assert not any(of.played or of.why for of in others) and path.is_file()

    def without_its_package(name: str) -> None:
        raise UnsuitableError(f"{name} needs a package")

    path.write_text(path.read_text("utf-8").replace('"of_elsewhere"', '"stay"'), "utf-8")
    monkeypatch.setattr("pdrbench_leaderboard.entrants.make_localizer", without_its_package)
    first, *others = run([TOY], [], copied)
    assert first.why == "mine is not installed here"
    assert not any(of.played or of.why for of in others)


def _without_times(content: bytes) -> list[bytes]:
    return [line for line in content.splitlines() if b'"load"' not in line]


def test_failed_walks_have_no_values_and_changed_answers_are_found(played: Settings, tmp_path: Path) -> None:
    found = record.read_entry(played.root / "toy" / "broken")[0].parts[0].divisions[0]
    assert set(found.statuses) == {"f"}
    assert found.failures == {"ValueError: no idea": len(found.statuses)}
    assert set(found.values["p75_m"]) == {None}
    path = Path(shutil.copytree(played.root / "toy" / STAY, tmp_path / STAY)) / record.ANSWERS_FILE
    path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(BundleError, match="not the one"):
        record.read_entry(path.parent)


def test_one_run_gives_both_divisions_and_metrics_are_known(played: Settings) -> None:
    online, offline = record.read_entry(played.root / "toy" / "lags")[0].parts[0].divisions
    assert (online.division, offline.division) == ("online", "offline")
    assert record.numbers(online.values["mean_m"]).max() < record.numbers(offline.values["mean_m"]).min()
    assert set(score.METRICS.values()) <= set(METRICS)


def test_registered_localizers_bring_their_card_and_others_need_one(
    settings: Settings, submitted: Path, played: Settings
) -> None:
    with pytest.raises(BundleError, match="needs a card"):
        list(run([TOY], [f"{submitted}:Mine"], settings))
    entry, card = record.read_entry(played.root / "toy" / STAY)
    assert (entry.spec, card.name) == (STAY, STAY)
    usual = dataclasses.replace(settings, isolation=None)
    card = card_named("mine")
    runs_in = [usual.isolation_of(Entrant(spec, card)) for spec in ("li2012?map=false", f"{submitted}:Mine")]
    assert runs_in == ["none", "confined"], "what comes with pdrbench needs no process of its own"
    assert dataclasses.replace(usual, scheduler="tcp://far:1").isolation_of(Entrant("stay", card)) == "process"


def test_a_strangers_code_runs_confined_beside_a_secret_or_not_at_all(
    settings: Settings, mine: tuple[str, Path]
) -> None:
    nowhere = settings.root / "secret"  # it is not read
    closed = dataclasses.replace(settings, round=Round(number=1, commitment=commitment(SECRET)), secret=nowhere)
    with pytest.raises(BundleError, match="played confined beside a secret"):
        list(run([TOY], [mine[0]], closed, card=mine[1]))
    assert not settings.root.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="confinement is Linux's")
def test_a_bundle_is_played_and_its_code_lies_with_the_entry(
    settings: Settings, mine: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where its walks lie in the cache, which no confined localizer reads."""
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "mine.pdrz"
    path.write_bytes(write_bundle(make_bundle(*mine)))
    short = dataclasses.replace(settings, isolation="confined", parts=("public",), work=tmp_path / "cache" / "boards")
    outcome = next(run([TOY], [str(path)], short))
    assert (outcome.played, dict(outcome.refused)) == (("mine",), {})
    folder = settings.root / "toy" / "mine"
    entry, _ = record.read_entry(folder)
    assert {status for part in entry.parts for of in part.divisions for status in of.statuses} == {"c"}
    assert (folder / "localizer.py").read_bytes() == Path(mine[0].partition(":")[0]).read_bytes()
    again = list(run([TOY], [str(path)], short))
    assert again[0].kept == ("mine",)


def test_a_try_plays_fewer_walks(settings: Settings) -> None:
    few = dataclasses.replace(settings, walks=2)
    list(run([TOY], [STAY], few))
    walks = record.read_walks(settings.root / "toy")
    assert {len(of.walks) for of in walks.values()} <= {1, 2}
    assert all(of.kept == (STAY,) for of in run([TOY], [STAY], few))
    assert any(of.played == (STAY,) for of in run([TOY], [STAY], settings))


def write_private_walks(folder: Path) -> None:
    """A task folder: two straight walks of a phone, with their truth."""
    folder.mkdir(parents=True)
    t_s = np.arange(0.0, 30.0, 0.02)
    bounce = 2.5 * np.sin(2 * np.pi * 1.9 * t_s)
    still = np.zeros_like(t_s)
    rows = np.column_stack([t_s, 0.3 * bounce, still, 9.81 + bounce, 0.1 * bounce, still, 0.05 * bounce])
    for name, end_m in (("first", 20), ("second", 40)):
        np.savetxt(folder / f"{name}.csv", rows, "%.6f", ",", header="t_s,ax,ay,az,gx,gy,gz", comments="")
        (folder / f"{name}_truth.csv").write_text(f"t_s,x_m,y_m,level\n0,0,0,0\n15,{end_m / 2},0,0\n29,{end_m},0,0\n")
    (folder / "columns.toml").write_text(
        'time = "t_s"\ntime_unit = "s"\naccel = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\n'
    )
    tables = "".join(f'[[walk]]\nfile = "{name}.csv"\nmounting = "hand"\n' for name in ("first", "second"))
    (folder / "task.toml").write_text('columns = "columns.toml"\n' + tables)


def test_private_recordings_are_a_column(
    toy_board: Board, settings: Settings, mine: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the host alone has is played beside the board; nothing of it is kept but scores."""
    write_private_walks(tmp_path / "private" / ENV)
    monkeypatch.setenv("PDRBENCH_PRIVATE", str(tmp_path / "private"))
    outcomes = list(run([toy_board], [STAY], settings))
    assert [(of.part, of.played) for of in outcomes] == [(part, (STAY,)) for part in ("public", "held-out", "private")]
    assert all(of.kept == (STAY,) for of in run([toy_board], [STAY], settings))
    with pytest.raises(BundleError, match="played confined"):  # a stranger could read the truth
        list(run([toy_board], [mine[0]], settings, card=mine[1]))
    assert str(tmp_path / "private") in hidden_places()
    monkeypatch.delenv("PDRBENCH_PRIVATE")
    folder = settings.root / "toy" / STAY
    entry, _ = record.read_entry(folder)
    parts = {part.part: part for part in entry.parts}
    assert record.answers_of(entry, record.read_answers(folder), parts["private"]) == b""
    assert len(parts["private"].divisions[0].values["p75_m"]) == 2
    found = read_tables(settings.root, toy_board)[0]
    scores = {name: found.ranked(name).standings[0].score_m for name in ("public", "private")}
    assert found.rows[0].private_ratio == pytest.approx(scores["private"] / scores["public"])
    assert "private / public" in table.page(toy_board, [found])
    findings = list(check_board(settings.root, toy_board))
    assert any("with its host alone" in of.why for of in findings)
    assert {of.name for of in findings if not of.passed} == {"toy/README.md"}  # was not written


def test_a_key_signs_only_what_was_played_here(toy_board: Board, settings: Settings, tmp_path: Path) -> None:
    """A sender's record holds a part that nobody has played: it is played anew, and the two do not agree by score."""
    list(run([toy_board], [STAY], settings))
    folder = settings.root / "toy" / STAY
    honest = record.read_entry(folder)[0]
    forged = re.sub(r'("p75_m": \[)[^]]*', lambda found: re.sub(r"[\d.]+(?=[,\]]|$)", "0.01", found[0]), _entry(folder))
    assert forged != _entry(folder)
    (folder / record.ENTRY_FILE).write_text(forged)
    shutil.copytree(folder, tmp_path / "toy" / STAY)
    settings.root.joinpath("keys.toml").write_text(new_key(tmp_path / "key", "x", datetime.date(2026, 1, 1)))
    signing = dataclasses.replace(settings, key=tmp_path / "key")
    assert [of.played for of in run([toy_board], [STAY], signing)] == [(STAY,)] * 2
    assert record.read_entry(folder)[0].parts == honest.parts and record.is_verified(folder, honest)
    assert all(of.kept for of in run([toy_board], [STAY], signing))
    assert {of.passed for of in compare_entries(folder, folder)} == {True}
    assert disagree(np.ones(2), np.ones(3)) == "2 and 3 walks"
    findings = compare_entries(tmp_path / "toy" / STAY, folder)
    assert len(findings) == 2 and not any(of.passed for of in findings)
    assert "0 of 12 walks agree" in findings[0].why


def test_where_maintainers_sign_a_strangers_entry_has_no_rank_without(played: Settings, tmp_path: Path) -> None:
    root = Path(shutil.copytree(played.root, tmp_path / "boards"))
    assert {row.name for row in read_tables(root, ONE)[0].rows} > {STAY, "mine"}
    (root / "keys.toml").write_text(new_key(tmp_path / "key", "x", datetime.date(2026, 1, 1)))
    assert {row.name for row in read_tables(root, ONE)[0].rows} == {STAY}
    path = root / "toy" / "mine" / record.ENTRY_FILE
    path.write_text(path.read_text().replace('"spec": "localizer.py:Mine"', f'"spec": "{STAY}"'))
    assert {row.name for row in read_tables(root, ONE)[0].rows} == {STAY}


def test_an_entry_is_of_one_code_and_its_name_of_its_authors(
    settings: Settings, submitted: Path, mine: tuple[str, Path], tmp_path: Path
) -> None:
    (spec, card), other = mine, tmp_path / "other.py"
    other.write_text(submitted.read_text() + "\n")
    list(run([ONE], [spec], dataclasses.replace(settings, parts=("public",)), card=card))
    list(run([ONE], [f"{other}:Mine"], dataclasses.replace(settings, parts=("held-out",)), card=card))
    folder = settings.root / "toy" / "mine"
    assert [of.part for of in record.read_entry(folder)[0].parts] == ["held-out"]
    for changed, why in ((card_named(STAY), "is registered"), (card_named("mine", contact="b@c"), "other authors")):
        card.write_bytes(card_toml(changed))
        with pytest.raises(BundleError, match=why):
            list(run([ONE], [spec], settings, card=card))
    (folder / record.ENTRY_FILE).unlink()
    (folder / "card.toml").write_bytes(card_toml(card_named("another")))
    with pytest.raises(BundleError, match="calls itself another"):
        list(run([ONE], [], settings))


def _entry(folder: Path) -> str:
    return (folder / record.ENTRY_FILE).read_text()
