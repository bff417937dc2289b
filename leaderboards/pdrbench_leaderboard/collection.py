"""All leaderboards of a folder: read, scored, checked, verified, and their tables written."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.evaluation.store import write_whole
from pdrbench.registry import localizers
from pdrbench.settings import split_name
from pdrbench.task import commitment
from pdrbench_leaderboard import table
from pdrbench_leaderboard.checking import held_out_findings, rules
from pdrbench_leaderboard.entry import Entry, list_entries, read_entry, read_sent, write_entry
from pdrbench_leaderboard.pack import second_nonce
from pdrbench_leaderboard.plausibility import Finding
from pdrbench_leaderboard.ranking import Board, make_board
from pdrbench_leaderboard.signing import RevokedKeyError, check_listed
from pdrbench_leaderboard.suites import boards_of
from pdrbench_leaderboard.verify import Terms, Verified, verify_environment


def read_boards(
    root: Path, jobs: int = 1, advance: Callable[[str], None] = lambda _: None, kept: Path | None = None
) -> tuple[list[Board], dict[str, str]]:
    """Reads and scores every entry below a folder.

    Args:
        root: Holds `<env>/<localizer>/`.
        jobs: Processes that compute the scores.
        advance: Called with the name of each environment when it is scored.
        kept: Folder where scores are kept from one call to the next; None: nowhere.

    Returns:
        boards: By environment.
        absent: Why by environment, where its recorded data is not available and nothing could be scored.

    Raises:
        PdrbenchError: An entry is damaged or was made on another version of its environment; names it.
    """
    boards, absent = [], {}
    for env, folders in _by_environment(root):
        try:
            boards.append(make_board([read_entry(folder) for folder in folders], jobs, kept))
        except DatasetError as error:
            absent[env] = str(error)
        advance(env)
    return boards, absent


def write_tables(boards: Sequence[Board], root: Path) -> list[Path]:
    """Writes `TABLE.md` of each environment; every file."""
    written = []
    for board in boards:
        path = root / board.task.id / table.FILE_NAME
        write_whole(path, table.table(board).encode())
        written.append(path)
    return written


def check_boards(root: Path, jobs: int = 1) -> Iterator[Finding]:
    """Checks every entry and every table below a folder, one environment after the other.

    An entry passes where it can be read, its digests hold, it keeps the rules of its suite, and every score that
    the table of its environment shows of it comes out of its estimates. What needs recorded data that is not found
    passes, and says that it was not scored.

    Args:
        root: Holds `<env>/<localizer>/`.
        jobs: Processes that compute the scores.

    Raises:
    """
    for env, folders in _by_environment(root):
        entries: list[Entry] = []
        checks = [_check_entry(folder, entries) for folder in folders]
        yield from checks
        if all(check.passed for check in checks):
            yield _check_table(root / env / table.FILE_NAME, entries, jobs)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one entry of a folder."""

    number: int  # of this one, from 1
    of: int  # entries that there are
    name: str  # <env>/<localizer>
    found: Verified | None = None  # None where it was not run again
    why: str = ""  # why it was refused or left out; empty where it is verified
    is_left_out: bool = False  # True where it was not run again and nothing is wrong with it


def verify_boards(
    root: Path, secrets: Sequence[str], key: Path, envs: Collection[str], results: Path | None, jobs: int = 1
) -> Iterator[Outcome]:
    """Runs every entry below a folder again that is not verified in this round, and writes what was found, signed.

    Entries of one environment are run side by side. What is interrupted goes on where it was: with the walks in
    `results`, and with the entries that are not verified yet.

    Args:
        root: Holds `<env>/<localizer>/` and `keys.toml`.
        secrets: Behind held-out walks, those of every leaderboard whose entries are to be verified.
        key: Private key that signs.
        envs: Only these environments; all where empty.
        results: Folder that keeps every walk.
        jobs: Processes.

    Raises:
        OtherSecretError: A secret is of no suite in this round.
        UnknownKeyError: The key is not in `keys.toml`.
    """
    by_board = {board: secret for secret in secrets for board in boards_of(secret)}
    check_listed(key, root)
    groups = [(env, folders) for env, folders in _by_environment(root) if not envs or env in envs]
    total, number = sum(len(folders) for _, folders in groups), 0
    for _, folders in groups:
        waiting: list[Entry] = []
        for folder in folders:
            found = _to_verify(folder, by_board)
            if isinstance(found, Entry):
                waiting.append(found)
            else:
                number += 1
                yield Outcome(number, total, "/".join(folder.parts[-2:]), None, *found)
        while waiting:
            batch = {entry.manifest.spec: entry for entry in waiting if entry.suite == waiting[0].suite}
            waiting = [entry for entry in waiting if batch.get(entry.manifest.spec) is not entry]
            first = next(iter(batch.values()))
            secret = by_board[first.suite, first.env]
            nonce = second_nonce(results, first.env, commitment(secret))  # one for all, so that they run side by side
            terms = Terms(nonce=nonce, secrets=(secret,), results=results, key=key)
            for entry, verified, why in _verify_batch(batch, terms, jobs):
                number += 1
                if verified is not None and not verified.differences:
                    write_entry(root, verified.entry)
                yield Outcome(number, total, f"{entry.env}/{entry.localizer}", verified, why)


def _verify_batch(batch: Mapping[str, Entry], terms: Terms, jobs: int) -> list[tuple[Entry, Verified | None, str]]:
    """What came of each entry, and why it is refused; an error is that of all of them."""
    try:
        found = verify_environment(batch, terms, jobs=jobs, progress=True)
    except PdrbenchError as error:
        return [(entry, None, str(error)) for entry in batch.values()]
    return [(entry, found[spec], next(iter(found[spec].differences), "")) for spec, entry in batch.items()]


def _to_verify(folder: Path, secrets: Mapping[tuple[str, str], str]) -> Entry | tuple[str, bool]:
    """The entry in a folder where it is to be run again; else why not, and whether nothing is wrong with it."""
    try:
        try:
            entry = read_entry(folder)
        except RevokedKeyError:
            entry = read_sent(folder)  # it is to be verified anew
        broken = next((finding for finding in rules(entry) if not (finding.passed or finding.is_flag)), None)
    except DatasetError as error:
        return str(error), True
    except PdrbenchError as error:
        return str(error), False
    if broken is not None:
        return f"{broken.name}: {broken.why}", False
    if (entry.suite, entry.env) not in secrets:
        return f"no secret of {entry.suite} in {entry.env} was named", True
    found = entry.verification and entry.verification.held_out
    if found and found.round == commitment(secrets[entry.suite, entry.env]):
        return "verified already", True
    if split_name(entry.manifest.spec)[0] not in localizers():
        return "it is not registered here; verify the bundle that was sent, which holds its source", True
    return entry


def _check_entry(folder: Path, entries: list[Entry]) -> Finding:
    """Reads one entry, looks at its rules, and keeps it where all is well."""
    name = "/".join(folder.parts[-2:])
    try:
        entry = read_entry(folder)
        findings = [*rules(entry), *held_out_findings(entry, folder)]
    except DatasetError as error:
        return Finding(name, True, f"not scored: {error}")
    except PdrbenchError as error:
        return Finding(name, False, str(error))
    failed = {finding.name: finding for finding in findings if not finding.passed}
    broken = next((finding for finding in failed.values() if not finding.is_flag), None)
    if broken is not None:
        return Finding(name, False, f"{broken.name}: {broken.why}")
    entries.append(entry)
    return Finding(name, True)


def _check_table(path: Path, entries: Sequence[Entry], jobs: int) -> Finding:
    name = "/".join(path.parts[-2:])
    if not entries:
        return Finding(name, True, "not scored: the recorded data is not found")
    try:
        wanted = table.table(make_board(entries, jobs))
    except DatasetError as error:
        return Finding(name, True, f"not scored: {error}")
    except PdrbenchError as error:
        return Finding(name, False, str(error))
    try:
        found = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        found = ""
    if found == wanted:
        return Finding(name, True)
    row = _first_difference(found, wanted)
    return Finding(name, False, f"{row}; write it anew with `pdrbench leaderboard build`")


def _first_difference(found: str, wanted: str) -> str:
    """What is wrong with a table, in words that name the entry."""
    if not found:
        return "it is missing"
    lines = found.splitlines()
    for line in wanted.splitlines():
        if line not in lines:
            cells = line.split(" | ")
            who = cells[1] if line.startswith("| ") and len(cells) > 1 else "a note"
            return f"{who} is not what the estimates give: {line}"
    return "it has lines that no entry accounts for"


def _by_environment(root: Path) -> Iterator[tuple[str, list[Path]]]:
    """Folders of entries by environment, both in alphabetical order."""
    groups: dict[str, list[Path]] = {}
    for folder in list_entries(root):
        groups.setdefault(folder.parent.name, []).append(folder)
    yield from groups.items()
