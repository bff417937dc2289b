"""`pdrbench leaderboard draw|play|score`: the three steps of `run`, on machines of their own."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Final, Literal

import typer

from pdrbench.cli.options import Jobs
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.errors import PdrbenchError, plain_line
from pdrbench_leaderboard.folder_command import PackagesFolder, WeightsFolder, WheelsFolder

Boards = Annotated[list[str] | None, typer.Argument(metavar="[BOARD]...", show_default="all")]
RoundNumber = Annotated[
    int | None, typer.Option("--round", min=0, metavar="N", help="Of which round.", show_default="the newest")
]
Localizer = Annotated[
    str, typer.Option(metavar="LOCALIZER", help="Registered id, path/to/file.py:Class, path/to/folder or bundle.pdrz.")
]
CardFile = Annotated[
    Path | None, typer.Option(metavar="FILE", dir_okay=False, help="card.toml, where the localizer brings none.")
]
HOW_TO_PLAY: Final = (
    "play it where it can be confined, or with --isolation process on a machine or in a container that holds nothing "
    "but observations"
)


def add_step_commands(app: typer.Typer) -> None:
    """Adds them to the commands of `leaderboard`."""
    app.command("draw")(draw)
    app.command("play")(play)
    app.command("score")(score)


def draw(
    work: Annotated[Path, typer.Option(metavar="DIR", file_okay=False, help="Folder for what is drawn.")],
    board: Boards = None,
    round_number: RoundNumber = None,
    secret: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Secret, where it is not published.")
    ] = None,
    walks: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="At most N walks of each part.", show_default="all")
    ] = None,
    jobs: Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """Write observations of walks for machines that play, and the truth apart from them."""
    with answer_only(as_json):
        from pdrbench_leaderboard.boards import chosen_boards, find_round
        from pdrbench_leaderboard.run import Settings, draw_all

        of_round = find_round(round_number)
        settings = Settings(root=work, work=work, round=of_round, secret=secret, jobs=jobs, walks=walks, progress=True)
        parts = [
            {"env": of.env, "part": of.part, "walks": len(of.walks), "canaries": len(of.canaries)}
            for of in draw_all(chosen_boards(board or ()), settings)
        ]
    if as_json:
        print_json({"parts": parts})
    else:
        say(f"{work / 'observations'} goes to the machine that plays; {work / 'truth'} stays")


def play(
    observations: Annotated[Path, typer.Argument(metavar="OBSERVATIONS", file_okay=False, help="What was drawn.")],
    localizer: Localizer,
    out: Annotated[Path, typer.Option(metavar="DIR", file_okay=False, help="Folder for answers.")],
    isolation: Annotated[
        Literal["process", "confined"] | None,
        typer.Option(metavar="KIND", help="What it runs in.", show_default="process, confined where not registered"),
    ] = None,
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
        from pdrbench_leaderboard.folders import Supplies
        from pdrbench_leaderboard.play import answers_folder, find_parts
        from pdrbench_leaderboard.play import play as play_part
        from pdrbench_leaderboard.run import Settings, absolute, unpacked

        settings = Settings(root=out, work=out, round=find_round(0), supplies=Supplies(wheels, weights, packages))
        spec = unpacked(localizer, settings).spec if localizer.endswith(SUFFIX) else absolute(localizer)
        is_registered = split_name(spec)[0] in localizers()
        kind = isolation or (PROCESS if is_registered else CONFINED)
        if kind != CONFINED and not is_registered:
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
    work: Annotated[Path, typer.Option(metavar="DIR", file_okay=False, help="Folder of what was drawn.")],
    board: Annotated[list[str] | None, typer.Option(metavar="BOARD", show_default="all")] = None,
    card: CardFile = None,
    round_number: RoundNumber = None,
    root: Annotated[Path, typer.Option(metavar="DIR", help="Folder that holds <board>/<entry>/.")] = Path(
        "leaderboards"
    ),
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Private key that signs the entry.")
    ] = None,
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
        settings = Settings(root=root, work=work, round=find_round(round_number), jobs=jobs, key=key, supplies=supplies)
        entrant = unpacked(localizer, settings, card)
        found = list(score_all(chosen_boards(board or ()), entrant, answers, settings))
        for outcome in found:
            for said, of in (("REFUSED", outcome.refused), ("HELD", outcome.held)):
                for name, why in of.items():
                    note(plain_line(f"{said}  {name}: {why}"))
        if not found:
            raise PdrbenchError(f"{answers} holds no answers to what was drawn in {work}")
    if as_json:
        print_json({"parts": [dataclasses.asdict(outcome) for outcome in found]})
    else:
        say(f"{root} holds what came of it; `pdrbench leaderboard build` makes tables and pages")
    if any(outcome.refused for outcome in found):
        raise typer.Exit(1)
