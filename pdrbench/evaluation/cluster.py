"""Sweeps on a Dask cluster: joblib sends the walks there while the client lives."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from concurrent.futures import CancelledError
from typing import Any, Final

import joblib

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation.origin import package_sha256

CONNECT_S: Final = 10.0  # ours: a scheduler that lives answers in milliseconds
WORKER_S: Final = 60.0  # ours: workers are started with the scheduler, and a queue may take its time


class ClusterError(PdrbenchError):
    """A cluster cannot be reached, has no workers or workers with another pdrbench."""


@contextlib.contextmanager
def on_cluster(scheduler: str | None) -> Iterator[None]:
    """`evaluate` inside sends its walks to a Dask cluster.

    Its workers need the same pdrbench, the same plug-ins, and the folder of the results under the same path.

    Args:
        scheduler: Address, as in `tcp://10.0.0.1:8786`; None: everything stays here.

    Raises:
        ClusterError: It cannot be reached, has no workers, a worker has other sources, or the scheduler ends meanwhile.
    """
    if scheduler is None:
        yield
        return
    client = _connect(scheduler)
    try:
        _check_workers(client, scheduler)
        with joblib.parallel_config(backend="dask", client=client):
            yield
    except CancelledError as error:
        raise ClusterError(
            f"the scheduler at {scheduler} does not answer any more; start it and its workers, and run this "
            f"again: what is stored already is kept"
        ) from error
    finally:
        client.close()


def _connect(scheduler: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError("--scheduler needs Dask: pip install 'pdrbench[cluster]'") from None
    connect: Any = Client  # untyped
    try:
        return connect(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {scheduler!r} ({_one_line(error)}); start one with `dask scheduler`, "
            f"workers with `dask worker {scheduler}`"
        ) from None


def _check_workers(client: Any, scheduler: str) -> None:
    """Asks every worker for its sources; those of an older or other pdrbench would compute other results."""
    try:
        client.wait_for_workers(1, timeout=WORKER_S)
    except TimeoutError:
        raise ClusterError(f"{scheduler} has no workers; start some with `dask worker {scheduler}`") from None
    try:
        digests: dict[str, str] = client.run(package_sha256, "pdrbench")
    except (ImportError, AttributeError) as error:
        raise ClusterError(f"a worker of {scheduler} has no pdrbench like this one: {_one_line(error)}") from error
    other = [worker for worker, digest in digests.items() if digest != package_sha256("pdrbench")]
    if other:
        named = ", ".join(itertools.islice(other, 3))
        raise ClusterError(
            f"{len(other)} of {len(digests)} workers have other sources of pdrbench ({named}); "
            f"install this version there and restart them"
        )


def _one_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
