"""The file that `pdrbench error-model` writes: errors of stride events as measured, and what they were measured on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import msgspec

from pdrbench.errors import ResultError
from pdrbench_sim.units.strides import StrideErrors

MEASURED: Final = Path(__file__).with_name("stride_errors.json")  # of the literal filter, on the registered data
FORMAT: Final = 1

Sigma = Annotated[float, msgspec.Meta(ge=0)] | None


class ErrorSizes(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The fields of `StrideErrors`, in metres and radians; None where no walk shows it."""

    length_bias: Annotated[float, msgspec.Meta(gt=-1)] | None
    length_sigma_m: Sigma
    height_sigma_m: Sigma
    drift_mean_rad: float | None
    drift_sigma_rad: Sigma
    turn_sigma_rad: Sigma
    heading_sigma_rad: Sigma
    length_offset_m: float | None = 0.0
    length_offset_sigma_m: Sigma = 0.0
    drift_tail: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.0
    coarse_fraction: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.0
    coarse_factor: Annotated[float, msgspec.Meta(ge=1)] = 1.0


class ErrorStatistic(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One measured number.

    Attributes:
        name: What was measured; lab/notebook/error-model.md has the formulas.
        unit: As in "deg".
        value: The number; None where no walk has it.
        low, high: 95 % interval over walks; None below five walks.
        num_walks, num_strides: What it was measured on.
        note_1: What note 1 of the sources states, or "".
    """

    name: str
    unit: str
    value: float | None
    low: float | None
    high: float | None
    num_walks: int
    num_strides: int
    note_1: str


class ErrorSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Walks of one environment.

    Attributes:
        env: Id.
        dataset: Name of the registered dataset.
        sha256: Digest of the walks, as `Task.sha256`.
        num_walks: Walks that were used.
        left_out: Why by id of each walk that was not.
    """

    env: str
    dataset: str
    sha256: str
    num_walks: int
    left_out: dict[str, str]


class ErrorFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file.

    Attributes:
        pdrbench: Version that measured.
        filter: Name of the filter.
        settings: Of the filter; None where a setting is off or infinite.
        sources: What was measured on.
        errors: What strides are drawn with.
        statistics: Everything that was measured.
    """

    format: int
    pdrbench: str
    filter: str
    settings: dict[str, object]
    sources: list[ErrorSource]
    errors: ErrorSizes
    statistics: list[ErrorStatistic]

    def encode(self) -> str:
        """As text: the same numbers make the same bytes."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2).decode() + "\n"


def read_error_file(path: Path | str = MEASURED) -> ErrorFile:
    """Reads and checks a file.

    Raises:
        ResultError: It cannot be read, or is no such file; names file, field and remedy.
    """
    remedy = "measure it again with `pdrbench error-model --out FILE`"
    try:
        file = msgspec.json.decode(Path(path).read_bytes(), type=ErrorFile)
    except OSError as error:
        raise ResultError(f"{path}: cannot be read: {error.strerror}; {remedy}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ResultError(f"{path}: not a file of stride errors: {error}; {remedy}") from error
    if file.format != FORMAT:
        raise ResultError(f"{path}: format {file.format}, expected {FORMAT}; {remedy}")
    return file


def read_errors(path: Path | str = MEASURED) -> StrideErrors:
    """The errors in a file; without a path those measured on the registered recordings.

    Raises:
        ResultError: It is no such file, or a size was not measured; names file, field and remedy.
    """
    sizes = msgspec.structs.asdict(read_error_file(path).errors)
    missing = [name for name, size in sizes.items() if size is None]
    if missing:
        raise ResultError(
            f"{path}: {', '.join(missing)} was not measured; "
            f"measure on every environment with `pdrbench error-model --out FILE`"
        )
    return StrideErrors(**sizes)
