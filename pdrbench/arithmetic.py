"""Sums in the same order on every processor, so that a network answers with the same bytes elsewhere.

Libraries of linear algebra take wider instructions where a processor has them, and then add up in another order. The
last digit of a float32 differs, and once in some fifty times an answer in tenths of millimetres.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from typing import Final

# Libraries start no threads of their own: processes that play walks are as many as there are cores.
THREADS: Final = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMBA_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    ),
    "1",
)


@functools.cache
def same_everywhere() -> Mapping[str, str]:
    """Variables that have PyTorch compute with instructions that every processor of some years has.

    Empty on processors of other kinds than x86-64 with AVX2. They count only if they are set before PyTorch computes.
    """
    from llvmlite.binding import get_host_cpu_features

    if not get_host_cpu_features().get("avx2", False):
        return {}
    return {"ATEN_CPU_CAPABILITY": "avx2", "ONEDNN_MAX_CPU_ISA": "AVX2", "MKL_CBWR": "COMPATIBLE"}


def compute_alike() -> None:
    """Sets them in this process, where the user has not set them."""
    for name, value in same_everywhere().items():
        os.environ.setdefault(name, value)


def child_variables() -> dict[str, str]:
    """Variables of processes that play walks: one thread each, and sums in the same order."""
    return {**THREADS, **same_everywhere()}
