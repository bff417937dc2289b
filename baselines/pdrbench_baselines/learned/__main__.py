"""`python -m pdrbench_baselines.learned train --out DIR`."""

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
    train.add_argument("--people", type=int, default=300, help="who walk for the training")
    train.add_argument("--val-people", type=int, default=60, help="by whom the best epoch is chosen")
    train.add_argument("--epochs", type=int, default=14)
    train.add_argument("--budget", type=float, help="minutes after which no epoch is begun")
    train.add_argument("--seed", type=int, default=0)
    train.add_argument("--threads", type=int, default=1)
    given = parser.parse_args(arguments)
    try:
        _train(given)
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


if __name__ == "__main__":
    sys.exit(main())
