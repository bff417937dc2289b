"""`pdrbench leaderboard run`, and `draw|play|score`: the three steps of it, on machines of their own."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from pdrbench.cli.options import Jobs, Scheduler
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.errors import PdrbenchError, plain_line
from pdrbench_leaderboard.submit_command import PackagesFolder, WeightsFolder, WheelsFolder

if TYPE_CHECKING:
    from pdrbench_leaderboard.run import Outcome

Boards = Annotated[list[str] | None, typer.Argument(metavar="[BOARD]...", show_default="all")]
RoundNumber = Annotated[
    int | None,
    typer.Option("--round", min=0, metavar="N", help="Held-out walks of which round.", show_default="the newest"),
]
SecretFile = Annotated[
    Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Secret of the round, where it is not published.")
]
NumWalks = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="At most N walks of each part, for a try.", show_default="all")
]
LOCALIZERS: Final = "Registered id, path/to/file.py:Class, path/to/folder or bundle.pdrz"
Localizer = Annotated[str, typer.Option(metavar="LOCALIZER", help=f"{LOCALIZERS}.")]
CardFile = Annotated[
    Path | None, typer.Option(metavar="FILE", dir_okay=False, help="card.toml of the localizer, where it brings none.")
]
KeyFile = Annotated[Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Private key that signs entries.")]
Root = Annotated[Path, typer.Option(metavar="DIR", help="Folder of <board>/<entry>/; with a boards.toml: its boards.")]
Work = Annotated[Path, typer.Option(metavar="DIR", file_okay=False, help="Folder of what is drawn.")]
KeptWork = Annotated[
    Path | None,
    typer.Option(metavar="DIR", file_okay=False, help="Keeps walks and answers.", show_default="in the cache"),
]
ROOT: Final = Path("leaderboards")
ISOLATION: Final[dict[str, Any]] = {
    "metavar": "KIND",
    "help": "What localizers run in.",
    "show_default": "process, confined where not registered",
}
HOW_TO_PLAY: Final = (
    "play it where it can be confined, or with --isolation process on a machine or in a container that holds nothing "
    "but observations"
)


def add_step_commands(app: typer.Typer) -> None:
    """Adds them to the commands of `leaderboard`."""
    for command in (run, draw, play, score):
        app.command(command.__name__)(command)


def run(
    board: Boards = None,
    localizer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LOCALIZER",
            help=f"{LOCALIZERS}; repeat for several.",
            show_default="every entry, and every localizer of pdrbench",
        ),
    ] = None,
    card: CardFile = None,
    round_number: RoundNumber = None,
    secret: SecretFile = None,
    part: Annotated[
        Literal["public", "held-out", "private"] | None,
        typer.Option(metavar="PART", help="Only these walks.", show_default="all that are here"),
    ] = None,
    walks: NumWalks = None,
    root: Root = ROOT,
    work: KeptWork = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    isolation: Annotated[Literal["process", "confined", "none"] | None, typer.Option(**ISOLATION)] = None,
    key: KeyFile = None,
    wheels: WheelsFolder = None,
    weights: WeightsFolder = None,
    packages: PackagesFolder = None,
    as_json: AsJson = False,
) -> None:
    """Play every entry on every board, public and held-out walks; what is done already is skipped."""
    with answer_only(as_json):
        from pdrbench_leaderboard.boards import PARTS, chosen_boards, find_round
        from pdrbench_leaderboard.folders import Supplies
        from pdrbench_leaderboard.run import Settings
        from pdrbench_leaderboard.run import run as run_boards

        of_round = find_round(round_number, root)
        settings = Settings(
            root=root,
            work=work or Settings.work_of(of_round),
            round=of_round,
            secret=secret,
            jobs=jobs,
            scheduler=scheduler,
            parts=PARTS if part is None else (part,),
            walks=walks,
            isolation=isolation,
            supplies=Supplies(wheels, weights, packages),
            key=key,
            progress=True,
        )
        found = _noted(run_boards(chosen_boards(board or (), root), localizer or (), settings, card=card))
    _tell(found, root, as_json=as_json)


def draw(
    work: Work,
    board: Boards = None,
    round_number: RoundNumber = None,
    secret: SecretFile = None,
    walks: NumWalks = None,
    root: Root = ROOT,
    jobs: Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """Write observations of walks for machines that play, and the truth apart from them."""
    with answer_only(as_json):
        from pdrbench_leaderboard.boards import chosen_boards, find_round
        from pdrbench_leaderboard.run import Settings, draw_all

        of_round = find_round(round_number, root)
        settings = Settings(root=root, work=work, round=of_round, secret=secret, jobs=jobs, walks=walks, progress=True)
        parts = [
            {"env": of.env, "part": of.part, "walks": len(of.walks), "canaries": len(of.canaries)}
            for of in draw_all(chosen_boards(board or (), root), settings)
        ]
    if as_json:
        print_json({"parts": parts})
    else:
        say(f"{work / 'observations'} goes to the machine that plays; {work / 'truth'} stays")


def play(
    observations: Annotated[Path, typer.Argument(metavar="OBSERVATIONS", file_okay=False, help="What was drawn.")],
    localizer: Localizer,
    out: Annotated[Path, typer.Option(metavar="DIR", file_okay=False, help="Folder for answers.")],
    isolation: Annotated[Literal["process", "confined"] | None, typer.Option(**ISOLATION)] = None,
    jobs: Jobs = 1,
    wheels: WheelsFolder = None,
    weights: WeightsFolder = None,
    packages: PackagesFolder = None,
    as_json: AsJson = False,
) -> None:
    """Play a localizer on drawn walks; no secret, no key and no truth is needed here."""
    with answer_only(as_json):
        from pdrbench.process.launch import CONFINED, PROCESS
        from pdrbench.registry import localizers
        from pdrbench.settings import split_name
        from pdrbench_leaderboard.boards import find_round
        from pdrbench_leaderboard.bundle import SUFFIX
        from pdrbench_leaderboard.confine.read_permissions import private_root
        from pdrbench_leaderboard.entrants import absolute
        from pdrbench_leaderboard.folders import Supplies
        from pdrbench_leaderboard.play import answers_folder, find_parts
        from pdrbench_leaderboard.play import play as play_part
        from pdrbench_leaderboard.run import Settings, unpacked

        settings = Settings(root=out, work=out, round=find_round(0), supplies=Supplies(wheels, weights, packages))
        spec = unpacked(localizer, settings).spec if localizer.endswith(SUFFIX) else absolute(localizer)
        is_registered = split_name(spec)[0] in localizers()
        kind = isolation or (PROCESS if is_registered else CONFINED)
        if kind != CONFINED and not is_registered:
            if private_root() is not None:
                raise PdrbenchError(f"{localizer} is not registered here: it is played confined beside private walks")
            note(
                f"NOT CONFINED: {localizer} can read files, walks to come among them, and connect; "
                f"nothing that it may not have should be on this machine, and its entry waits for a person"
            )
        rows = []
        for part in find_parts(observations):
            folder = answers_folder(out, part)
            folder.mkdir(parents=True, exist_ok=True)
            try:
                results = play_part(part, [spec], folder, jobs=jobs, isolation=kind, progress=True)
            except PdrbenchError as error:
                hint = f"; {HOW_TO_PLAY}" if kind == CONFINED else ""
                raise PdrbenchError(f"{error}{hint}") from None
            rows.append({"env": part.parent.name, "part": part.name, "walks": len({of.walk for of in results})})
    if as_json:
        print_json({"parts": rows})
    else:
        say(f"{out} goes back to the machine that scores")


def score(
    answers: Annotated[Path, typer.Argument(metavar="ANSWERS", file_okay=False, help="What was played.")],
    localizer: Localizer,
    work: Work,
    board: Annotated[list[str] | None, typer.Option(metavar="BOARD", show_default="all")] = None,
    card: CardFile = None,
    round_number: RoundNumber = None,
    root: Root = ROOT,
    key: KeyFile = None,
    jobs: Jobs = 1,
    wheels: WheelsFolder = None,
    weights: WeightsFolder = None,
    packages: PackagesFolder = None,
    as_json: AsJson = False,
) -> None:
    """Score answers that another machine has played, and write and sign the entry; nothing of it is run."""
    with answer_only(as_json):
        from pdrbench_leaderboard.boards import chosen_boards, find_round
        from pdrbench_leaderboard.folders import Supplies
        from pdrbench_leaderboard.run import Settings, score_all, unpacked

        supplies = Supplies(wheels, weights, packages)
        settings = Settings(
            root=root, work=work, round=find_round(round_number, root), jobs=jobs, key=key, supplies=supplies
        )
        entrant = unpacked(localizer, settings, card)
        found = _noted(score_all(chosen_boards(board or (), root), entrant, answers, settings))
        if not found:
            raise PdrbenchError(f"{answers} holds no answers to what was drawn in {work}")
    _tell(found, root, as_json=as_json)


def _noted(outcomes: Iterable[Outcome]) -> list[Outcome]:
    """What became of each part, a line for each as it comes."""
    found = []
    for outcome in outcomes:
        found.append(outcome)
        for said, of in (("REFUSED", outcome.refused), ("HELD", outcome.held)):
            for name, why in of.items():
                note(plain_line(f"{said}  {name}: {why}"))
        counts = f"{len(outcome.played)} played, {len(outcome.kept)} done before, {len(outcome.declined)} declined"
        note(f"{outcome.board}  {outcome.env}, {outcome.part}: {outcome.why or counts}")
    return found


def _tell(outcomes: list[Outcome], root: Path, *, as_json: bool) -> None:
    """Answers with what became of each part; exits with 1 where an entry was refused."""
    if as_json:
        print_json({"parts": [dataclasses.asdict(outcome) for outcome in outcomes]})
    else:
        say(f"{root} holds what came of it; `pdrbench leaderboard build --root {root}` makes tables and pages")
    if any(outcome.refused for outcome in outcomes):
        raise typer.Exit(1)
