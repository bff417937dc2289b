"""`pdrbench leaderboard run`: every entry on every board, in three steps: draw, play, score."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from pdrbench.datasets import cache_folder
from pdrbench.errors import BundleError
from pdrbench.evaluation.cluster import on_cluster
from pdrbench.evaluation.origin import localizer_target, versions
from pdrbench.evaluation.store import make_folder, write_whole
from pdrbench.files import sha256_of
from pdrbench.process.launch import CONFINED, Isolation, find_launcher
from pdrbench.registry import localizers
from pdrbench.result import OFFLINE, ONLINE, UNSUITABLE, Result
from pdrbench.settings import split_name
from pdrbench_leaderboard.boards import PARTS, Board, BoardEnvironment, Part, Round, read_secret
from pdrbench_leaderboard.bundle import SUFFIX
from pdrbench_leaderboard.canaries import examine, judge
from pdrbench_leaderboard.card import CARD_FILE
from pdrbench_leaderboard.confine.read_permissions import private_root
from pdrbench_leaderboard.draw import NAME_DIGITS, DrawnPart, draw, made_by, walks_sha256
from pdrbench_leaderboard.entrants import SOURCE_FILE, Entrant, absolute, entrants
from pdrbench_leaderboard.folders import Supplies
from pdrbench_leaderboard.packages import default_place
from pdrbench_leaderboard.play import answers_folder, play, read_played
from pdrbench_leaderboard.record import (
    ENTRY_FILE,
    SIGNATURE_FILE,
    PartRecord,
    PartWalks,
    all_walks,
    answers_of,
    folder_name,
    held,
    is_verified,
    list_entries,
    part_record,
    part_walks,
    read_answers,
    read_entry,
    sign_entry,
    write_entry,
    write_walks,
)
from pdrbench_leaderboard.rounds import MAX_SUBMISSIONS, author_of, has_to_wait
from pdrbench_leaderboard.score import kept_metrics, score_part
from pdrbench_leaderboard.signing import check_listed
from pdrbench_leaderboard.submission import find_card, unpack_bundle

ANSWERS: Final = "answers"  # below the folder of a round
CONFINED_MODE: Final = "landlock+namespaces+seccomp"  # of a localizer that was confined
WRITTEN: Final = "written"  # likewise: digests of entries
SENT: Final = "sent"  # beside packages: bundles, unpacked
Drawing = functools.partial[DrawnPart]


@dataclass(frozen=True, slots=True)
class Settings:
    """How boards are played.

    Attributes:
        root: Folder that holds `<board>/<entry>/`.
        work: Folder that keeps drawn walks and answers; on a cluster, one that all machines see.
        round: Whose held-out walks are played.
        secret: File with what is behind them, where it is not published.
        jobs: Processes.
        scheduler: Address of a Dask scheduler whose workers play; None: this machine.
        parts: That are played.
        walks: At most so many of each part, for a try; None: all.
        isolation: Of localizers; None: "none" for those of pdrbench where no cluster plays, as their code evaluates as
            well; "process" for others that are registered, "confined" for what is not.
        supplies: Wheels and weights of folders that were sent.
        key: Private key that signs entries; None: they are not signed.
        progress: Shows on stderr how far it is.
    """

    root: Path
    work: Path
    round: Round
    secret: Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    parts: tuple[Part, ...] = PARTS
    walks: int | None = None
    isolation: Isolation | None = None
    supplies: Supplies = field(default_factory=Supplies)
    key: Path | None = None
    progress: bool = False

    @property
    def secret_text(self) -> str:
        """What is behind held-out walks, read now; raises `BundleError`."""
        return self.round.secret_of(None if self.secret is None else read_secret(self.secret))

    def isolation_of(self, entrant: Entrant) -> Isolation:
        """What an entry runs in."""
        is_here = entrant.is_ours and self.scheduler is None
        return self.isolation or ("none" if is_here else "process" if entrant.is_registered else CONFINED)

    def check(self, wanted: Sequence[Entrant]) -> None:
        """Raises where a stranger's code would run beside a secret or a key in a process that is not confined.

        Neither of them has been read when this is called.

        Raises:
            BundleError: Another isolation was asked for.
            PdrbenchError: The system denies what confinement needs.
        """
        guarded = self.key is not None or not self.round.secret or private_root() is not None
        for entrant in wanted if guarded else ():
            if entrant.is_registered:
                continue
            if self.isolation_of(entrant) != CONFINED:
                raise BundleError(f"{entrant.card.name} is not registered here: it is played confined beside a secret")
            find_launcher(CONFINED).check(entrant.spec, localizer_target(entrant.spec))

    def drawing(self, boards: Sequence[Board]) -> Drawing:
        """`draw` for parts of environments of boards; raises `BundleError`."""
        beside = {of.env: of.first(self.walks) for board in boards for of in board.environments}.values()
        shown = functools.partial(draw, jobs=self.jobs, progress=self.progress)
        return functools.partial(shown, secret=self.secret_text, folder=self.work, beside=list(beside))

    @staticmethod
    def work_of(of_round: Round) -> Path:
        """Where drawn walks and answers of a round are kept by default: competitions have rounds of the same number."""
        return cache_folder() / "boards" / f"round-{of_round.number}-{of_round.sha256[:NAME_DIGITS]}"

    def why_later(self, entrant: Entrant) -> str:
        """Why an entry is not played in this round, which is noted else; empty where it is."""
        is_free = entrant.is_registered or bool(self.round.secret)
        if is_free or not has_to_wait(self.root, self.round.number, entrant.card, entrant.sha256):
            return ""
        return f"{entrant.card.name} waits for the next round: its authors have submitted {MAX_SUBMISSIONS} times"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one part of an environment on a board."""

    board: str
    env: str
    part: Part
    played: tuple[str, ...] = ()  # entries
    kept: tuple[str, ...] = ()  # entries that were done already
    declined: tuple[str, ...] = ()  # localizers that it suits on no walk
    refused: Mapping[str, str] = field(default_factory=dict)  # why, by entry
    held: Mapping[str, str] = field(default_factory=dict)  # why a person has to look at it, by entry
    why: str = ""  # why it was left out


def run(
    boards: Sequence[Board], named: Sequence[str], settings: Settings, *, card: Path | None = None
) -> Iterator[Outcome]:
    """Plays what is not done yet, one part of an environment after the other, and writes entries.

    Args:
        boards: To be played.
        named: Localizers, or bundles that were sent; all entries where there are none.
        settings: How.
        card: Of the localizer, where one is named that brings none.

    Raises:
        BundleError: A bundle breaks a rule, a card is missing, a name is another's, or code that is not registered
            would run unconfined beside a secret.
    """
    sent = [unpacked(spec, settings) for spec in named if spec.endswith(SUFFIX)]
    others = [spec for spec in named if not spec.endswith(SUFFIX)]
    wanted_on = {
        board.name: [*sent, *(entrants(board.name, settings.root, others, card) if others or not sent else ())]
        for board in boards
    }
    for name, all_of_it in wanted_on.items() if not named else ():
        for one in [one for one in all_of_it if not one.is_here]:
            all_of_it.remove(one)
            yield Outcome(name, "every environment", "held-out", why=f"{one.card.name} is not installed here")
    settings.check([one for wanted in wanted_on.values() for one in wanted])
    _check_names(wanted_on, settings)
    drawing = settings.drawing(boards)
    for board in boards:
        wanted = []
        for one in wanted_on[board.name]:
            if why := settings.why_later(one):
                yield Outcome(board.name, "every environment", "held-out", why=why)
            else:
                wanted.append(one)
        for each in board.environments:
            listed = each.first(settings.walks)
            for part in listed.parts:
                if part in settings.parts:
                    yield _run_part(board, listed, part, wanted, settings, drawing)


def _check_names(wanted_on: Mapping[str, Sequence[Entrant]], settings: Settings) -> None:
    """Raises `BundleError` where an entry would take the place of another, or its signature would count nothing."""
    if settings.key is not None:
        check_listed(settings.key, settings.root)
    for board, one in ((board, one) for board, wanted in wanted_on.items() for one in wanted):
        name, path = one.card.name, settings.root / board / folder_name(one.card.name) / CARD_FILE
        if [of.card.name for of in wanted_on[board]].count(name) > 1:
            raise BundleError(f"two entries of {board} are called {name}")
        if not one.is_registered and split_name(name)[0] in localizers():
            raise BundleError(f"{name} is registered: {one.spec} needs another name")
        if path.is_file() and author_of(find_card(one.spec, path)) != author_of(one.card):
            raise BundleError(f"{name} is an entry of other authors: {one.spec} needs another name")


def draw_all(boards: Sequence[Board], settings: Settings) -> Iterator[DrawnPart]:
    """Draws the walks of boards, as the first of three steps: nothing is played. Raises `BundleError`."""
    drawing = settings.drawing(boards)
    for listed in drawing.keywords["beside"]:
        parts = [part for part in listed.parts if listed.has_data and part in settings.parts]
        yield from (drawing(listed, part) for part in parts)


def unpacked(spec: str, settings: Settings, card: Path | None = None) -> Entrant:
    """A localizer or a bundle, and its card; raises `BundleError`."""
    if not spec.endswith(SUFFIX):
        return Entrant(absolute(spec), find_card(spec, card))
    place = (settings.supplies.packages or default_place()) / SENT / sha256_of(Path(spec))[:NAME_DIGITS]  # readable
    return Entrant(*unpack_bundle(Path(spec), place, settings.supplies))


def score_all(boards: Sequence[Board], entrant: Entrant, answers: Path, settings: Settings) -> Iterator[Outcome]:
    """Scores what another machine has played, as the last of three steps; nothing of the localizer is run.

    Args:
        boards: Whose entries are written.
        entrant: Whose answers they are.
        answers: Folder that `leaderboard play` has written.
        settings: How; `work` holds what was drawn.

    Raises:
        BundleError: The answers are no answers to these walks, nobody knows whose they are, or their authors have
            submitted too often.
    """
    _check_names({board.name: [entrant] for board in boards}, settings)
    if why := settings.why_later(entrant):
        raise BundleError(why)
    for board in boards:
        for listed in board.environments:
            for part in settings.parts:
                drawn = DrawnPart(listed.env, part, settings.work)
                folder = answers_folder(answers, drawn.observations)
                if folder.is_dir() and drawn.observations.is_dir():
                    results = _as_played_by(entrant, read_played(folder, drawn.observations))
                    yield _enter_all(board, drawn, [entrant], results, settings, was_elsewhere=True)


def _as_played_by(entrant: Entrant, results: Sequence[Result]) -> list[Result]:
    """Results of an entry: of its id, or of the only localizer that is there, whatever its folder was called."""
    names = {result.localizer for result in results}
    if entrant.spec in names:
        return [result for result in results if result.localizer == entrant.spec]
    if entrant.is_registered or len(names) != 1:
        raise BundleError(f"there are answers of {len(names)} localizers, and none is {entrant.card.name}")
    return [dataclasses.replace(result, localizer=entrant.spec) for result in results]


def _run_part(
    board: Board, listed: BoardEnvironment, part: Part, wanted: Sequence[Entrant], settings: Settings, drawing: Drawing
) -> Outcome:
    if not listed.has_data:
        return Outcome(board.name, listed.env, part, why="its recorded data is not found, see `pdrbench data`")
    folder = settings.root / board.name
    known = newest(folder, (listed.env, part))
    number, now = settings.round.number, made_by(listed, part)
    if known is None or (known.round, known.made_by) != (number, now):
        drawn = drawing(listed, part)
        is_same = known is not None and (known.round, known.sha256) == (number, walks_sha256(drawn.index))
        if known is not None and is_same:  # whatever has changed of what draws them
            known = msgspec.structs.replace(known, made_by=now)
            write_walks(folder, known)
        else:
            known = None
    todo = [one for one in wanted if not _is_done(board, one, known, settings)]
    kept = tuple(one.card.name for one in wanted if one not in todo)
    if not todo:
        return Outcome(board.name, listed.env, part, kept=kept)
    drawn = drawing(listed, part)
    return _enter_all(board, drawn, todo, _play(drawn, todo, settings), settings, kept)


def _enter_all(
    board: Board,
    drawn: DrawnPart,
    todo: Sequence[Entrant],
    results: Sequence[Result],
    settings: Settings,
    kept: tuple[str, ...] = (),
    *,
    was_elsewhere: bool = False,
) -> Outcome:
    """Scores what was played, and writes entries."""
    folder = settings.root / board.name
    place = drawn.env, drawn.part
    known, now = newest(folder, place), part_walks(drawn, settings.round.number)
    scored = score_part(drawn, results, metric=board.metric, jobs=settings.jobs)
    played, declined = [], {} if known is None or known.sha256 != now.sha256 else dict(known.declined)
    refused: dict[str, str] = {}
    waiting: dict[str, str] = {}
    canaries = drawn.canaries
    for one in todo:
        of = [result for result in results if result.localizer == one.spec]
        if all(result.status == UNSUITABLE for result in of):
            declined[one.card.name] = one.sha256
            continue
        found = examine(canaries, of)
        if found.future and not one.is_registered:
            refused[one.card.name] = found.future
            continue
        shown = found.record
        if not one.is_registered:
            shown = judge(shown, _responses(folder, place))
            if was_elsewhere and not shown.held:
                shown = msgspec.structs.replace(shown, held=_unconfined(of))
            waiting |= {one.card.name: shown.held} if shown.held else {}
        parts = [scored[one.spec, division] for division in (ONLINE, OFFLINE) if (one.spec, division) in scored]
        first = next(result for result in of if result.status != UNSUITABLE)
        _enter(one, board.name, settings, part_record(now, parts, one.sha256, first.provenance, shown))
        played.append(one.card.name)
    now = msgspec.structs.replace(now, declined=declined)
    write_walks(folder, now)
    out = tuple(one.card.name for one in todo if one.card.name in declined)
    return Outcome(board.name, drawn.env, drawn.part, tuple(played), kept, out, refused, waiting)


def _unconfined(results: Sequence[Result]) -> str:
    """Why a person looks at what another machine has played: it says itself that it did not confine the localizer."""
    modes = {str(dict(result.provenance["isolation"]).get("mode")) for result in results}  # type: ignore[call-overload]
    if modes == {CONFINED_MODE}:
        return ""
    return f"it was played as {', '.join(sorted(modes))}, so that it could read walks to come: a person looks at it"


def _responses(folder: Path, place: tuple[str, Part]) -> list[float]:
    """How far answers of registered entries moved on crossed walks of a part, in their own paths."""
    found = []
    for entry in list_entries(folder.parent, folder.name):
        record, _ = read_entry(entry)
        if split_name(record.spec)[0] in localizers():
            shown = [of.canaries for of in record.parts if of.place == place and of.canaries is not None]
            found += [of.response for of in shown if of.response is not None]
    return found


def _enter(entrant: Entrant, board: str, settings: Settings, part: tuple[PartRecord, bytes]) -> None:
    """Adds a part to an entry, in place of what it had there, and signs it."""
    folder = settings.root / board / folder_name(entrant.card.name)
    parts = [part]
    if (folder / ENTRY_FILE).is_file() and is_ours(folder, settings):
        record, _ = read_entry(folder)
        content = read_answers(folder)
        ranking = {of.sha256 for drawn in all_walks(folder.parent).values() for of in drawn} - {part[0].walks_sha256}
        kept = [of for of in record.parts if of.place != part[0].place or of.walks_sha256 in ranking]
        if not entrant.is_registered:  # what other code has played is no part of this entry
            kept = [of for of in kept if of.localizer_sha256 == entrant.sha256]
        parts += [(of, answers_of(record, content, of)) for of in kept]
    spec, source = entrant.source
    write_entry(settings.root, board, spec, entrant.card, sorted(parts, key=lambda pair: pair[0].place))
    if source is not None:
        write_whole(folder / SOURCE_FILE, source)
    write_whole(_written(folder, settings), sha256_of(folder / ENTRY_FILE).encode())
    if settings.key is not None and not held(read_entry(folder)[0]):
        sign_entry(folder, settings.key)


def is_ours(folder: Path, settings: Settings) -> bool:
    """Whether an entry is signed, or was written here: a key never signs a part that a stranger's record holds."""
    if settings.key is None:
        return True
    if (folder / SIGNATURE_FILE).is_file():
        return is_verified(folder, read_entry(folder)[0])
    path = _written(folder, settings)
    return path.is_file() and path.read_text(encoding="ascii") == sha256_of(folder / ENTRY_FILE)


def _written(folder: Path, settings: Settings) -> Path:
    """Where the digest of an entry is kept that was written here."""
    return make_folder(settings.work / WRITTEN / folder.parent.name) / folder.name


def newest(folder: Path, place: tuple[str, Part]) -> PartWalks | None:
    """The walks of a part that were drawn last; None where there are none."""
    drawn = all_walks(folder).get(place)
    return drawn[-1] if drawn else None


def _is_done(board: Board, entrant: Entrant, known: PartWalks | None, settings: Settings) -> bool:
    """Whether the same code has played these walks, and was scored by the metric that ranks."""
    place = settings.root / board.name / folder_name(entrant.card.name)
    if known is None:
        return False
    if known.declined.get(entrant.card.name) == entrant.sha256:
        return True
    if not (place / ENTRY_FILE).is_file() or not is_ours(place, settings):
        return False
    record, _ = read_entry(place)
    mine = [of for of in record.parts if (of.place, of.walks_sha256) == ((known.env, known.part), known.sha256)]
    mine = [of for of in mine if all(kept_metrics(board.metric).keys() <= one.values.keys() for one in of.divisions)]
    return any((of.localizer_sha256, of.versions) == (entrant.sha256, versions()) for of in mine)


def _play(drawn: DrawnPart, todo: Sequence[Entrant], settings: Settings) -> tuple[Result, ...]:
    answers = make_folder(settings.work / ANSWERS / f"{drawn.env}-{drawn.part}")
    answers.chmod(0o700)  # good ones are nearly the truth
    by_isolation: dict[Isolation, list[str]] = {}
    for one in todo:
        by_isolation.setdefault(settings.isolation_of(one), []).append(one.spec)
    found: list[Result] = []
    with on_cluster(settings.scheduler):
        jobs = 1 if settings.scheduler else settings.jobs
        for isolation, specs in by_isolation.items():
            found += play(
                drawn.observations, specs, answers, jobs=jobs, isolation=isolation, progress=settings.progress
            )
    return tuple(found)
