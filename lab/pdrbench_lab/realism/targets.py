"""Real values in a file, so that synthetic recordings are judged where no recordings are available."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.datasets import dataset, verify
from pdrbench.datasets.catalogue import LICENCE
from pdrbench.errors import DatasetError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench_lab.realism.block import CLASSIFIER, CLUSTER, Block, Order, Part, Values
from pdrbench_lab.realism.two_samples import Sample

PACKAGED: Final = Path(__file__).with_name("targets.json")
COMMAND: Final = "pdrbench validate-sim --write-targets FILE"
FORMAT: Final = 1
PART: Final[Part] = "judge"  # nothing else is stored: the synthetic side was fitted on the other part
MAX_QUANTILES: Final = 200  # a quantile for each half per cent: moves a KS distance by at most 0.0025
DIGITS: Final = 4
SAME: Final = 2e-3  # relative: two values that round to neighbours in the fourth digit are the same


class DatasetSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where real values come from.

    Attributes:
        source_url: Repository or page of the set.
        commit: Of the repository.
        licence: Of the recordings.
        sha256: Of the registered hashes and names of every file of the set.
        num_files: Of the set.
    """

    source_url: str
    commit: str
    licence: str
    sha256: str
    num_files: int


class Stored(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """Real values of one statistic.

    Attributes:
        unit: As printed.
        per: Unit of replication.
        num: How many values there were.
        values: The values in rising order, or where there were more than `MAX_QUANTILES` that many quantiles; in
            the order of the competitors where the rule is `Order`. Four significant digits.
        clusters: To which cluster each of these values belongs; empty where each is one of its own. With clusters,
            values rise within each.
    """

    unit: str
    per: str
    num: int
    values: list[float]
    clusters: list[int] = []


class Target(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Real values of one block.

    Attributes:
        datasets: Names of the sets that they were measured on.
        statistics: By name.
        features: By name: the values of every walk in one order, for the classifier; None where a walk has none.
    """

    datasets: tuple[str, ...]
    statistics: dict[str, Stored]
    features: dict[str, list[float | None]]


class Targets(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A file of real values.

    Attributes:
        format: Version of this layout.
        made_by: The command that writes such a file.
        part: Recordings that nothing was fitted on.
        datasets: By name.
        blocks: By name.
    """

    format: int
    made_by: str
    part: Part
    datasets: dict[str, DatasetSource]
    blocks: dict[str, Target]


NO_TARGET: Final = Target(datasets=(), statistics={}, features={})
EMPTY: Final = Targets(format=FORMAT, made_by=COMMAND, part=PART, datasets={}, blocks={})


def reduce(block: Block, values: Values) -> Target:
    """Real values as they are stored; rows are judged on these with and without recordings, so that both agree.

    Args:
        block: The block that measured them.
        values: (n,) by statistic; NaN is left out.

    Raises:
        RecordingError: A value is infinite.
    """
    statistics = {}
    for statistic in (statistic for statistic in block.statistics if statistic.name in values):
        found = Sample.of(values[statistic.name], values.get(f"{statistic.name}{CLUSTER}"))
        if np.isinf(found.values).any():
            raise RecordingError(f"block {block.name!r}: a real value of {statistic.name!r} is infinite; leave it out")
        is_clustered = f"{statistic.name}{CLUSTER}" in values
        groups = found.by_cluster() if is_clustered else [found.values]
        kept = [found.values] if isinstance(statistic.rule, Order) else _quantiles(groups)
        statistics[statistic.name] = Stored(
            unit=statistic.unit,
            per=statistic.per,
            num=len(found),
            values=[_rounded(value) for group in kept for value in group],
            clusters=[number for number, group in enumerate(kept) for _ in group] if is_clustered else [],
        )
    features = {
        name: [_rounded(value) if np.isfinite(value) else None for value in values[name]]
        for name in (*block.features, f"{CLASSIFIER}{CLUSTER}")
        if name in values
    }
    return Target(datasets=block.datasets, statistics=statistics, features=features)


def _quantiles(groups: Sequence[FloatArray]) -> list[FloatArray]:
    """Rising values of each group (n_k,); together at most `MAX_QUANTILES`, of each group in proportion."""
    ends = np.cumsum([len(values) for values in groups])
    if ends[-1] <= MAX_QUANTILES:
        return [np.sort(values) for values in groups]
    counts = np.diff(np.rint(MAX_QUANTILES * ends / ends[-1]), prepend=0).astype(int).tolist()
    return [
        np.quantile(values, (np.arange(count) + 0.5) / max(count, 1), method="hazen")
        for values, count in zip(groups, counts, strict=True)
    ]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def source_of(name: str) -> DatasetSource:
    """The registered source of a dataset, once the files found are known to be the registered ones.

    Raises:
        DatasetError: A file is missing or differs.
    """
    wrong = [problem for problem in verify(name) if not problem.is_harmless]
    if wrong:
        raise DatasetError(
            f"{name} is not the registered set ({wrong[0].path}: {wrong[0].why}); targets are made of the registered "
            f"one: run `pdrbench data verify {name}` and replace what it names"
        )
    known = dataset(name)
    files = [file for file in known.files if file.is_required and file.role != LICENCE]
    lines = sorted(f"{file.content_sha256 or file.sha256}  {file.path}\n" for file in files)
    return DatasetSource(
        source_url=known.source_url,
        commit=known.commit,
        licence=known.licence,
        sha256=hashlib.sha256("".join(lines).encode()).hexdigest(),
        num_files=len(files),
    )


def read_targets(path: Path = PACKAGED) -> Targets:
    """Reads a file of real values.

    Raises:
        DatasetError: It cannot be read, or is no such file.
    """
    try:
        found = msgspec.json.decode(path.read_bytes(), type=Targets)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path}: {error}; write it anew with: {COMMAND}") from error
    if found.format != FORMAT:
        raise DatasetError(f"{path} has format {found.format}, this version reads {FORMAT}; write it anew: {COMMAND}")
    return found


def with_blocks(before: Targets, blocks: Mapping[str, Target], known: Iterable[str]) -> Targets:
    """Targets with blocks put in, in the order of `known`; what is no longer known is dropped."""
    merged = {**before.blocks, **blocks}
    kept = {name: merged[name] for name in known if name in merged}
    used = sorted({name for target in kept.values() for name in target.datasets})
    fresh = {name for target in blocks.values() for name in target.datasets}
    sources = {name: source_of(name) if name in fresh else before.datasets[name] for name in used}
    return msgspec.structs.replace(EMPTY, datasets=sources, blocks=kept)


def encode(targets: Targets) -> str:
    """JSON with a line for each dataset, statistic and feature, so that a change shows as the lines it concerns."""
    plain = msgspec.to_builtins(targets)
    datasets = _lines(plain["datasets"], "  ")
    blocks = []
    for name, target in plain["blocks"].items():
        parts = [f'   "datasets": {json.dumps(target["datasets"])}']
        parts += [f'   "{key}": {_lines(target[key], "    ")}' for key in ("statistics", "features")]
        blocks.append(f"  {json.dumps(name)}: {{\n" + ",\n".join(parts) + "\n  }")
    head = [f' "{key}": {json.dumps(plain[key])}' for key in ("format", "made_by", "part")]
    body = [f' "datasets": {datasets}', ' "blocks": {\n' + ",\n".join(blocks) + "\n }"]
    return "{\n" + ",\n".join(head + body) + "\n}\n"


def _lines(table: Mapping[str, Any], indent: str) -> str:
    rows = [f"{indent}{json.dumps(key)}: {json.dumps(value)}" for key, value in table.items()]
    return "{\n" + ",\n".join(rows) + f"\n{indent[:-1]}}}" if rows else "{}"


def differing(stored: Target, measured: Target) -> list[str]:
    """Names of statistics and features that are not the same in both, within the rounding."""
    ours, theirs = stored.statistics, measured.statistics
    differs = [
        name
        for name in ours | theirs
        if name not in ours
        or name not in theirs
        or (ours[name].num, ours[name].clusters) != (theirs[name].num, theirs[name].clusters)
        or not _same(ours[name].values, theirs[name].values)
    ]
    features = stored.features | measured.features
    return differs + [
        f"{name} by walk" for name in features if not _same(stored.features.get(name), measured.features.get(name))
    ]


def _same(ours: list[Any] | None, theirs: list[Any] | None) -> bool:
    if ours is None or theirs is None or len(ours) != len(theirs):
        return False
    one, other = np.array(ours, dtype=np.float64), np.array(theirs, dtype=np.float64)
    largest = np.nanmax(np.abs(one), initial=0.0)
    return bool(np.allclose(one, other, rtol=SAME, atol=SAME * float(largest), equal_nan=True))
