"""`woodman2008` with its particles on a GPU."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing
from pdrbench_baselines.woodman2008.localizer import Woodman2008

REMEDY: Final = (
    "install pdrbench-lab[gpu] where there is an NVIDIA GPU, and run without --confined, since a confined process sees "
    "no devices; woodman2008 is the same filter on a processor"
)


def why_no_gpu() -> str:
    """Why kernels cannot run on a GPU here; empty where they can."""
    try:
        from numba import cuda as cuda_of_numba
    except ImportError as error:
        return f"Numba has no CUDA target here ({error}): {REMEDY}"
    cuda: Any = cuda_of_numba
    return "" if cuda.is_available() else f"Numba finds no CUDA device here: {REMEDY}"


class Woodman2008Gpu(Woodman2008):
    """The particle filter of Woodman & Harle (2008) on a GPU, for clouds of millions of particles.

    The same random numbers, batches and answers as `woodman2008` but for rounding, and for the order of particles
    where they are many. Declines every walk where no CUDA device is found.

    Args:
        params: See `Woodman2008Params`.
    """

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        if reason := why_no_gpu():
            raise UnsuitableError(reason)
        super().reset(briefing, rng)

    def _filter_type(self) -> Callable[..., Any]:
        from pdrbench_lab.papers.woodman2008.gpu_filter import GpuFilter  # which CUDA is needed for

        return GpuFilter
