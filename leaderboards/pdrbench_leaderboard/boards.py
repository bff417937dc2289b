"""Boards: which environments an entry is played on, and the secrets behind their held-out walks.

They stand in a file `boards.toml`: ours in the package, those of a competition in its folder, which is then the root
of its entries as well.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from importlib.resources import files as package_files
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec

from pdrbench.datasets import is_available
from pdrbench.errors import BundleError, unknown_name
from pdrbench.metrics.table import METRICS
from pdrbench.registry import TASK_FILE, environments, make_task
from pdrbench.task import HELD_OUT, NOISE_M, Task, commitment
from pdrbench_leaderboard.confine.read_permissions import PRIVATE_VARIABLE, private_root
from pdrbench_leaderboard.rounds import round_secret
from pdrbench_leaderboard.schema import MAX_TEXT_BYTES, Line, Name, Record, Sha256, read_limited, read_toml

BOARDS_FILE: Final = "boards.toml"
OF_ANSWERS: Final = frozenset({"held", "answered", "resampled", "reference", "building"})  # of `metrics.score`
P75: Final = "p75_level_penalised_m"  # the metric that ranks, where a board names no other
Part = Literal["public", "held-out", "private"]
PARTS: Final[tuple[Part, ...]] = ("public", "held-out", "private")
PRIVATE: Final[Part] = "private"  # recordings whose truth nobody has but the host
MIN_REPLAYS: Final = 8  # fewer test walks are replayed twice each
Count = Annotated[int, msgspec.Meta(ge=1)]


def num_replays(num_walks: int) -> int:
    """How many replays there are of so many test walks.

    >>> num_replays(6), num_replays(23)
    (12, 23)
    """
    return num_walks if num_walks >= MIN_REPLAYS else 2 * num_walks


class BoardEnvironment(Record, frozen=True, kw_only=True):
    """What a board takes of one environment."""

    env: Name  # id, with its version
    walks: Count | None = None  # first so many of the public test split; None: all
    held_out_walks: Count | None = None  # likewise
    home: Path | None = None  # folder of the file of boards, where that is not ours

    @property
    def spec(self) -> str:
        """As `make_task` takes it: its id, or the task folder of that id beside the file of boards."""
        own = None if self.home is None else self.home / self.env
        return str(own) if own is not None and (own / TASK_FILE).is_file() else self.env

    @property
    def is_here(self) -> bool:
        """False for a task folder of a competition that stays with its hosts."""
        return self.spec != self.env or self.env in environments()

    @property
    def is_generated(self) -> bool:
        """Whether its walks are generated, so that a secret makes others; recorded ones are replayed."""
        return self.is_here and make_task(self.spec).held_out is not None

    @property
    def noise_m(self) -> float:
        """Error of its reference."""
        return make_task(self.spec).noise_m if self.is_here else NOISE_M

    @property
    def is_lost(self) -> bool:
        """Whether nothing says where its walks begin."""
        return self.is_here and make_task(self.spec).start == "unknown"

    @property
    def parts(self) -> tuple[Part, ...]:
        """Parts that can be played here: of recorded walks the replays, which count as held out, and no public ones."""
        can_play = {"public": self.is_generated, "held-out": True, PRIVATE: self.private is not None}
        return tuple(part for part in PARTS if can_play[part])

    @property
    def open_part(self) -> Part:
        """The part whose truth is public, whose results stand against those on private walks."""
        return "public" if self.is_generated else "held-out"

    @property
    def private(self) -> Path | None:
        """The task folder of private walks like these; None where this host has none."""
        root = private_root()
        return root / self.env if root is not None and (root / self.env / TASK_FILE).is_file() else None

    @property
    def ranked_walks(self) -> int:
        """How many walks of it rank."""
        if self.held_out_walks is not None:
            return self.held_out_walks
        return num_replays(len(make_task(self.spec).split("test")))

    def first(self, count: int | None) -> BoardEnvironment:
        """The same with at most so many walks of each part; None: all."""
        if count is None:
            return self
        fewer = {name: min(getattr(self, name) or count, count) for name in ("walks", "held_out_walks")}
        return msgspec.structs.replace(self, **fewer)

    @property
    def has_data(self) -> bool:
        """Whether the recorded data that it needs is found."""
        if not self.is_here:
            return False
        dataset = make_task(self.spec).dataset
        return dataset is None or is_available(dataset)

    def task(self, part: Part = "public", secret: str | None = None) -> Task:
        """The task that has the walks of a part; raises `BundleError` where private walks are not here."""
        if part != PRIVATE:
            return make_task(self.spec, secret)
        if self.private is None:
            raise BundleError(f"no private walks of {self.env}: {PRIVATE_VARIABLE} names the folder that has them")
        return make_task(str(self.private))

    def walks_of(self, part: Part, secret: str) -> tuple[str, ...]:
        """Ids of the walks of a part, in the order of their split; raises `BundleError` where there are fewer."""
        split, count = (HELD_OUT, self.held_out_walks) if part == "held-out" else ("test", self.walks)
        walks = self.task(part, secret).split(split)
        if count is not None and count > len(walks):
            raise BundleError(f"{self.spec} has {len(walks)} {part} walks, and the board asks for {count}")
        return walks[:count]


class Board(Record, frozen=True, kw_only=True):
    """Environments whose results rank together."""

    name: Name = ""
    title: Line
    summary: Line  # one sentence
    lost_m: Annotated[float, msgspec.Meta(gt=0)]  # a walk is lost where its third quartile is above it
    environments: tuple[BoardEnvironment, ...]
    metric: str = P75  # that ranks: of which less is better
    home: Path | None = None  # folder of its file, where that is not ours

    def environment(self, env: str) -> BoardEnvironment:
        """What the board takes of an environment; raises `UnknownNameError` where it takes nothing."""
        for listed in self.environments:
            if listed.env == env:
                return listed
        raise unknown_name(f"environment of the board {self.name}", env, [listed.env for listed in self.environments])

    @property
    def score_title(self) -> str:
        """What its scores are, as the head of a column says it."""
        return "off by, m" if self.metric == P75 else self.metric

    def round(self, number: int) -> Round:
        """A round of the file that has this board; raises `BundleError`."""
        return find_round(number, self.home)


class Round(Record, frozen=True, kw_only=True):
    """The held-out walks of some releases."""

    number: Annotated[int, msgspec.Meta(ge=0)]
    secret: str = ""  # once it is published
    commitment: Sha256 | None = None  # of the secret; needed until then

    @property
    def sha256(self) -> str:
        """What is published of the secret."""
        return commitment(self.secret) if self.secret else str(self.commitment)

    def secret_of(self, given: str | None) -> str:
        """The secret: the published one, or that which is given, or that which follows from a master secret.

        Raises:
            BundleError: None is given, or another.
        """
        if given is not None and commitment(given) != self.sha256:
            given = round_secret(given, self.number)
        if given is None and not self.secret:
            raise BundleError(f"the secret of round {self.number} is not published: name its file with --secret")
        if given is not None and commitment(given) != self.sha256:
            raise BundleError(f"this is not the secret of round {self.number}: its sha256 differs")
        return given or self.secret


class _File(Record, frozen=True):
    boards: dict[Name, Board]
    rounds: tuple[Round, ...]


def boards_file(root: Path | None = None) -> Path:
    """The file of boards of a root: its own, else ours."""
    own = None if root is None else root.absolute() / BOARDS_FILE
    return own if own is not None and own.is_file() else Path(str(package_files("pdrbench_leaderboard"))) / BOARDS_FILE


@functools.lru_cache(maxsize=16)
def _read(path: Path, mtime_ns: int) -> _File:
    found = read_toml(read_limited(path, MAX_TEXT_BYTES), _File, str(path))
    home = None if path == boards_file() else path.parent
    read = {}
    for name, board in found.boards.items():
        metric = METRICS[board.metric]
        if metric.better != "lower" or not set(metric.takes) <= OF_ANSWERS:
            raise BundleError(f"{path}: {metric.name} cannot rank on {name}: only one of answers, the less the better")
        environments = tuple(msgspec.structs.replace(listed, home=home) for listed in board.environments)
        read[name] = msgspec.structs.replace(board, name=name, home=home, environments=environments)
    if not read or not found.rounds:
        raise BundleError(f"{path} lists no board, or no round")
    return msgspec.structs.replace(found, boards=read)


def _file(root: Path | None) -> _File:
    path = boards_file(root)
    return _read(path, path.stat().st_mtime_ns)


def read_secret(path: Path) -> str:
    """The secret in a file; raises `BundleError`."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BundleError(f"cannot read the secret in {path}: {type(error).__name__}") from None


def boards(root: Path | None = None) -> Mapping[str, Board]:
    """Every board by name, in the order of the pages; raises `BundleError` where the file of boards is wrong."""
    return _file(root).boards


def ranked_walks(root: Path | None = None) -> Mapping[str, Mapping[str, int]]:
    """How many walks of each environment rank, by board."""
    return {name: {of.spec: of.ranked_walks for of in board.environments} for name, board in boards(root).items()}


def find_board(name: str, root: Path | None = None) -> Board:
    """The board of this name; raises `UnknownNameError`."""
    if name not in boards(root):
        raise unknown_name("board", name, boards(root))
    return boards(root)[name]


def chosen_boards(names: Sequence[str], root: Path | None = None) -> list[Board]:
    """Boards by name, each once; all where none is named."""
    return [find_board(name, root) for name in dict.fromkeys(names or boards(root))]


def rounds(root: Path | None = None) -> Mapping[int, Round]:
    """Every round by number."""
    return {of.number: of for of in _file(root).rounds}


def find_round(number: int | None = None, root: Path | None = None) -> Round:
    """A round by its number, the newest where there is none; raises `BundleError`."""
    known = rounds(root)
    number = max(known) if number is None else number
    if number not in known:
        raise BundleError(f"there is no round {number}; rounds: {', '.join(map(str, sorted(known)))}")
    return known[number]
