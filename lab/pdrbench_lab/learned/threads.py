"""PyTorch on one thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

INSTALL: Final = "pip install 'pdrbench[learned]'"


@contextmanager
def one_thread() -> Iterator[None]:
    """A window of 4 s takes less time than waking another thread; who else uses torch here finds it as it was."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
