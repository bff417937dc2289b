"""`pdrbench leaderboard verify` and `key new`: all entries of a folder are run again by one command."""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from pdrbench.errors import PdrbenchError
from pdrbench_leaderboard import collection, leaderboard_command, signing
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.collection import verify_boards
from pdrbench_leaderboard.entry import read_entry, write_entry
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.suites import OtherSecretError, Suite
from pdrbench_leaderboard.verification import TIERS

from .conftest import NONCE, SECRET, STAY, card_named

PLACE = Path("Toy-v1") / STAY


def run(*arguments: object) -> tuple[int, dict[str, dict[str, Any]]]:
    """Exit status, and rows by name of the entry."""
    result = CliRunner().invoke(leaderboard_command.app, ["verify", *map(str, arguments), "--json"])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, {row["name"]: row for row in json.loads(result.stdout)["entries"]}


@pytest.fixture(scope="module")
def stays(small_suite: Suite) -> Bundle:
    only = {"envs": ["Toy-v1"], "isolation": "none"}
    suite_run = play_suite([STAY], small_suite, nonce=NONCE, **only)[STAY]  # type: ignore[arg-type]
    return make_bundle(STAY, card_named(STAY), small_suite, suite_run)


@pytest.fixture
def options(board: Path, key: Path, tmp_path: Path) -> tuple[object, ...]:
    secret = tmp_path / "secret.txt"
    secret.write_text(SECRET)
    return ("--root", board, "--secret", secret, "--key", key, "--results", tmp_path / "walks")


def test_every_entry_is_verified_once(
    stays: Bundle, packed: dict[str, Bundle], board: Path, options: tuple[object, ...]
) -> None:
    write_entry(board, stays.entries()[0])
    write_entry(board, packed["Wanders"].entries()[0])
    code, rows = run(*options)
    assert code == 0 and rows[str(PLACE)]["tier"] == "verified" and rows[str(PLACE)]["held_out"]["walks"] == 2
    stranger = rows["Toy-v1/wanders"]
    assert stranger["is_left_out"] and "verify the bundle that was sent" in stranger["why"]
    entry = read_entry(board / PLACE)
    assert entry.tier == "verified" and TIERS[-1] == "verified"
    signed = (board / PLACE / "verification.json").read_bytes()
    code, rows = run(*options)
    assert code == 0 and rows[str(PLACE)]["why"] == "verified already"
    assert (board / PLACE / "verification.json").read_bytes() == signed


def test_what_a_revoked_key_has_signed_is_verified_anew(
    stays: Bundle, board: Path, key: Path, options: tuple[object, ...], tmp_path: Path
) -> None:
    write_entry(board, stays.entries()[0])
    run(*options)
    young = tmp_path / "young.key"
    keys = (board / "keys.toml").read_text() + "revoked = 2026-02-01\n"
    (board / "keys.toml").write_text(keys + signing.new_key(young, "M. Aintainer", datetime.date(2026, 2, 1)))
    with pytest.raises(signing.RevokedKeyError):
        read_entry(board / PLACE)
    code, rows = run(*options[:-4], "--key", young, *options[-2:])
    assert code == 0 and rows[str(PLACE)]["tier"] == "verified" and read_entry(board / PLACE).tier == "verified"


def test_an_error_is_that_of_its_environment(
    stays: Bundle, board: Path, options: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise PdrbenchError("the disk is full")

    write_entry(board, stays.entries()[0])
    monkeypatch.setattr(collection, "verify_environment", fails)
    assert run(*options)[1][str(PLACE)]["why"] == "the disk is full"


def test_a_key_that_nobody_lists_and_a_secret_of_no_suite_are_errors(
    stays: Bundle, board: Path, key: Path, tmp_path: Path
) -> None:
    write_entry(board, stays.entries()[0])
    with pytest.raises(OtherSecretError, match="of no suite in this round"):
        list(verify_boards(board, ["another" * 8], key, (), None))
    (board / "keys.toml").unlink()
    with pytest.raises(signing.UnknownKeyError, match="does not list"):
        list(verify_boards(board, [SECRET], key, (), None))


def test_a_new_key_is_printed_as_the_table_of_its_public_half(tmp_path: Path) -> None:
    path = tmp_path / "maintainer.key"
    result = CliRunner().invoke(leaderboard_command.app, ["key", "new", str(path), "--owner", "M. Aintainer"])
    (tmp_path / "keys.toml").write_text(result.stdout)
    keys = signing.read_keys(tmp_path)
    assert list(keys) == [signing.key_id(path)] and keys[signing.key_id(path)].owner == "M. Aintainer"
    assert path.read_text().strip() not in result.stdout
    again = CliRunner().invoke(leaderboard_command.app, ["key", "new", str(path)])
    assert isinstance(again.exception, PdrbenchError) and "never replaces" in str(again.exception)
