"""`python -m pdrbench_baselines.learned train --out DIR`, and `measure`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pdrbench.errors import PdrbenchError
from pdrbench_baselines.learned.data import SOURCES


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m pdrbench_baselines.learned", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    train = commands.add_parser("train", help="train a network from scratch, or go on where it was stopped")
    train.add_argument("--out", type=Path, required=True, help="folder of the run")
    train.add_argument("--windows", type=Path, help="folder of the windows, where several runs share them")
    train.add_argument("--arch", choices=("resnet", "tcn"), default="resnet")
    train.add_argument("--width", type=int, default=32)
    train.add_argument("--data", default="people,office,mall", help=f"some of {','.join(SOURCES)}; mall needs ilc20")
    train.add_argument("--people", type=int, default=1000, help="who walk for the training")
    train.add_argument("--val-people", type=int, default=60, help="by whom the best epoch is chosen")
    train.add_argument("--epochs", type=int, default=10)
    train.add_argument("--budget", type=float, help="minutes after which no epoch is begun")
    train.add_argument("--seed", type=int, default=0)
    train.add_argument("--threads", type=int, default=1)
    train.set_defaults(run=_train)
    measure = commands.add_parser("measure", help="figures of a network on walks of environments that it never saw")
    measure.add_argument("--weights", default="", help="model.safetensors of a run; without it those of pdrbench")
    measure.add_argument("--split", choices=("val", "test"), default="val")
    measure.set_defaults(run=_measure)
    given = parser.parse_args(arguments)
    try:
        given.run(given)
    except PdrbenchError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _train(given: argparse.Namespace) -> None:
    try:
        from pdrbench_baselines.learned.train import TrainParams, train
    except ModuleNotFoundError as error:
        raise PdrbenchError(f"{error.name} is missing; run `pip install 'pdrbench[learned]'`") from error
    params = TrainParams(
        arch=given.arch,
        width=given.width,
        sources=tuple(given.data.split(",")),
        people=given.people,
        val_people=given.val_people,
        epochs=given.epochs,
        seed=given.seed,
        threads=given.threads,
    )
    best = train(
        given.out,
        params,
        windows_in=given.windows,
        budget_min=given.budget,
        say=lambda line: print(line, flush=True),  # noqa: T201
    )
    print(f"best: {best.line()}")  # noqa: T201


def _measure(given: argparse.Namespace) -> None:
    from pdrbench.registry import make_task
    from pdrbench_baselines.learned.localizer import load_network

    network = load_network(given.weights)
    from pdrbench_baselines.learned.walks import leg_errors_m, walk_figures

    office = make_task("OfficePhone-v0")
    figures = walk_figures(network, (office.load(walk) for walk in office.split(given.split)))
    told = ", ".join(f"{name} {value:.2f}" for name, value in figures.items())
    print(f"OfficePhone-v0 {given.split}: {told}")  # noqa: T201
    mall = make_task("MallPhone-v0")
    legs_m = leg_errors_m(network, (mall.load(walk) for walk in mall.split(given.split)))
    print(f"MallPhone-v0 {given.split}: {len(legs_m)} legs missed by {legs_m.mean():.3f} m in the mean")  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
