"""`pdrbench evaal play|serve`."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np
import typer

from pdrbench.cli.options import LOCALIZER_HELP, Isolation, Split, Walks, make_folder, write_text
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.cli.ready import check_localizer_exists, ready_environment
from pdrbench.errors import PdrbenchError, UnknownNameError

if TYPE_CHECKING:
    from pdrbench.episode import Player
    from pdrbench.localizer import Briefing
    from pdrbench.result import Result
    from pdrbench.task import Task
    from pdrbench_evaal.client import TrialState
    from pdrbench_evaal.places import PlaceFormat
    from pdrbench_evaal.trial import Trial

app = typer.Typer(no_args_is_help=True, help="Play trials of an EvAAL server, or serve an environment as one.")

NUM_STEPS: Final = 200_000  # of a trial, whose length a client does not know; limits the processor time
PERIOD_S: Final = 0.5  # which the protocol recommends

Positions = Annotated[
    str, typer.Option(metavar="FORMAT", help="How positions are written: x,y,level or lon,lat,level, in any order.")
]
Origin = Annotated[
    str | None,
    typer.Option(metavar="LAT,LON", help="Place of the building's origin, x east and y north.", show_default="none"),
]


@app.command("play")
def play(
    url: Annotated[str, typer.Argument(metavar="URL", help="Server, as in http://127.0.0.1:5000/evaalapi/.")],
    trial: Annotated[str, typer.Argument(metavar="TRIAL", help="Name of the trial.")],
    localizer: Annotated[str, typer.Argument(metavar="LOCALIZER", help=LOCALIZER_HELP)],
    env: Annotated[
        str | None,
        typer.Option(
            metavar="ENV", help="Environment whose map and survey the localizer is given.", show_default="none"
        ),
    ] = None,
    walk: Annotated[
        str | None,
        typer.Option(metavar="WALK", help="Its walk whose briefing is given.", show_default="TRIAL, else the first"),
    ] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Map that the localizer is given.", show_default="none")
    ] = None,
    heading_deg: Annotated[
        float | None,
        typer.Option("--heading", metavar="DEG", help="Heading at the start, from x to y.", show_default="unknown"),
    ] = None,
    positions: Annotated[
        str | None,
        typer.Option(
            metavar="FORMAT",
            help="How the server writes positions: x,y,level or lon,lat,level, in any order.",
            show_default="x,y,level of a server of pdrbench",
        ),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON",
            help="Place of the building's origin, x east and y north.",
            show_default="the start, where no map is given",
        ),
    ] = None,
    mounting: Annotated[
        str,
        typer.Option(metavar="WHERE", help="Where it is carried: hand, pocket, foot.", show_default="as --env says"),
    ] = "",
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of the localizer's randomness.")] = 0,
    reload: Annotated[bool, typer.Option("--reload", help="Put a testing trial to its start first.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Write the server's list of estimates here.")
    ] = None,
    isolation: Isolation = "process",
    as_json: AsJson = False,
) -> None:
    """Play one trial of a server with a localizer; exit 1 where it timed out."""
    from pdrbench.evaluation.randomness import generator
    from pdrbench.registry import make_task
    from pdrbench_evaal.client import TrialClient, play_trial

    with answer_only(as_json):
        check_localizer_exists(localizer, isolation)
        task = None if env is None else make_task(env)
        client = TrialClient(url, trial)
        state = client.reload() if reload else client.state()
        if positions is None and not client.is_pdrbench:
            raise typer.BadParameter(
                f"say how this server writes positions, such as its {state.place!r}: --positions x,y,level or "
                f"--positions lon,lat,level"
            )
        start = state.place if env is None and map_file is None else ""
        places = _place_format(positions or "x,y,level", origin, start)
        briefed = _walk_of(task, trial, walk)
        briefing = _briefing(task, briefed, state, places, map_file, heading_deg, is_this_walk=briefed in (trial, walk))
        briefing = dataclasses.replace(briefing, mounting=mounting or briefing.mounting)
        rng = np.random.default_rng(seed) if task is None else generator(seed, task, briefed)
        with _running(localizer, isolation, briefing.period_s) as player:
            capacity = None if task is None else task.capacity
            played = play_trial(client, player, briefing, rng, places=places, capacity=capacity)
    if out is not None:
        write_text(out, played.estimates)
    in_time = played.state.rem_s >= 0
    if as_json:
        print_json(dataclasses.asdict(played) | {"trial": trial, "localizer": localizer, "in_time": in_time})
    else:
        say(f"{trial}: {played.num_estimates} positions sent, {'finished' if in_time else 'TIMED OUT'}")
    for what, count in played.skipped.items():
        note(f"{count} lines were not given to the localizer: {what}")
    if not in_time:
        raise typer.Exit(1)


def _place_format(positions: str, origin: str | None, start: str = "") -> PlaceFormat:
    """The format; in degrees and without an origin, that is the start, where a position there is given."""
    from pdrbench.io.geo import GeoFrame
    from pdrbench_evaal.places import PlaceFormat, frame_at_place

    names = tuple(positions.split(","))
    if origin is None:
        return PlaceFormat(names, frame_at_place(names, start) if start and "lat" in names else None)
    try:
        lat_deg, lon_deg = map(float, origin.split(","))
    except ValueError:
        raise typer.BadParameter(f"--origin is LAT,LON in degrees, as 49.46,11.11; got {origin!r}") from None
    return PlaceFormat(names, GeoFrame(lat_deg, lon_deg))


def _walk_of(task: Task | None, trial: str, walk: str | None) -> str:
    """The walk of an environment whose briefing stands for that of a trial."""
    if task is None:
        if walk is not None:
            raise typer.BadParameter("--walk goes with --env")
        return ""
    known = [name for split in task.walks.values() for name in split]
    if walk is not None and walk not in known:
        raise UnknownNameError(f"{task.id} has no walk {walk!r}; without --walk its first is taken")
    return walk or (trial if trial in known else known[0])


def _briefing(
    task: Task | None,
    walk: str,
    state: TrialState,
    places: PlaceFormat,
    map_file: Path | None,
    heading_deg: float | None,
    *,
    is_this_walk: bool,
) -> Briefing:
    """What the localizer is given; the start is that of the server where the walk of the environment is another one."""
    from pdrbench.building import Building
    from pdrbench.localizer import Briefing
    from pdrbench.sensors import BUILTIN, sensor_spec
    from pdrbench.trajectory import Start
    from pdrbench_formats.detect import read

    xy_m, level = places.read(state.place)
    start = Start(xy_m, level, None if heading_deg is None else float(np.radians(heading_deg)))
    if task is not None:
        briefing = task.brief(task.load(walk))
        if not is_this_walk:
            briefing = dataclasses.replace(briefing, start=start)
    else:
        briefing = Briefing(None, {name: sensor_spec(name) for name in BUILTIN}, PERIOD_S, start)
    if map_file is None:
        return briefing
    building = read(map_file)
    if not isinstance(building, Building):
        raise PdrbenchError(f"{map_file} is no map")
    return dataclasses.replace(briefing, building=building)


@contextlib.contextmanager
def _running(localizer: str, isolation: Any, period_s: float) -> Iterator[Player]:
    """The localizer, in a process of its own where that is wanted."""
    from pdrbench.evaluation.origin import localizer_target
    from pdrbench.process.budget import Budget
    from pdrbench.process.localizer_process import LocalizerProcess, Terms
    from pdrbench.registry import make_localizer

    if isolation == "none":
        yield make_localizer(localizer)
        return
    terms = Terms(isolation, Budget(), period_s, NUM_STEPS)
    isolated = LocalizerProcess(localizer, localizer_target(localizer), parameters={}, terms=terms)
    try:
        isolated.start()
        yield isolated
        isolated.finish()
    finally:
        isolated.close()


@app.command("serve")
def serve(
    env: Annotated[str, typer.Argument(metavar="ENV", help="Registered environment, or a task.toml.")],
    split: Split = None,
    walks: Walks = None,
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="PORT", help="0 for any that is free.")] = 5000,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Who can reach it: by default this machine.")
    ] = "127.0.0.1",
    slowdown: Annotated[float, typer.Option(min=1.0, metavar="V", help="Wall time for a second of a walk.")] = 2.0,
    slack_s: Annotated[float, typer.Option("--slack", min=0.0, metavar="S", help="Wall time beyond it.")] = 60.0,
    offline: Annotated[bool, typer.Option("--offline", help="Exchange data and estimates at once.")] = False,
    positions: Positions = "x,y,level",
    origin: Origin = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", file_okay=False, help="Store every trial that has ended here.")
    ] = None,
) -> None:
    """Serve the walks of an environment to clients of the EvAAL API, until Ctrl-C.

    A trial has the name of its walk. Those of the test split are scoring trials, which are played once.
    """
    from pdrbench.registry import make_task
    from pdrbench_evaal.server import TrialServer, make_trials, store_result
    from pdrbench_evaal.trial import Rules

    named = ready_environment(env, split)
    task = make_task(named)
    folder = None if out is None else make_folder(out)

    def report(trial: Trial, result: Result) -> None:
        from pdrbench.evaluation import score

        try:
            scores = score(result)
            chosen = ", ".join(f"{name} {scores[name]:.2f}" for name in ("p75_level_penalised_m", "mean_m"))
        except PdrbenchError as error:
            chosen = str(error)
        note(f"{trial.name}: {trial.state}, {len(result.estimates)} positions; {chosen}")
        if folder is not None:
            store_result(result, folder)

    rules = Rules(slowdown, slack_s, is_offline=offline)
    places, file = _place_format(positions, origin), "" if named == task.id else named
    trials = make_trials(task, split or "test", walks=walks, rules=rules, places=places, on_end=report, place=file)
    task.load(next(iter(trials)))  # generating the first walk may take longer than a client waits for an answer
    with TrialServer(trials, host=host, port=port) as server:
        note(f"{len(trials)} trials of {task.id} at {server.url}")
        for name in trials:
            say(name)
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()
