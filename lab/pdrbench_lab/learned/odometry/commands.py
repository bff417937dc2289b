"""The part of `python -m pdrbench_lab.learned` for published architectures: `odometry`, `measure-odometry`, `pack`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pdrbench.errors import PdrbenchError
from pdrbench_lab.learned.threads import INSTALL

ARCHITECTURES: Final = ("ronin", "tlio")


def add_commands(commands: Any) -> None:
    """Adds them to the subparsers of `argparse`."""
    train = commands.add_parser("odometry", help="train RoNIN's or TLIO's network, or go on where it was stopped")
    train.add_argument("arch", choices=ARCHITECTURES)
    train.add_argument("--out", type=Path, required=True, help="folder of the run")
    train.add_argument("--windows", type=Path, help="folder of the windows, for several runs")
    train.add_argument(
        "--sets", type=Path, help="folder with RoNIN, RIDI, OxIOD or own walks; their train part is added"
    )
    train.add_argument("--only-sets", action="store_true", help="nothing else is learned from")
    train.add_argument("--init", type=Path, default=None, help="trained weights to begin with: a trunk")
    train.add_argument("--steps", type=int, help="batches in all")
    train.add_argument("--batch", type=int, help="windows at a time")
    train.add_argument("--rate", type=float, help="of learning, at its largest")
    train.add_argument("--dropout", type=float)
    train.add_argument("--warm-up", type=float, help="fraction of the steps with squared errors")
    train.add_argument("--people", type=int, help="simulated people who walk for it")
    train.add_argument("--leave-out", type=int, help="of so many recorded outings one is left out, 0 for none")
    train.add_argument("--minutes", type=float, help="after which the run ends at the latest, its rate at nothing")
    train.add_argument("--budget", type=float, help="minutes after which no step is begun; the same command goes on")
    train.add_argument("--device", default="cpu", help="cuda for a GPU")
    train.add_argument("--seed", type=int, default=0)
    train.add_argument("--threads", type=int, default=1)
    train.set_defaults(run=_train)
    measure = commands.add_parser("measure-odometry", help="distances and turns of localizers on walks of environments")
    measure.add_argument("localizer", nargs="+", help="ids, as ronin")
    measure.add_argument("--env", action="append", required=True, help="id of an environment")
    measure.add_argument("--split", choices=("train", "val"), default="val")
    measure.set_defaults(run=_measure)
    pack = commands.add_parser("pack", help="weights of `odometry` in 8 bits, as they come with the laboratory")
    pack.add_argument("weights", type=Path, help="model.safetensors of a run")
    pack.add_argument("out", type=Path)
    pack.set_defaults(run=_pack)


def _train(given: argparse.Namespace) -> None:
    try:
        from pdrbench_lab.learned.odometry.train import OdometryTrainParams, line, train
    except ModuleNotFoundError as error:
        raise PdrbenchError(f"{error.name} is missing; run `{INSTALL}`") from error
    asked = ("steps", "minutes", "batch", "rate", "dropout", "warm_up", "people", "leave_out")
    params = OdometryTrainParams(arch=given.arch, seed=given.seed, threads=given.threads)
    if given.sets is not None:
        params = replace(params, kinds=("sets",) if given.only_sets else (*params.kinds, "sets"))
    params = replace(
        params,
        init="" if given.init is None else str(given.init),
        **{name: getattr(given, name) for name in asked if getattr(given, name) is not None},
    )
    measured = train(
        given.out,
        params,
        windows_in=given.windows,
        sets=given.sets,
        budget_min=given.budget,
        device=given.device,
        say=lambda line: print(line, flush=True),  # noqa: T201
    )
    print(line(measured))  # noqa: T201


def _measure(given: argparse.Namespace) -> None:
    from pdrbench.registry import make_localizer, make_task
    from pdrbench_lab.learned.odometry.measure import distance_figures

    for env in given.env:
        task = make_task(env)
        for name in given.localizer:
            walks = [task.load(walk) for walk in task.split(given.split)]
            figures = distance_figures(make_localizer(name), walks)
            print(f"{env} {given.split}, {name}: {_line(figures)}")  # noqa: T201


def _pack(given: argparse.Namespace) -> None:
    from pdrbench_lab.learned.odometry.weights import restore, store

    print(f"{given.out}: sha256 {store(restore(given.weights), given.out, packed=True)}")  # noqa: T201


def _line(figures: dict[str, float]) -> str:
    return ", ".join(f"{key} {value:.3f}" for key, value in figures.items())
