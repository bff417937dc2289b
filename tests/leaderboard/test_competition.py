"""A competition of one's own: its folder, its boards, and what ranks on them."""

from __future__ import annotations

import shutil
import stat
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import BundleError, UnknownNameError
from pdrbench_leaderboard.boards import BOARDS_FILE, boards, chosen_boards, find_round, ranked_walks
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.checking import check_board
from pdrbench_leaderboard.competition import KEY_FILE, MASTER_FILE, new_competition
from pdrbench_leaderboard.draw import draw
from pdrbench_leaderboard.run import Settings, run
from pdrbench_leaderboard.site import write_site
from pdrbench_leaderboard.standings import read_tables
from pdrbench_leaderboard.table import page

from .conftest import ENV, STAY, card_named


@pytest.fixture
def cup(tmp_path: Path) -> Path:
    """A competition on the toy environment."""
    folder = tmp_path / "cup"
    new_competition(folder, [ENV], 'The "Cup"', tmp_path / "private")
    return folder


def settings_of(cup: Path, **changes: object) -> Settings:
    private = cup.parent / "private"
    of_round = find_round(None, cup)
    return Settings(cup, cup.parent / "work", of_round, private / MASTER_FILE, isolation="none", **changes)  # type: ignore[arg-type]


def change(cup: Path, old: str, new: str) -> None:
    text = (cup / BOARDS_FILE).read_text()
    assert text.count(old) == 1
    (cup / BOARDS_FILE).write_text(text.replace(old, new))


def test_an_empty_folder_becomes_a_page_with_entries(cup: Path) -> None:
    (board,) = boards(cup).values()
    assert board.title == 'The "Cup"' and board.home == cup and ranked_walks(cup) == {"main": {ENV: 12}}
    assert not find_round(None, cup).secret, "what is committed to is not published"
    short = settings_of(cup, key=cup.parent / "private" / KEY_FILE, walks=3)
    listed = board.environments[0].first(2)
    ours, theirs = (set(draw(listed, "held-out", of, short.work).walks) for of in ("ab" * 32, short.secret_text))
    assert not ours & theirs, "walks of another secret lie in the folder"
    list(run(chosen_boards((), cup), [STAY], short))
    assert [row.name for row in read_tables(cup, board)[0].rows] == [STAY]
    (cup / "main" / "README.md").write_text(page(board, read_tables(cup, board)))
    assert all(found.passed for found in check_board(cup, board))
    # a server of another user reads what is published
    as_any = stat.S_IMODE((cup / "main" / "README.md").stat().st_mode)
    assert {stat.S_IMODE(path.stat().st_mode) for path in (cup / "main" / STAY).iterdir()} == {as_any}
    hidden = [*short.work.glob("truth/*/*"), *short.work.glob("answers/*")]
    assert len(hidden) > 2 and all(stat.S_IMODE(path.stat().st_mode) & 0o077 == 0 for path in hidden)
    (cup / "main" / STAY / "signed.json").unlink()
    assert not read_tables(cup, board), "nobody has signed it, and its walks are secret"


def test_the_secret_and_the_key_lie_apart_and_only_their_owner_reads_them(cup: Path) -> None:
    private = cup.parent / "private"
    assert sorted(path.name for path in private.iterdir()) == [".gitignore", KEY_FILE, MASTER_FILE]
    secret = (private, private / KEY_FILE, private / MASTER_FILE)
    assert all(stat.S_IMODE(path.stat().st_mode) & 0o077 == 0 for path in secret)
    master = (private / MASTER_FILE).read_text().strip()
    assert not any(master in path.read_text() for path in cup.rglob("*") if path.is_file())
    new, other = cup.parent / "new", cup.parent / "other"
    for folder, apart, why in ((cup, other, "holds"), (new, private, "holds"), (new, new / "inside", "gives away")):
        with pytest.raises(BundleError, match=why):
            new_competition(folder, [ENV], "x", apart)
    with pytest.raises(UnknownNameError):
        new_competition(new, ["Nowhere-v1"], "x", other)
    assert not new.exists() and not other.exists()


def test_recordings_of_the_hosts_are_an_environment_that_stays_with_them(tmp_path: Path, submitted: Path) -> None:
    own, cup = tmp_path / "our_hall", tmp_path / "cup"
    own.mkdir()
    walks = "".join(f'[[walk]]\nfile = "{name}.csv"\ntruth = "places.csv"\nmounting = "hand"\n' for name in "ab")
    (own / "task.toml").write_text(f'[task]\nid = "OurHall-v1"\n{walks}')
    (own / "places.csv").write_text("t_s,x_m,y_m\n" + "".join(f"{t},{0.1 * t},0\n" for t in range(0, 40, 2)))
    for name in "ab":
        force = np.random.default_rng(ord(name)).normal([0.0, 0.0, 9.81], 0.1, (800, 3))
        rows = "".join(f"{k / 20},{x:.4f},{y:.4f},{z:.4f}\n" for k, (x, y, z) in enumerate(force))
        (own / f"{name}.csv").write_text(f"t_s,accel_x,accel_y,accel_z\n{rows}")
    for twice in ([str(own), str(own / "task.toml")], [ENV, ENV]):
        with pytest.raises(BundleError, match="each once"):
            new_competition(cup, twice, "Hall", tmp_path / "private")
    new_competition(cup, [str(own)], "Hall", tmp_path / "private")
    (board,) = boards(cup).values()
    (listed,) = board.environments
    assert listed.spec == str(cup / "OurHall-v1") and listed.parts == ("held-out",) and listed.ranked_walks == 4
    assert "/OurHall-v1/" in (cup / ".gitignore").read_text(), "its truth is not published"
    assert [of.played for of in run([board], [STAY], settings_of(cup, key=tmp_path / "private" / KEY_FILE))] == [
        (STAY,)
    ]
    before = page(board, read_tables(cup, board))
    shutil.rmtree(cup / "OurHall-v1")
    assert page(board, read_tables(cup, board)) == before, "pages are made where the recordings are not"
    assert "not found" in next(iter(run([board], [STAY], settings_of(cup)))).why
    write_site({board: read_tables(cup, board)}, tmp_path / "site")
    assert all(found.passed for found in check_board(cup, board) if "README" not in found.name)


def test_a_board_ranks_by_the_metric_that_it_names(cup: Path, submitted: Path, tmp_path: Path) -> None:
    change(cup, "lost_m = 10.0", 'lost_m = 10.0\nmetric = "max_m"')
    change(cup, f'commitment = "{find_round(None, cup).commitment}"', f'secret = "{"ab" * 32}"')
    (cup / "keys.toml").unlink()
    (board,) = boards(cup).values()
    for name in ("Mine", "Lags"):
        card = tmp_path / f"{name}.toml"
        card.write_bytes(card_toml(card_named(name.lower())))
        settings = Settings(cup, tmp_path / "work", find_round(None, cup), isolation="none", walks=4)
        list(run([board], [f"{submitted}:{name}"], settings, card=card))
    table = read_tables(cup, board)[0]
    (lags,) = [entry for entry in table.entries if entry.name == "lags"]
    score_m = {row.name: row.standing.score_m for row in table.rows}["lags"]
    by_max_m, by_p75_m = (np.exp(np.log(table.values(lags, of)[ENV]).mean()) for of in ("max_m", "p75_m"))
    assert score_m == pytest.approx(by_max_m) and score_m != pytest.approx(by_p75_m)
    assert "| max_m |" in page(board, [table])
    assert all(found.passed for found in check_board(cup, board) if "README" not in found.name)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("lost_m = 10.0", 'lost_m = 10.0\nmetric = "level_hit_rate"', "the less the better"),
        ("lost_m = 10.0", 'lost_m = 10.0\nmetric = "step_p50_ms"', "only one of answers"),
        ("lost_m = 10.0", 'lost_m = 10.0\nmetric = "nothing"', "nothing"),
        ("# Boards of", "= Boards of", "boards.toml"),
    ],
)
def test_a_wrong_file_of_boards_is_named(cup: Path, old: str, new: str, why: str) -> None:
    change(cup, old, new)
    with pytest.raises((BundleError, UnknownNameError), match=why):
        boards(cup)
