"""Measures one block: real values or the stored ones, synthetic values, and those that are wrong on purpose."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, Literal, TypeVar

import numpy as np

from pdrbench.datasets import is_available
from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench_sim.realism import load_block
from pdrbench_sim.realism.block import Block, Part, Values
from pdrbench_sim.realism.targets import NO_TARGET, PACKAGED, PART, Target, read_targets, reduce

Origin = Literal["recordings", "stored", "none"]
RECORDINGS: Final[Origin] = "recordings"
STORED: Final[Origin] = "stored"
NONE: Final[Origin] = "none"  # of a block that needs no real values, or of one that has none

Answer = TypeVar("Answer")


@dataclass(frozen=True, slots=True)
class RealSource:
    """Where real values are taken from.

    Attributes:
        part: Recordings that parameters were fitted on, or the rest.
        file: File of targets; None: the recordings.
        is_forced: False: recordings where every set of the block is available, else `file`.
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
        trace: Tracebacks of what was no error that a user can mend.
    """

    name: str
    origin: Origin = NONE
    real: Target | None = None
    synthetic: Values | None = None
    disturbed: Mapping[str, Values] = field(default_factory=dict)
    failures: Mapping[str, str] = field(default_factory=dict)
    trace: str = ""


class _Attempts:
    """Calls that may fail; what failed, and why."""

    def __init__(self) -> None:
        self.failures: dict[str, str] = {}
        self.traces: list[str] = []

    def __call__(self, what: str, call: Callable[[], Answer]) -> Answer | None:
        """What the call answers; None where it raised."""
        try:
            return call()
        except PdrbenchError as error:
            self.failures[what] = str(error)
        except Exception as error:  # noqa: BLE001  one broken block must not hide the others
            self.failures[what] = f"{type(error).__name__}: {error}"
            self.traces.append(traceback.format_exc())
        return None


def measure(name: str, source: RealSource, seed: int, count: int | None) -> MeasuredBlock:
    """Everything of one block; failures are kept.

    Args:
        name: Under which it is registered.
        source: Of the real values.
        seed: Of the synthetic ones.
        count: Synthetic walks (floors, ...); as the block says where None.
    """
    attempt = _Attempts()
    block = attempt("block", partial(load_block, name))
    if block is None:
        return MeasuredBlock(name, failures=attempt.failures, trace="\n".join(attempt.traces))
    many = block.count if count is None else count
    found = attempt("real", partial(real_values, name, block, source))
    synthetic = attempt("synthetic", partial(_made, block.synthetic, seed, many))
    disturbed = {}
    for key, control in block.controls.items():
        values = attempt(f"control {key}", partial(_made, control.synthetic, seed, many))
        if values is not None:
            disturbed[key] = values
    origin, real = (NONE, None) if found is None else found
    return MeasuredBlock(name, origin, real, synthetic, disturbed, attempt.failures, "\n".join(attempt.traces))


def real_values(name: str, block: Block, source: RealSource) -> tuple[Origin, Target]:
    """Real values of a block and where they come from.

    Raises:
        DatasetError: They are neither available nor stored.
    """
    if not block.datasets:
        return NONE, NO_TARGET
    if source.file is None or (not source.is_forced and all(is_available(dataset) for dataset in block.datasets)):
        return RECORDINGS, reduce(block, block.real(source.part))
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
    return STORED, stored


def _made(make: Callable[[int, int], Values], seed: int, count: int) -> Values:
    return {key: np.asarray(found, dtype=np.float64) for key, found in make(seed, count).items()}
