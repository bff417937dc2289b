"""Measures one block: real values or the stored ones, synthetic values, and those that are wrong on purpose."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from pdrbench.datasets import is_available
from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench_lab.realism import load_block
from pdrbench_lab.realism.block import Block, Part, Values
from pdrbench_lab.realism.targets import NO_TARGET, PACKAGED, PART, Target, read_targets, reduce

Origin = Literal["recordings", "stored", "none"]  # "none": of a block that needs no real values, or that has none
Answer = TypeVar("Answer")


@dataclass(frozen=True, slots=True)
class RealSource:
    """Where real values are taken from.

    Attributes:
        part: Recordings that parameters were fitted on, or the rest.
        file: Stored values; None for recordings only.
        is_forced: True for the file in any case, False for recordings where every set of the block is available.
    """

    part: Part = PART
    file: Path | None = PACKAGED
    is_forced: bool = False


@dataclass(frozen=True, slots=True)
class MeasuredBlock:
    """What was measured of one block.

    Attributes:
        name: Under which the block is registered.
        origin: Where the real values come from.
        real: Real values.
        synthetic: Synthetic values; None where they could not be made.
        disturbed: Synthetic values that are wrong on purpose, by control.
        failures: Why there is none, by "block", "real", "synthetic" or "control NAME".
        trace: Tracebacks of errors that a user cannot mend.
    """

    name: str
    origin: Origin = "none"
    real: Target | None = None
    synthetic: Values | None = None
    disturbed: Mapping[str, Values] = field(default_factory=dict)
    failures: Mapping[str, str] = field(default_factory=dict)
    trace: str = ""


def measure(name: str, source: RealSource, seed: int, count: int | None) -> MeasuredBlock:
    """Everything of one block; failures are kept.

    Args:
        name: Under which it is registered.
        source: Of the real values.
        seed: Of the synthetic ones.
        count: Synthetic walks (floors, ...); as the block says where None.
    """
    failures: dict[str, str] = {}
    traces: list[str] = []

    def attempt(what: str, call: Callable[..., Answer], *arguments: object) -> Answer | None:
        try:
            return call(*arguments)
        except PdrbenchError as error:
            failures[what] = str(error)
        except Exception as error:  # noqa: BLE001  one broken block must not hide the others
            failures[what] = f"{type(error).__name__}: {error}"
            traces.append(traceback.format_exc())
        return None

    block = attempt("block", load_block, name)
    if block is None:
        return MeasuredBlock(name, failures=failures, trace="\n".join(traces))
    many = block.count if count is None else count
    origin, real = attempt("real", real_values, name, block, source) or ("none", None)
    synthetic = attempt("synthetic", _made, block.synthetic, seed, many)
    made = {key: attempt(f"control {key}", _made, block.controls[key].synthetic, seed, many) for key in block.controls}
    disturbed = {key: values for key, values in made.items() if values is not None}
    return MeasuredBlock(name, origin, real, synthetic, disturbed, failures, "\n".join(traces))


def real_values(name: str, block: Block, source: RealSource) -> tuple[Origin, Target]:
    """Real values of a block and where they come from.

    Raises:
        DatasetError: They are neither available nor stored.
    """
    if not block.datasets:
        return "none", NO_TARGET
    if source.file is None or (not source.is_forced and all(is_available(dataset) for dataset in block.datasets)):
        return "recordings", reduce(block, block.real(source.part))
    sets = ", ".join(block.datasets)
    if source.part != PART:
        raise DatasetError(
            f"needs recordings ({sets}): values of the part {source.part!r} are not stored; set PDRBENCH_DATA"
        )
    stored = read_targets(source.file).blocks.get(name)
    if stored is None:
        raise DatasetError(
            f"{source.file.name} has no block {name!r}; set PDRBENCH_DATA to the folder that holds {sets}"
        )
    return "stored", stored


def _made(make: Callable[[int, int], Values], seed: int, count: int) -> Values:
    return {key: np.asarray(found, dtype=np.float64) for key, found in make(seed, count).items()}
