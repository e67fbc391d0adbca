"""Work spread over processes by Dask: a cluster of this machine's own, or one whose scheduler is named.

A task gets bytes and gives back plain data, so workers need no common disk. A worker that dies loses nothing: its tasks run again elsewhere."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from wineglass.blind.extra import need
from wineglass.errors import BadInput

Key = TypeVar("Key")

ATTEMPTS = 5  # workers that one task may see die
AHEAD = 4  # tasks on their way per worker: recordings are not all held in memory at once
CONNECT_S = 20


@dataclass(frozen=True)
class Spread:
    """scheduler: address of a running one; empty: `jobs` processes of this machine, 0: this very process."""

    jobs: int = 2
    scheduler: str = ""


def results(function: Callable[..., Any], tasks: Sequence[tuple[Key, Callable[[], tuple]]], spread: Spread) -> Iterator[tuple[Key, Any]]:
    """(key, function(*arguments())) of every task as it ends. arguments: called when the task's turn comes. Exceptions come out of here."""
    if spread.jobs == 0 and not spread.scheduler:
        for key, arguments in tasks:
            yield key, function(*arguments())
        return
    with _client(spread) as client:
        yield from _flow(client, function, tasks)


def _flow(client: Any, function: Callable[..., Any], tasks: Sequence[tuple[Key, Callable[[], tuple]]]) -> Iterator[tuple[Key, Any]]:
    """A few tasks per worker at a time."""
    distributed = need("distributed")
    waiting, keys = iter(tasks), {}
    running = distributed.as_completed()

    def more() -> None:
        while len(keys) < AHEAD * max(1, len(client.scheduler_info(n_workers=-1)["workers"])):
            task = next(waiting, None)
            if task is None:
                return
            key, arguments = task
            future = client.submit(function, *arguments(), pure=False)
            keys[future.key] = key
            running.add(future)

    more()
    while keys:
        future = next(running)
        key = keys.pop(future.key)
        yield key, future.result()
        more()


@contextmanager
def _client(spread: Spread) -> Iterator[Any]:
    """A connected client; a cluster of one's own ends with it."""
    dask, distributed = need("dask"), need("distributed")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    dask.config.set({"distributed.scheduler.allowed-failures": ATTEMPTS, "distributed.comm.timeouts.connect": f"{CONNECT_S}s",
                     "logging.distributed": "error"})
    if spread.scheduler:
        try:
            client = distributed.Client(spread.scheduler, timeout=CONNECT_S)
        except (OSError, ValueError, TimeoutError):
            raise BadInput("no scheduler answers", spread.scheduler, "start one with `dask scheduler`, or leave --scheduler away") from None
        with client:
            yield client
        return
    with distributed.LocalCluster(n_workers=spread.jobs, threads_per_worker=1, processes=True, dashboard_address=":0",
                                  silence_logs=logging.CRITICAL) as cluster, \
            distributed.Client(cluster) as client:
        yield client
