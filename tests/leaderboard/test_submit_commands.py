"""`pdrbench submit ...` from a card to an entry, and its errors."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from click.testing import Result
from typer.testing import CliRunner

from pdrbench.errors import PdrbenchError
from pdrbench_leaderboard import submit_command as submit
from pdrbench_leaderboard.bundle import Bundle, write_bundle
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.entry import read_entry
from pdrbench_leaderboard.pack import second_nonce
from pdrbench_leaderboard.suites import Suite

from .conftest import SECRET, STAY, card_named
from .test_verify import tampered

ENTRY = Path("Toy-v1") / "wanders"


def call(*arguments: object) -> Result:
    """The command, whose errors a user sees in one line."""
    result = CliRunner().invoke(submit.app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit | PdrbenchError):
        raise result.exception
    return result


def call_json(*arguments: object) -> Any:
    result = call(*arguments, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture
def file(packed: dict[str, Bundle], tmp_path: Path) -> Path:
    path = tmp_path / "wanders.pdrz"
    path.write_bytes(write_bundle(packed["Wanders"]))
    return path


def test_suites_and_a_card(small_suite: Suite) -> None:
    (item,) = [item for item in call_json("suites")["items"] if item["id"] == "small-v1"]
    assert item["id"] == "small-v1" and item["environments"]["Toy-v1"] == 3
    assert set(item["commitments"]) == set(item["environments"])
    assert all(digest in call("suites").stdout for digest in item["commitments"].values())
    assert call("card", "here/file.py:Mine").stdout.startswith('name = "mine"')


def test_pack_check_and_enter(small_suite: Suite, submitted: Path, tmp_path: Path) -> None:
    card = tmp_path / "card.toml"
    card.write_bytes(card_toml(card_named("wanders")))
    common = ("pack", f"{submitted}:Wanders", "--suite", "small-v1", "--card", card, "--results", tmp_path / "walks")
    (packed,) = call_json(*common, "--out", tmp_path / "x.pdrz")["bundles"]
    assert packed["environments"] == ["Toy-v1"]
    assert (packed["runs"], packed["failed"]) == (6, 0)
    assert list(packed["unsuitable"]) == ["ToyDeaf-v1"]
    board = tmp_path / "board"
    checks = call_json("check", tmp_path / "x.pdrz", "--into", board)
    assert checks["pass"] and {check["kind"] for check in checks["checks"]} == {"rule", "flag"}
    assert (board / ENTRY / "submission.json").is_file()
    again = call(*common, "--into", tmp_path / "other")
    assert "6 runs of 1 environments" in again.stdout and str(tmp_path / "other" / ENTRY) in again.stdout
    for name in ("card.toml", "estimates.bin"):
        assert (board / ENTRY / name).read_bytes() == (tmp_path / "other" / ENTRY / name).read_bytes()


def test_verify_raises_the_tier_and_no_check_takes_it_away(file: Path, board: Path, key: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret.txt"
    secret.write_text(SECRET + "\n")
    printed = call_json("verify", file, "--rerun", "--secret", secret, "--key", key, "--into", board)
    (row,) = printed["entries"]
    assert (row["tier"], row["found"], row["reran"], row["of"]) == ("verified", "verified", 6, 6)
    assert row["held_out"]["walks"] == 2 and row["held_out"]["metrics"]["mean_m"] > 0
    call("check", file, "--into", board)
    assert read_entry(board / ENTRY).tier == "verified"
    assert call("check", board / ENTRY).exit_code == 0
    call_json("verify", file, "--rerun", "--share", "0.5", "--key", key, "--into", board)
    assert read_entry(board / ENTRY).tier == "verified"  # a spot check takes nothing away


def test_a_published_nonce_says_nothing_of_the_next_one(file: Path, tmp_path: Path) -> None:
    results = tmp_path / "reruns"
    rows = [call_json("verify", file, "--rerun", "--results", results)["entries"][0] for _ in range(2)]
    assert rows[0]["nonce"] == rows[1]["nonce"]  # so that it can be continued
    kept = (results / "second_nonce.txt").read_text().strip()
    assert len({rows[0]["nonce"], kept, second_nonce(results, "another"), second_nonce(None)}) == 4
    assert not (results / "nonce.txt").exists()  # that of what is packed there is published


def test_without_a_key_nothing_is_given_a_tier(file: Path, board: Path) -> None:
    result = call("verify", file, "--rerun", "--share", "0.5", "--into", board)
    assert "nothing was signed" in result.stderr and "spot-checked (not signed)" in result.stdout
    assert read_entry(board / ENTRY).tier == "self-reported"


def test_verify_refuses_different_estimates(packed: dict[str, Bundle], tmp_path: Path) -> None:
    path = tmp_path / "bad.pdrz"
    path.write_bytes(write_bundle(tampered(packed["Wanders"], run=2, change_m=0.5)))
    walk = packed["Wanders"].manifest.environments[0].walks[2].walk
    result = call("verify", path, "--rerun", "--into", tmp_path / "board")
    assert result.exit_code == 1
    assert f"Toy-v1: walk {walk}, seed 0" in str(result.exception)
    assert not (tmp_path / "board").exists()


def test_packing_goes_on_with_the_nonce_that_it_began_with(small_suite: Suite, tmp_path: Path) -> None:
    common = ("pack", STAY, "--suite", "small-v1", "--env", "Toy-v1", "--results", tmp_path / "walks")
    nonces = [
        call_json(*common, *options, "--into", tmp_path / f"board-{number}")["bundles"][0]["nonce"]
        for number, options in enumerate([(), (), ("--nonce", "new"), ("--nonce", "")])
    ]
    assert len(nonces[0]) == 32 and nonces[0] == nonces[1] != nonces[2] and nonces[3] == ""


def test_names_of_others_are_kept(packed: dict[str, Bundle], file: Path, tmp_path: Path) -> None:

    call("check", file, "--into", tmp_path)
    card = card_named("wanders", authors=("Somebody Else",))
    manifest = msgspec.structs.replace(
        packed["Wanders"].manifest, card_sha256=hashlib.sha256(card_toml(card)).hexdigest()
    )
    path = tmp_path / "theirs.pdrz"
    path.write_bytes(write_bundle(dataclasses.replace(packed["Wanders"], card=card, manifest=manifest)))
    for options in ((), ("--replace",)):
        result = call("check", path, "--into", tmp_path, *options)
        assert "other authors" in str(result.exception)


def test_another_entry_of_the_same_name_and_authors_replaces_one_on_demand_only(
    packed: dict[str, Bundle], file: Path, tmp_path: Path
) -> None:
    """Whoever sends a bundle can write any author into its card."""
    call("check", file, "--into", tmp_path)
    path = tmp_path / "worse.pdrz"
    path.write_bytes(write_bundle(tampered(packed["Wanders"], run=1, change_m=1.0)))
    before = (tmp_path / ENTRY / "estimates.bin").read_bytes()
    assert "is another entry of this name" in str(call("check", path, "--into", tmp_path).exception)
    assert (tmp_path / ENTRY / "estimates.bin").read_bytes() == before
    assert call("check", path, "--into", tmp_path, "--replace").exit_code == 0
    assert (tmp_path / ENTRY / "estimates.bin").read_bytes() != before


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("pack",), "name a localizer"),
        (("pack", STAY, "--suite", "nothing"), "no suite named"),
        (("pack", "my.py:Mine"), "submit card"),
        (("pack", STAY, "--env", "Toy-v1"), "--into"),
        (("verify", "/nowhere.pdrz", "--secret", "/nowhere"), "--rerun"),
        (("verify", "/nowhere.pdrz", "--rerun", "--key", "/nowhere"), "cannot read the private key"),
        (("pack", STAY, "--nonce", "0123"), "a nonce has 32 digits"),
        (("verify", "/nowhere.pdrz", "--rerun"), "cannot read"),
    ],
)
def test_impossible_requests_are_errors_of_one_line(small_suite: Suite, arguments: tuple[str, ...], why: str) -> None:
    options = () if "--suite" in arguments or arguments[0] != "pack" else ("--suite", "small-v1")
    result = call(*arguments, *options)
    assert isinstance(result.exception, PdrbenchError)
    assert why in str(result.exception) and "\n" not in str(result.exception)
