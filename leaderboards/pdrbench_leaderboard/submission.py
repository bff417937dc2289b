"""Submissions: code and a card, as a sender packs them and a host plays them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pdrbench.errors import BundleError, PdrbenchError
from pdrbench.registry import localizers
from pdrbench.sensors import SENSORS
from pdrbench.settings import split_name, with_settings_of
from pdrbench_leaderboard.bundle import MAX_BUNDLE_BYTES, Bundle, read_bundle
from pdrbench_leaderboard.card import CARD_FILE, Card, card_of, read_card
from pdrbench_leaderboard.folder_archive import ARCHIVE_FILE, folder_findings, pack_folder
from pdrbench_leaderboard.folders import Supplies, check_packable, folder_of, unpack_source
from pdrbench_leaderboard.schema import MAX_TEXT_BYTES, Finding, read_limited

PYTHON: Final = ".py"


def find_card(spec: str, card: Path | None = None) -> Card:
    """The card of a localizer: the one that is named, that which lies beside its code, or that of its package.

    Raises:
        BundleError: There is none, or it is wrong.
    """
    is_registered = split_name(spec)[0] in localizers()
    place = (None if is_registered else folder_of(spec)) or Path(spec.partition(":")[0]).parent
    beside = [] if is_registered else [place / CARD_FILE]
    found = card or next((path for path in beside if path.is_file()), None)
    return card_of(spec) if found is None else read_card(read_limited(found, MAX_TEXT_BYTES), str(found))


def make_bundle(spec: str, card: Path | None = None) -> Bundle:
    """A bundle of a file or a folder with its card, or of a registered id.

    Args:
        spec: `path/to/file.py:Class`, `path/to/folder`, or an id.
        card: Of its authors; None: `card.toml` beside the code.

    Raises:
        BundleError: It has no card, or imports what it does not lock.
    """
    check_packable(spec)
    found = find_card(spec, card)
    folder, place = folder_of(spec), Path(split_name(spec)[0].partition(":")[0])
    if folder is not None:
        return Bundle(with_settings_of(spec, ARCHIVE_FILE), found, {ARCHIVE_FILE: pack_folder(folder)})
    if place.suffix != PYTHON:
        return Bundle(spec, found, {})
    try:
        content = place.read_bytes()
    except OSError as error:
        raise BundleError(f"cannot read {place}: {error.strerror}") from error
    return Bundle(f"{place.name}:{spec.partition(':')[2]}", found, {place.name: content})


def check_bundle(path: Path) -> list[Finding]:
    """What is wrong with a bundle: nothing of it is run."""
    try:
        bundle = read_bundle(read_limited(path, MAX_BUNDLE_BYTES))
    except PdrbenchError as error:
        return [Finding("bundle", False, str(error))]
    return [Finding("bundle", True), *_rules(bundle), *folder_findings(bundle.source)]


def _rules(bundle: Bundle) -> list[Finding]:
    card, place = bundle.card, split_name(bundle.spec)[0].partition(":")[0]
    unknown = [sensor for sensor in card.sensors_used if sensor not in SENSORS]
    is_taken = split_name(card.name)[0] in localizers() and bundle.spec != card.name
    has_code = place in bundle.source or split_name(bundle.spec)[0] in localizers()
    return [
        Finding("name", not is_taken, f"{card.name} is registered: choose another name" if is_taken else ""),
        Finding("sensors", not unknown, f"no sensor is named {', '.join(unknown)}" if unknown else ""),
        Finding("code", has_code, "" if has_code else f"{place} neither travels with it nor is registered here"),
    ]


def unpack_bundle(path: Path, folder: Path, supplies: Supplies) -> tuple[str, Card]:
    """Writes the code of a bundle into a folder; what `evaluate` runs, and the card.

    Args:
        path: The bundle.
        folder: Made where it is missing; one for each bundle.
        supplies: What is ready for folders.

    Raises:
        BundleError: It breaks a rule.
    """
    broken = next((found for found in check_bundle(path) if not found.passed), None)
    if broken is not None:
        raise BundleError(f"{path}: {broken.name}: {broken.why}")
    bundle = read_bundle(read_limited(path, MAX_BUNDLE_BYTES))
    if not bundle.source:
        return bundle.spec, bundle.card
    folder.mkdir(parents=True, exist_ok=True)
    return unpack_source(bundle.source, bundle.spec, folder, supplies), bundle.card
