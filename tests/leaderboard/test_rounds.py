"""Rounds: one master secret, ranks that stay until every entry has been played again, and a cap on submissions."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from pdrbench.errors import BundleError, PdrbenchError
from pdrbench.task import commitment
from pdrbench_leaderboard import boards, record
from pdrbench_leaderboard.boards import Board, Round
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.entrants import Entrant
from pdrbench_leaderboard.rounds import (
    MAX_SUBMISSIONS,
    SALT,
    begin_round,
    end_round,
    has_to_wait,
    read_submissions,
    round_secret,
)
from pdrbench_leaderboard.run import Settings, run, score_all
from pdrbench_leaderboard.standings import read_tables

from .conftest import ENV, ONE, ROUND, card_named

MASTER = "3a57e2" * 8


def test_secrets_of_rounds_follow_from_the_master_and_nothing_else() -> None:
    derived = HKDF(SHA256(), 32, SALT, b"round 3").derive(MASTER.encode())
    assert round_secret(MASTER, 3) == derived.hex()
    closed = Round(number=3, commitment=commitment(round_secret(MASTER, 3)))
    assert closed.secret_of(MASTER) == closed.secret_of(round_secret(MASTER, 3)) == derived.hex()
    with pytest.raises(BundleError):
        closed.secret_of(MASTER[::-1])


def test_a_round_begins_with_a_commitment_and_ends_with_its_secret(tmp_path: Path) -> None:
    file = tmp_path / "boards.toml"
    file.write_text('# a remark\n\n[[rounds]]\nnumber = 0\nsecret = "x"\n')
    number, digest = begin_round(file, [0], MASTER)
    assert number == 1 and "# a remark" in file.read_text()
    assert tomllib.loads(file.read_text())["rounds"][1] == {"number": 1, "commitment": digest}
    with pytest.raises(BundleError, match="no open round 2"):
        end_round(file, 2, MASTER)
    secret = end_round(file, 1, MASTER)
    assert tomllib.loads(file.read_text())["rounds"][1] == {"number": 1, "secret": secret}
    assert commitment(secret) == digest
    with pytest.raises(PdrbenchError, match="a secret has"):
        begin_round(file, [0], "short")


def ranked(settings: Settings) -> list[set[str]]:
    """Names in each table, and the round that they are ranked on."""
    return [{row.name for row in table.rows} for table in read_tables(settings.root, ONE)]


def test_a_new_round_keeps_ranks_until_each_entry_has_been_played_again(
    settings: Settings, toy_board: Board, submitted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    later = Round(number=1, secret=round_secret(MASTER, 1))
    monkeypatch.setattr(boards, "_file", lambda root: boards._File({ONE.name: ONE}, (ROUND, later)))
    specs = {}
    for name in ("Mine", "Lags", "Wanders"):
        card = tmp_path / f"{name}.toml"
        card.write_bytes(card_toml(card_named(name.lower())))
        specs[name] = (f"{submitted}:{name}", card)
    short = dataclasses.replace(settings, parts=("held-out",))
    for name in ("Mine", "Lags"):
        list(run([ONE], [specs[name][0]], short, card=specs[name][1]))
    before = ranked(settings)
    assert before[0] == {"mine", "lags"}
    second = dataclasses.replace(short, round=later, work=settings.work / "1")
    place = ENV, "held-out"
    for name, expected, number in (("Wanders", {"mine", "lags"}, 0), ("Mine", {"mine", "lags"}, 0)):
        list(run([ONE], [specs[name][0]], second, card=specs[name][1]))
        assert (ranked(settings)[0], record.read_walks(settings.root / "toy")[place].round) == (expected, number)
    list(run([ONE], [specs["Lags"][0]], second, card=specs["Lags"][1]))
    assert ranked(settings)[0] == {"mine", "lags", "wanders"}
    assert [of.round for of in record.all_walks(settings.root / "toy")[place]] == [1]
    assert all(of.kept for of in run([ONE], [specs["Lags"][0]], second, card=specs["Lags"][1]))


def test_who_submits_too_often_waits(tmp_path: Path) -> None:
    card = card_named("mine", contact="A.Author@example.org")
    for number in range(MAX_SUBMISSIONS):
        assert not has_to_wait(tmp_path, 1, card, f"{number}" * 64)
    again = card_named("another", contact=" a.author@EXAMPLE.org ")
    assert has_to_wait(tmp_path, 1, again, "a" * 64)
    assert not has_to_wait(tmp_path, 1, again, "0" * 64), "the same code is no new submission"
    assert not has_to_wait(tmp_path, 2, again, "a" * 64), "the next round"
    assert len(read_submissions(tmp_path)) == MAX_SUBMISSIONS + 1


def test_what_another_machine_has_played_counts_as_well(settings: Settings, mine: tuple[str, Path]) -> None:
    entrant = Entrant(mine[0], card_named("mine"))
    for number in range(MAX_SUBMISSIONS):
        has_to_wait(settings.root, 1, entrant.card, f"{number}" * 64)
    closed = dataclasses.replace(settings, round=Round(number=1, commitment=commitment(MASTER)))
    with pytest.raises(BundleError, match="waits for the next round"):
        list(score_all([ONE], entrant, settings.work, closed))
