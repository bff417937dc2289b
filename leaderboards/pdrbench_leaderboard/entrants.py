"""What is played for entries of a board: localizers of pdrbench, those that are named, and what lies with entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pdrbench.errors import BundleError, UnknownNameError, UnsuitableError
from pdrbench.evaluation.origin import localizer_target, target_sha256
from pdrbench.files import sha256_of
from pdrbench.registry import OURS, localizers, make_localizer
from pdrbench.settings import split_name
from pdrbench_leaderboard.card import CARD_FILE, Card, card_of
from pdrbench_leaderboard.record import ENTRY_FILE, folder_name, read_entry
from pdrbench_leaderboard.submission import find_card

SOURCE_FILE, SOURCE_FOLDER = "localizer.py", "localizer"  # that lie with an entry
SOURCE_CLASS: Final = "Localizer"  # of such a file, where no record says another


@dataclass(frozen=True, slots=True)
class Entrant:
    """What is played for an entry."""

    spec: str  # as `evaluate` takes it
    card: Card

    @property
    def is_registered(self) -> bool:
        """Whether it is registered, so that it is code which was installed here on purpose."""
        return split_name(self.spec)[0] in localizers()

    @property
    def is_ours(self) -> bool:
        """Whether it comes with pdrbench itself."""
        return self.is_registered and localizers()[split_name(self.spec)[0]].package == OURS

    @property
    def is_here(self) -> bool:
        """False where it names a localizer that is not installed, or that declines already when it is made.

        As adapters of the laboratory do without the package that they adapt.
        """
        try:
            return bool(self.sha256 and (not self.is_registered or make_localizer(self.spec)))
        except (UnknownNameError, UnsuitableError):
            return False

    @property
    def sha256(self) -> str:
        """Digest of its code: of a file whatever it is called, else as results have it."""
        place = Path(self.spec.partition(":")[0])
        if place.suffix == ".py" and not self.is_registered:
            return sha256_of(place)
        return target_sha256(localizer_target(self.spec))

    @property
    def source(self) -> tuple[str, bytes | None]:
        """What its record says was played, without folders of this machine, and the file that is kept with it."""
        place, colon, attribute = self.spec.partition(":")
        if self.is_registered or not place.endswith(".py"):
            return self.spec if self.is_registered else Path(place).name, None
        return f"{SOURCE_FILE}{colon}{attribute}", Path(place).read_bytes()


def entrants(board: str, root: Path, named: Sequence[str] = (), card: Path | None = None) -> list[Entrant]:
    """What is played on a board: the localizers that are named, or those of pdrbench and what lies with its entries.

    Args:
        board: Name of the board.
        root: Holds the boards.
        named: As `evaluate` takes them.
        card: Of the one that is named, where it brings none.

    Raises:
        BundleError: One has no card, or that of another name.
    """
    if named:
        return [Entrant(absolute(spec), find_card(spec, card)) for spec in named]
    ours = [name for name, entry in localizers().items() if entry.package == OURS]
    found = [Entrant(name, card_of(name)) for name in sorted(ours)]
    for path in sorted((root / board).glob(f"*/{CARD_FILE}")):
        spec = _spec_of(path.parent)
        if spec not in ours:
            found.append(Entrant(spec, find_card(spec, path)))
            if folder_name(found[-1].card.name) != path.parent.name:
                raise BundleError(f"{path.parent} holds an entry that calls itself {found[-1].card.name}")
    return found


def _spec_of(folder: Path) -> str:
    """What is played for what lies in the folder of an entry."""
    spec = read_entry(folder)[0].spec if (folder / ENTRY_FILE).is_file() else ""
    if (folder / SOURCE_FILE).is_file():
        return f"{folder.absolute() / SOURCE_FILE}:{spec.partition(':')[2] or SOURCE_CLASS}"
    if (folder / SOURCE_FOLDER).is_dir():
        return str(folder.absolute() / SOURCE_FOLDER)
    if not spec:
        raise BundleError(f"{folder} holds a card and no {SOURCE_FILE} or folder {SOURCE_FOLDER}")
    return spec


def absolute(spec: str) -> str:
    """A localizer as every working folder knows it."""
    place, colon, rest = spec.partition(":")
    is_path = spec not in localizers() and (place.endswith(".py") or Path(place).is_dir())
    return f"{Path(place).absolute()}{colon}{rest}" if is_path else spec
