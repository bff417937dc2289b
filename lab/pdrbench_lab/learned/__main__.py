"""`python -m pdrbench_lab.learned`: networks are trained, measured and drawn.

`train`, `measure`, `public`, `speed` and `figures` are of the network of `learned`, `odometry`, `measure-odometry` and
`pack` of those of `ronin` and `tlio`, `zero-velocity` of that of `foot_ins_lstm`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench_lab.learned.data import SOURCES
from pdrbench_lab.learned.odometry.commands import add_commands
from pdrbench_lab.learned.threads import INSTALL

if TYPE_CHECKING:
    from pdrbench.recording import Recording
    from pdrbench_baselines.learned.reckoning import WindowNetwork
    from pdrbench_lab.learned.model import PhoneNetwork

MEASURED = {"campus": "CampusPhone-v1", "mall": "MallPhone-v2", "museum": "IpinPhone-v1"}


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m pdrbench_lab.learned", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    train = commands.add_parser("train", help="train the network from scratch")
    train.add_argument("--out", type=Path, required=True, help="folder of the run")
    train.add_argument("--windows", type=Path, help="folder of the windows, for several runs")
    train.add_argument("--data", help=f"some of {','.join(SOURCES)}; by default all with data here")
    train.add_argument("--left-out", default="", help="sources, and beginnings of names of walks, that teach nothing")
    train.add_argument("--recordings", type=Path, help="folder of your own recordings; adds the source `own`")
    train.add_argument("--people", type=int, help="simulated ones, who walk for the training")
    train.add_argument("--val-people", type=int, help="others, on whom progress is measured")
    train.add_argument("--steps", type=int, help="batches")
    train.add_argument("--seed", type=int, default=0)
    train.add_argument("--threads", type=int, default=2, help="of torch, and processes that gather windows")
    train.set_defaults(run=_train)
    measure = commands.add_parser("measure", help="figures of networks on walks of environments that they never saw")
    measure.add_argument(
        "--weights",
        action="append",
        help="model.safetensors of a run, by default the packaged one; give two to compare",
    )
    measure.add_argument("--split", choices=("train", "val", "test"), default="val")
    measure.add_argument("--only", choices=tuple(MEASURED), help="one of the environments")
    measure.add_argument("--shaking", type=float, default=1.0, help="multiplied by so much, steps and way as they are")
    measure.add_argument("--own-attitude", action="store_true", help="as if phones had no rotation vector")
    measure.add_argument("--mirrored", action="store_true", help="left for right, as in a mirrored building")
    measure.set_defaults(run=_measure)
    public = commands.add_parser("public", help="train and test on RoNIN, RIDI or OxIOD, people of the test left out")
    public.add_argument("folder", type=Path, help="with walks of these sets, and the lists that come with them")
    public.add_argument("--out", type=Path, help="folder of a run: trains before, with the other sources of train")
    public.add_argument("--data", help=f"these others, some of {','.join(SOURCES)}; by default as of train")
    public.add_argument("--people", type=int, help="simulated ones")
    public.add_argument("--steps", type=int, help="batches")
    public.add_argument("--weights", help="without --out: model.safetensors of a run")
    public.add_argument("--part", choices=("test", "seen", "val"), default="test")
    public.set_defaults(run=_public)
    speed = commands.add_parser("speed", help="time and memory of a network on one core, a window at a time")
    speed.add_argument("--weights", help="model.safetensors of a run, by default the packaged one")
    speed.add_argument("--compiled", action="store_true", help="in compiled code instead of PyTorch")
    speed.set_defaults(run=_speed)
    figures = commands.add_parser("figures", help="learning curves, calibration, errors by speed, carrying and person")
    figures.add_argument("--run", type=Path, action="append", required=True, dest="runs", help="folder of a run")
    figures.add_argument("--windows", type=Path, required=True, help="folder of the windows of the runs")
    figures.add_argument("--out", type=Path, required=True, help="gets the pictures, and learned.json with the numbers")
    figures.set_defaults(run=_figures)
    add_commands(commands)
    zero = commands.add_parser("zero-velocity", help="train the detector of a foot that rests, on motion capture")
    zero.add_argument("--out", type=Path, required=True, help="file of the weights")
    zero.add_argument("--samples", type=Path, help="folder of the samples, for several runs")
    zero.add_argument("--labels", choices=("speed", "authors"), default="authors", help="what says that the foot rests")
    zero.add_argument("--steps", type=int, default=400)
    zero.add_argument("--minutes", type=float, help="after which the run ends at the latest, its rate at nothing")
    zero.add_argument("--batch", type=int, default=32)
    zero.add_argument("--rate", type=float, default=1e-3)
    zero.add_argument("--seed", type=int, default=0)
    zero.add_argument("--device", default="cpu", help="cuda for a GPU")
    zero.set_defaults(run=_zero_velocity)
    given = parser.parse_args(arguments)
    try:
        given.run(given)
    except PdrbenchError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _train(given: argparse.Namespace, recordings: Path | None = None) -> None:
    """Of `train`, and of `public`, which has its own recordings and lacks some options."""
    try:
        from pdrbench_lab.learned.cnn import CnnParams, train_cnn, usual_sources
    except ModuleNotFoundError as error:
        raise PdrbenchError(f"{error.name} is missing; run `{INSTALL}`") from error
    recordings = recordings or getattr(given, "recordings", None)
    sources = usual_sources(given.data.split(",") if given.data else None, has_own=recordings is not None)
    asked = ("people", "val_people", "steps", "seed", "threads")
    chosen = {name: getattr(given, name, None) for name in asked}
    left_out = tuple(filter(None, getattr(given, "left_out", "").split(",")))
    params = CnnParams(sources, left_out=left_out, **{name: one for name, one in chosen.items() if one is not None})
    train_cnn(given.out, params, windows_in=getattr(given, "windows", None), recordings=recordings, say=_say)


def _say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


def _public(given: argparse.Namespace) -> None:
    from pdrbench_lab.learned.public_sets import load, public_walks
    from pdrbench_lab.learned.walks import walk_figures
    from pdrbench_lab.learned.weights import load_network

    walks = public_walks(given.folder)
    tested = [walk for walk in walks if walk.part == given.part]
    if not tested:
        parts = ", ".join(sorted({walk.part for walk in walks})) or "no walk at all"
        raise PdrbenchError(f"{given.folder}: no walk of part {given.part}; there is {parts}")
    weights = given.weights
    if given.out is not None:
        from pdrbench_lab.learned.cnn import MODEL

        _train(given, given.folder)
        weights = str(given.out / MODEL)
    network = load_network(weights)
    for form, carried in sorted({(walk.form, walk.carried) for walk in tested}):
        group = [walk for walk in tested if (walk.form, walk.carried) == (form, carried)]
        text = ", ".join(f"{key} {value:.2f}" for key, value in walk_figures(network, map(load, group)).items())
        print(f"{form} {given.part} {carried}: {len(group)} walks, {text}")  # noqa: T201


def _speed(given: argparse.Namespace) -> None:
    from pdrbench_baselines.learned.compiled import compiled_network
    from pdrbench_lab.learned.speed import measured
    from pdrbench_lab.learned.weights import load_network

    load: Callable[[str | None], WindowNetwork] = compiled_network if given.compiled else load_network
    print(measured(load(given.weights)).line())  # noqa: T201


def _measure(given: argparse.Namespace) -> None:
    from pdrbench_lab.learned.weights import load_network

    networks = {weights or "the packaged one": load_network(weights) for weights in given.weights or [None]}
    of_mall = {}
    for name, network in networks.items():
        print(f"{name}:")  # noqa: T201
        for env in [given.only] if given.only else MEASURED:
            if env == "mall" and given.split == "test":
                print("  play the test split of MallPhone with pdrbench compare")  # noqa: T201
            else:
                of_mall[name] = _measure_in(network, env, given)
    if len(of_mall) == 2 and given.only in (None, "mall"):
        one, other = of_mall.values()
        print(f"first / second: legs {one[0] / other[0]:.2f}, places {one[1] / other[1]:.2f}")  # noqa: T201


def _measure_in(network: PhoneNetwork, env: str, given: argparse.Namespace) -> FloatArray:
    """Prints the figures of one environment; of malls gives the mean errors of legs and of places."""
    from pdrbench.registry import make_task
    from pdrbench_lab.learned.walks import gentler, mirrored, place_errors_m, walk_figures, without_rotation

    task = make_task(MEASURED[env])
    walks = {walk: task.load(walk) for walk in task.split(given.split)}
    if given.mirrored:
        walks = {name: mirrored(walk) for name, walk in walks.items()}

    def changed(walk: Recording) -> Recording:
        walk = walk if given.shaking == 1.0 else gentler(walk, given.shaking)
        return without_rotation(walk) if given.own_attitude else walk

    group_of = {name: walk.mounting for name, walk in walks.items()}
    if env == "campus":
        group_of = {name: person for name, (_, person) in task.groups.items()}
    for group in sorted({group_of[name] for name in walks}):
        figures = walk_figures(network, [walk for name, walk in walks.items() if group_of[name] == group], changed)
        text = ", ".join(f"{key} {value:.2f}" for key, value in figures.items())
        print(f"  {task.id} {given.split}, {group}: {text}")  # noqa: T201
    if env != "mall":
        return np.zeros(2)
    legs_m, places_m = place_errors_m(network, map(changed, walks.values()))
    text = f"{len(legs_m)} legs missed by {legs_m.mean():.3f} m, places by {places_m.mean():.3f} m"
    print(f"  {task.id} {given.split}, start known: {text}")  # noqa: T201
    return np.array([legs_m.mean(), places_m.mean()])


def _zero_velocity(given: argparse.Namespace) -> None:
    import torch

    from pdrbench_lab.learned.zero_velocity_network import store
    from pdrbench_lab.learned.zero_velocity_train import samples_of, train

    torch.set_num_threads(1)
    network = train(
        samples_of(given.labels, given.samples),
        given.steps,
        given.batch,
        given.rate,
        given.seed,
        given.minutes,
        given.device,
        say=lambda line: print(line, flush=True),  # noqa: T201
    )
    print(store(network, given.out))  # noqa: T201


def _figures(given: argparse.Namespace) -> None:
    from pdrbench_lab.learned.figures import draw, numbers

    measured = numbers(given.runs, given.windows)
    for path in draw(measured, given.out):
        print(path)  # noqa: T201
    (given.out / "learned.json").write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
