"""The engine of sweeps: batches of work on any `concurrent.futures` executor, whatever happens to its workers.

In this process, in processes of this machine (`spawn`, one BLAS thread each), or on a Dask cluster through its own
executor: the work and the seeds are the same, so the numbers are.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from multiprocessing import get_context, parent_process
from typing import Any, NamedTuple, Protocol

from whid.errors import WhidError

BATCH_S = 1.0  # seconds of work a batch: long against what handing it over costs, short against patience
AHEAD = 2  # batches a worker has waiting
CONNECT_S = 5  # until a scheduler must have answered
DEATHS = 3  # of workers over one and the same single task, before the task is given up


class Group(NamedTuple):
    """Tasks that share their argument: the repeats of one cell."""

    shared: Any
    tasks: tuple[Any, ...]


class Batch(NamedTuple):
    """A stretch of one group, and how many workers have died over it."""

    group: int
    tasks: tuple[Any, ...]
    deaths: int = 0


Work = Callable[[Any, Sequence[Any]], Sequence[Any]]  # (shared, tasks) → an outcome a task; must not raise
Done = tuple[int, Sequence[Any], Sequence[Any]]  # group, tasks, outcomes


class Lost(NamedTuple):
    """What stands for the outcome of a task over which worker after worker died."""

    reason: str


class Engine(Protocol):
    """Does the groups' work and yields what is finished, in any order."""

    def __call__(self, work: Work, groups: Sequence[Group]) -> Iterator[Done]:
        """Yield every batch of every group once."""


def here(work: Work, groups: Sequence[Group]) -> Iterator[Done]:
    """Do the work in this process.

    >>> [done for _, _, done in here(lambda shared, tasks: [shared + t for t in tasks], [Group(10, (1, 2))])]
    [[11], [12]]
    """
    size = _Size()
    queue = _Queue(groups)
    while queue:
        batch = queue.next(size.tasks)
        began = time.perf_counter()
        outcomes = work(groups[batch.group].shared, batch.tasks)
        size.took(len(batch.tasks), time.perf_counter() - began)
        yield batch.group, batch.tasks, outcomes


class Workers:
    """Do the work on executors, a new one from `make` whenever the last one broke.

    A worker that dies takes its batch with it, and in a process pool every other batch under way: all of them are done
    again, one at a time, so that the guilty one is known. A single task that kills `DEATHS` workers is `Lost`.
    Raises `WhidError("sweep-engine")` where an executor cannot be had.
    """

    def __init__(self, make: Callable[[], AbstractContextManager[Executor]], workers: int, *, renew: bool) -> None:
        self.make, self.workers, self.renew = make, workers, renew

    def __call__(self, work: Work, groups: Sequence[Group]) -> Iterator[Done]:
        """Yield batches as they are finished."""
        queue, size = _Queue(groups), _Size()
        while queue:
            with self.make() as executor:
                yield from self._until_broken(executor, work, groups, queue, size)
            if queue and not self.renew:
                raise WhidError("sweep-engine", "the executor broke, or its cluster is gone; what was finished is kept")

    def _until_broken(
        self, executor: Executor, work: Work, groups: Sequence[Group], queue: _Queue, size: _Size
    ) -> Iterator[Done]:
        running: dict[Future[Any], Batch] = {}
        broken = False
        try:
            while (queue or running) and not (broken and not running):
                most = 1 if queue.suspects else AHEAD * self.workers
                while not broken and queue and len(running) < most:
                    batch = queue.next(min(size.tasks, 1 + queue.left // most))  # smaller at the end: all end together
                    try:
                        running[executor.submit(_timed, work, groups[batch.group].shared, batch.tasks)] = batch
                    except RuntimeError:  # it broke between two looks
                        queue.again(batch)
                        broken = True
                for future in wait(running, return_when=FIRST_COMPLETED).done if running else ():
                    batch = running.pop(future)
                    try:
                        seconds, outcomes = future.result()
                    except (BrokenProcessPool, CancelledError):
                        broken = True
                        yield from queue.died(batch, "its process died")
                    except Exception as fault:  # Dask: KilledWorker, a lost connection
                        yield from queue.died(batch, f"{type(fault).__name__}: {fault}")
                    else:
                        size.took(len(batch.tasks), seconds)
                        yield batch.group, batch.tasks, outcomes
        finally:
            for future in running:
                future.cancel()


class _Queue:
    """Batches that wait: stretches of the groups in order, before them whatever has to be done again."""

    def __init__(self, groups: Sequence[Group]) -> None:
        self.rest = deque((number, group.tasks) for number, group in enumerate(groups) if group.tasks)
        self.suspects: deque[Batch] = deque()
        self.left = sum(len(group.tasks) for group in groups)  # that were never begun

    def __bool__(self) -> bool:
        return bool(self.rest or self.suspects)

    def next(self, most: int) -> Batch:
        """Return the next batch, of at most so many tasks."""
        if self.suspects:
            return self.suspects.popleft()
        number, tasks = self.rest.popleft()
        if len(tasks) > most:
            self.rest.appendleft((number, tasks[most:]))
        self.left -= len(tasks[:most])
        return Batch(number, tasks[:most])

    def again(self, batch: Batch) -> None:
        """Put a batch back that was never begun."""
        self.suspects.append(batch)

    def died(self, batch: Batch, reason: str) -> Iterator[Done]:
        """Put a batch back whose worker died, in single tasks the second time; yield what is given up."""
        deaths = batch.deaths + 1
        if len(batch.tasks) == 1 and deaths >= DEATHS:
            yield batch.group, batch.tasks, [Lost(f"given up after {deaths} tries: {reason}")]
        elif len(batch.tasks) > 1 and deaths > 1:
            self.suspects.extend(Batch(batch.group, (task,)) for task in batch.tasks)
        else:
            self.suspects.append(batch._replace(deaths=deaths))


class _Size:
    """How many tasks make a batch of `BATCH_S` seconds, learned from those before it."""

    def __init__(self) -> None:
        self.tasks = 1

    def took(self, tasks: int, seconds: float) -> None:
        fitting = max(1, int(BATCH_S * tasks / max(seconds, 1e-9)))
        self.tasks = min(fitting, 4 * self.tasks)


def _timed(work: Work, shared: Any, tasks: Sequence[Any]) -> tuple[float, Sequence[Any]]:
    began = time.perf_counter()
    outcomes = work(shared, tasks)
    return time.perf_counter() - began, outcomes


def processes(count: int) -> Workers:
    """Return an engine of so many processes."""
    return Workers(lambda: _Pool(count), count, renew=True)


def given(executor: Executor, workers: int = 2) -> Workers:
    """Return an engine of an executor that somebody else made, and will close."""
    return Workers(lambda: _Lent(executor), workers, renew=False)


def dask(address: str) -> Workers:
    """Return an engine of a Dask cluster's workers; raise `WhidError("sweep-engine")` where there is none."""
    try:
        from distributed import Client
    except ImportError:
        raise WhidError("sweep-engine", "Dask is not installed: pip install 'whid[cluster]'", address) from None
    try:
        client: Any = Client(address, timeout=CONNECT_S, set_as_default=False)
        workers = len(client.scheduler_info()["workers"])
    except (OSError, ValueError, TypeError) as fault:
        raise WhidError("sweep-engine", f"no scheduler answers: {fault}", address) from None
    return given(client.get_executor(pure=False), max(workers, 1))


class _Lent(AbstractContextManager[Executor]):
    def __init__(self, executor: Executor) -> None:
        self.executor = executor

    def __enter__(self) -> Executor:
        return self.executor

    def __exit__(self, *_: object) -> None:
        """Leave it open."""


class _Pool(AbstractContextManager[Executor]):
    """A pool of processes with one BLAS thread each: they inherit the environment before they import numpy."""

    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

    def __init__(self, count: int) -> None:
        self.count = count

    def __enter__(self) -> Executor:
        self.before = {name: os.environ.get(name) for name in self.names}
        os.environ.update(dict.fromkeys(self.names, "1"))
        self.pool = ProcessPoolExecutor(self.count, mp_context=get_context("spawn"), initializer=_loyal)
        return self.pool

    def __exit__(self, *_: object) -> None:
        self.pool.shutdown(cancel_futures=True)
        for name, value in self.before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def _loyal() -> None:
    """Leave Ctrl-C to the parent, and end when it ends, killed or not: a worker that waits for work would wait for ever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
