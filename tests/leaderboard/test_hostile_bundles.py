"""Bundles and entries that lie, class by class: each is refused, and the refusal says why in one harmless line."""

from __future__ import annotations

import dataclasses
import datetime
import hashlib
import io
import json
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from pdrbench.errors import BundleError
from pdrbench.evaluation import answers
from pdrbench.result import Result
from pdrbench_leaderboard import bundle as bundles
from pdrbench_leaderboard import signing
from pdrbench_leaderboard.bundle import Bundle, write_bundle
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.checking import check
from pdrbench_leaderboard.collection import check_boards, read_boards
from pdrbench_leaderboard.entry import read_entry, write_entry
from pdrbench_leaderboard.manifest import OldFormatError
from pdrbench_leaderboard.signing import (
    DamagedSignatureError,
    MissingSignatureError,
    RevokedKeyError,
    UnknownKeyError,
)
from pdrbench_leaderboard.verification import OtherEntryError
from pdrbench_leaderboard.verify import Terms, verify

from .conftest import SECOND_NONCE, SECRET, card_named, signed_again
from .test_submit_commands import call

Members = dict[str, bytes]
SWOLLEN = zlib.compress(bytes(10_000_000))
SWELLS = struct.pack("<4sII6B2x", b"PDE1", 10, len(SWOLLEN), *([1] * 6)) + SWOLLEN
SINCE = datetime.date(2026, 1, 1)


def broken(path: Path) -> str:
    """Why a file or a folder is refused; empty where it is not."""
    failed = [f for f in check(path).findings if not (f.passed or f.is_flag)]
    return "; ".join(f"{finding.name}: {finding.why}" for finding in failed)


def members_of(bundle: Bundle) -> Members:
    with zipfile.ZipFile(io.BytesIO(write_bundle(bundle))) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def zipped(members: Members, compression: int = zipfile.ZIP_STORED) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return target.getvalue()


def with_json(members: Members, change: Callable[[Any], object], name: str = "manifest.json") -> Members:
    """Members with a JSON file changed in place."""
    plain = json.loads(members[name])
    change(plain)
    return members | {name: json.dumps(plain).encode()}


def manifest(**changes: object) -> Callable[[Members], bytes]:
    """A bundle whose manifest says something else."""
    return lambda members: zipped(with_json(members, lambda plain: plain.update(changes)))


def record(**changes: object) -> Callable[[Members], bytes]:
    """A bundle whose environment says something else."""
    return lambda members: zipped(with_json(members, lambda plain: plain["environments"][0].update(changes)))


def walk(**changes: object) -> Callable[[Members], bytes]:
    """A bundle whose first walk says something else."""
    return lambda members: zipped(
        with_json(members, lambda plain: plain["environments"][0]["walks"][0].update(changes))
    )


def without_a_walk(members: Members) -> bytes:
    """The walk that went worst is left out everywhere."""
    name = "estimates/Toy-v1.bin"
    content, ends = members[name], [0]
    while ends[-1] < len(content):
        ends.append(answers.decode(content, name, ends[-1])[1])
    return zipped(estimates(members, content[: ends[-2]], lambda record: record["walks"].pop()))


def estimates(members: Members, content: bytes, change: Callable[[Any], object] = lambda _: None) -> Members:
    """Members with other estimates, whose digest is made to fit."""

    def fit(plain: Any) -> None:
        plain["environments"][0]["estimates_sha256"] = hashlib.sha256(content).hexdigest()
        change(plain["environments"][0])

    return with_json(members, fit) | {"estimates/Toy-v1.bin": content}


def walk_twice(members: Members) -> bytes:
    def change(plain: Any) -> None:
        walks = plain["environments"][0]["walks"]
        walks[1] = walks[0]

    return zipped(with_json(members, change))


def card_of_another(members: Members) -> bytes:
    text = card_toml(card_named("other"))
    changed = with_json(members, lambda plain: plain.update(card_sha256=hashlib.sha256(text).hexdigest()))
    return zipped(changed | {"card.toml": text})


def raw(change: Callable[[bytearray], None]) -> Callable[[Members], bytes]:
    def build(members: Members) -> bytes:
        content = bytearray(zipped(members))
        change(content)
        return bytes(content)

    return build


def lock(content: bytearray) -> None:
    content[content.index(b"PK\x01\x02") + 8] |= 1


def overlap(content: bytearray) -> None:
    first = content.index(b"PK\x01\x02")
    second = content.index(b"PK\x01\x02", first + 4)
    content[second + 42 : second + 46] = content[first + 42 : first + 46]


def link(members: Members) -> bytes:
    target = io.BytesIO(zipped(members))
    with zipfile.ZipFile(target, "a") as archive:
        info = zipfile.ZipInfo("source/link.py")
        info.create_system, info.external_attr = 3, 0o120777 << 16
        archive.writestr(info, b"/etc/passwd")
    return target.getvalue()


def added(name: str, content: bytes = b"x") -> Callable[[Members], bytes]:
    return lambda members: zipped({**members, name: content})


BUNDLES: dict[str, tuple[Callable[[Members], bytes], str]] = {
    # the zip
    "climbs out of its folder": (added("estimates/../../x"), "as none that"),
    "has a member that moves the cursor": (added("a\x1b[2Jb"), "as none that"),
    "has a member that nothing lists": (added("estimates/more.bin"), "does not list"),
    "has a source file that nothing lists": (added("source/more.py"), "the manifest lists"),
    "is a bomb": (lambda m: zipped(m | {"bomb.bin": bytes(5_000_000)}, zipfile.ZIP_DEFLATED), "compressed"),
    "is locked": (raw(lock), "encrypted"),
    "has members in one place": (raw(overlap), "overlaps|no bundle"),
    "is cut off": (lambda m: zipped(m)[:-40], "no bundle"),
    "links to a file of the reader": (link, "a link"),
    "is too large": (added("source/x.py", bytes(200_000)), "are allowed"),
    # what it says it ran
    "is of yesterday": (manifest(schema=1), "--suite"),
    "gives itself a tier": (manifest(tier="verified"), "tier"),
    "is of no suite": (manifest(suite="easy-v0"), "no suite named"),
    "has a nonce of its own making": (manifest(nonce="lucky"), "nonce"),
    "has the card of another": (card_of_another, "its card of"),
    "leaves an environment out": (manifest(unsuitable={}), "lacks ToyDeaf-v1"),
    "has an environment more": (manifest(unsuitable={"ToyDeaf-v1": "", "Moon-v0": ""}), "Moon-v0 is none of"),
    "asks for a million seeds": (manifest(seeds=10**6), "seeds"),
    "draws and has one seed": (
        lambda m: manifest(seeds=1)(with_json(m, lambda p: p["environments"][0].update(deterministic=False))),
        "1 seeds",
    ),
    "is nested without end": (lambda m: zipped(m | {"manifest.json": b'{"isolation":[{"a":' + b"[" * 9000}), "deep"),
    # its walks
    "walks at half the pace": (record(period_s=0.5), "s between observations"),
    "has no period": (record(period_s=float("nan")), "manifest.json"),
    "leaves its worst walk out": (without_a_walk, "lacks walk"),
    "has its best walk twice": (walk_twice, "twice|lacks|are listed"),
    "has fewer estimates than it says": (walk(rows=3), "3 are listed"),
    "has more estimates than memory": (walk(rows=10**9), "rows"),
    "counts what is missing below nothing": (walk(missing={"nan": -1}), "missing"),
    "has other estimates than it says": (record(estimates_sha256="0123456789abcdef" * 4), "digest"),
    "has estimates that swell": (lambda m: zipped(estimates(m, SWELLS)), "does not inflate"),
    # its times
    "took less than no time": (walk(reset_s=-1.0), "reset_s"),
    "took steps without end": (walk(step_times="9" * 400), "step_times"),
    "failed with a book": (walk(failure="x" * 5000), "failure"),
}


@pytest.mark.parametrize("name", BUNDLES)
def test_a_bundle_that_lies_is_refused(
    packed: dict[str, Bundle], tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    build, why = BUNDLES[name]
    monkeypatch.setattr(bundles, "MAX_SOURCE_BYTES", 100_000)
    members = members_of(packed["Mine"])
    if name == "is too large":
        digest = hashlib.sha256(bytes(200_000)).hexdigest()
        members = with_json(members, lambda plain: plain["source"].update({"x.py": digest}))
    path = tmp_path / "x.pdrz"
    path.write_bytes(build(members))
    refusal = broken(path)
    assert refusal and any(part in refusal for part in why.split("|")), refusal
    assert refusal.isprintable()


def test_a_device_is_not_read_to_its_end() -> None:
    assert "it is no file" in broken(Path("/dev/zero"))


def test_a_sound_bundle_is_not_refused(packed: dict[str, Bundle], tmp_path: Path) -> None:
    path = tmp_path / "x.pdrz"
    path.write_bytes(zipped(members_of(packed["Mine"])))
    assert broken(path) == ""


# Folders of entries --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tree(packed: dict[str, Bundle], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of leaderboards with one entry, which is verified and draws random numbers, and the key beside it."""
    place = tmp_path_factory.mktemp("tree")
    (place / "leaderboards").mkdir()
    table = signing.new_key(place / "maintainer.key", "M. Aintainer", SINCE)
    (place / "leaderboards" / "keys.toml").write_text(table)
    terms = Terms(nonce=SECOND_NONCE, secrets=(SECRET,), key=place / "maintainer.key")
    (one,) = verify(packed["Wanders"], terms)
    made = write_entry(place / "leaderboards", one.entry)
    assert read_entry(made).tier == "verified" and (made / "rerun.bin").is_file()
    return place


@pytest.fixture
def folder(tree: Path, tmp_path: Path) -> Path:
    """A copy of that entry, to be changed."""
    shutil.copytree(tree, tmp_path, dirs_exist_ok=True)
    return tmp_path / "leaderboards" / "Toy-v1" / "wanders"


def signed_file(folder: Path) -> dict[str, str]:
    found: dict[str, str] = json.loads((folder / "verification.json").read_text())
    return found


def write_signed(folder: Path, **changes: str) -> None:
    (folder / "verification.json").write_text(json.dumps(signed_file(folder) | changes))


def own_key(folder: Path) -> Path:
    """A key that its maker lists nowhere."""
    path = folder.parents[2] / "stranger.key"
    if not path.exists():
        signing.new_key(path, "A. Stranger", SINCE)
    return path


def forged(folder: Path, **changes: object) -> None:
    """The record as a stranger would like it to be, signed with a key of their own."""
    signed_again(folder, own_key(folder), **changes)


def says_tier(folder: Path) -> None:
    (folder / "verification.json").unlink()
    (folder / "rerun.bin").unlink()
    plain = json.loads((folder / "submission.json").read_text())
    (folder / "submission.json").write_text(json.dumps(plain | {"tier": "verified"}))


def of_yesterday(folder: Path) -> None:
    plain = json.loads((folder / "submission.json").read_text())
    (folder / "submission.json").write_text(json.dumps(plain | {"schema": 1, "tier": "verified"}))


def better(results: Sequence[Result]) -> bytes:
    """Estimates that are 1 mm elsewhere."""
    wholes = [answers.whole_numbers(result.estimates) for result in results]
    return b"".join(answers.encode(whole + np.array([[10], [0], [0], [0], [0], [0]])) for whole in wholes)


def raise_score(folder: Path) -> None:
    """Other estimates under the record of those that were verified, every digest made to fit."""
    content = better(read_entry(folder).sent)
    (folder / "estimates.bin").write_bytes(content)
    plain = json.loads((folder / "submission.json").read_text())
    plain["environments"][0]["estimates_sha256"] = hashlib.sha256(content).hexdigest()
    (folder / "submission.json").write_text(json.dumps(plain))


def raise_rerun(folder: Path) -> None:
    (folder / "rerun.bin").write_bytes(better(read_entry(folder).results))


def own_keys(folder: Path) -> None:
    forged(folder)
    table = signing.key_table(own_key(folder), "maintainer", SINCE)
    (folder / "keys.toml").write_text(table)


def other_key_same_id(folder: Path) -> None:
    name = signed_file(folder)["key"]
    forged(folder)
    write_signed(folder, key=name)


def revoke(folder: Path) -> None:
    keys = folder.parents[1] / "keys.toml"
    keys.write_text(keys.read_text() + "revoked = 2026-02-01\n")


def young_key(folder: Path) -> None:
    keys = folder.parents[1] / "keys.toml"
    keys.write_text(keys.read_text().replace("from = 2026-01-01", "from = 2099-01-01"))


def no_signature(folder: Path) -> None:
    plain = signed_file(folder)
    (folder / "verification.json").write_text(json.dumps({"body": plain["body"]}))


def only_results(folder: Path) -> None:
    (folder / "verification.json").unlink()


def better_values(folder: Path) -> None:
    body = json.loads(signed_file(folder)["body"])
    body["held_out"]["values"]["p75_level_penalised_m"] = [0.1, 0.1]
    write_signed(folder, body=json.dumps(body))


def by_maintainer(**changes: object) -> Callable[[Path], None]:
    """A record that a maintainer has signed, and that does not belong to the entry."""
    return lambda folder: signed_again(folder, folder.parents[2] / "maintainer.key", **changes)


def linked(folder: Path) -> None:
    (folder / "card.toml").unlink()
    (folder / "card.toml").symlink_to("/etc/hostname")


def linked_tree(folder: Path) -> None:
    """A link to a tree elsewhere, with an entry, a record and the key that signed it."""
    elsewhere = folder.parents[2] / "elsewhere"
    forged(folder)
    shutil.copytree(folder.parents[1], elsewhere)
    (elsewhere / "keys.toml").write_text(signing.key_table(own_key(folder), "maintainer", SINCE))
    shutil.rmtree(folder.parent)
    folder.parent.symlink_to(elsewhere / folder.parent.name)


def renamed(folder: Path) -> None:
    """The entry of another, under a name of one's own."""
    plain = json.loads((folder / "submission.json").read_text())
    card = card_toml(card_named("thief"))
    (folder / "card.toml").write_bytes(card)
    plain |= {"localizer": "thief", "card_sha256": hashlib.sha256(card).hexdigest()}
    (folder / "submission.json").write_text(json.dumps(plain))
    folder.rename(folder.with_name("thief"))


ENTRIES: dict[str, tuple[Callable[[Path], None], type[BundleError], str]] = {
    "says its tier itself": (says_tier, BundleError, "tier"),
    "is of yesterday": (of_yesterday, OldFormatError, "submit pack submitted.py:Wanders --suite"),
    "has a verification without a signature": (no_signature, MissingSignatureError, "not signed"),
    "has a second run that nobody signed": (only_results, MissingSignatureError, "no signed verification.json"),
    "is signed by a stranger": (forged, UnknownKeyError, "does not list"),
    "brings the key of a stranger": (own_keys, BundleError, "'keys.toml', which is no part"),
    "is signed by a stranger in another's name": (other_key_same_id, DamagedSignatureError, "not of this text"),
    "is signed with a revoked key": (revoke, RevokedKeyError, "revoked on 2026-02-01"),
    "is older than the key that signed it": (young_key, UnknownKeyError, "counts from 2099"),
    "has better values than were signed": (better_values, DamagedSignatureError, "not of this text"),
    "has other estimates than were verified": (raise_score, OtherEntryError, "entry_sha256"),
    "has another second run than was signed": (raise_rerun, BundleError, "digest is another"),
    "lacks the second run": (lambda f: (f / "rerun.bin").unlink(), BundleError, "rerun.bin"),
    "is the entry of another": (renamed, OtherEntryError, "localizer"),
    "has the record of another environment": (by_maintainer(env="Easy-v0"), OtherEntryError, "env is Easy-v0"),
    "is verified without held-out walks": (by_maintainer(held_out=None), BundleError, "goes with held-out walks"),
    "is reproduced in part": (by_maintainer(reran=1), BundleError, "only 1 of 6 runs"),
    "is a link": (linked, BundleError, "no part of an entry"),
    "lies behind a link to another tree": (linked_tree, BundleError, "is a link"),
}


@pytest.mark.parametrize("name", ENTRIES)
def test_an_entry_that_lies_is_refused(folder: Path, name: str) -> None:
    change, error, why = ENTRIES[name]
    change(folder)
    (there,) = folder.parent.glob("*")
    with pytest.raises(error) as refusal:
        read_entry(there)
    assert type(refusal.value) is error and why in str(refusal.value)
    assert str(refusal.value).isprintable()
    assert why in broken(there)
    with pytest.raises(BundleError):
        read_boards(folder.parents[1])
    (found,) = [finding for finding in check_boards(folder.parents[1]) if "TABLE" not in finding.name]
    assert not found.passed and why in found.why


def test_keys_that_are_no_keys_are_refused(folder: Path) -> None:
    keys = folder.parents[1] / "keys.toml"
    good = keys.read_text()
    for bad in ("[x]\n", good.replace('public = "', 'public = "zz'), good + 'private = "x"\n', "[" * 5000):
        keys.write_text(bad)
        with pytest.raises(BundleError):
            read_entry(folder)
    keys.unlink()
    with pytest.raises(UnknownKeyError):
        read_entry(folder)


def test_a_private_key_is_its_owners_alone(tmp_path: Path) -> None:
    path = tmp_path / "k.key"
    assert 'owner = "A \\"B\\""' in signing.new_key(path, 'A "B"', SINCE)
    assert path.stat().st_mode & 0o777 == 0o600
    with pytest.raises(Exception, match="never replaces a file"):
        signing.new_key(path, "x", SINCE)
    path.chmod(0o640)
    with pytest.raises(signing.PrivateKeyError, match="can be read by others"):
        signing.key_id(path)
    path.chmod(0o600)
    for content in ("", "00", "zz" * 32, "0" * 63):
        path.write_text(content)
        with pytest.raises(signing.PrivateKeyError, match="holds no private key"):
            signing.key_id(path)


def test_what_a_stranger_wrote_is_printed_harmlessly(packed: dict[str, Bundle], tmp_path: Path) -> None:
    """Control characters in a card are text of the card, and no command of a terminal."""
    card = card_named("mine", sensors_used=("po\x1b[2J\u202esition",))
    text = card_toml(card)
    changed = dataclasses.replace(
        packed["Mine"],
        card=card,
        manifest=msgspec.structs.replace(packed["Mine"].manifest, card_sha256=hashlib.sha256(text).hexdigest()),
    )
    path = tmp_path / "x.pdrz"
    path.write_bytes(write_bundle(changed))
    for options in ((), ("--json",)):
        output = call("check", path, *options).output
        assert "no sensor is named" in output
        assert all(sign.isprintable() or sign == "\n" for sign in output)
