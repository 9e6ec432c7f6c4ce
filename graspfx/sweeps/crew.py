"""Execution of a sweep's chunks by this process, threads, processes, executors or clusters; handles lost workers."""

from __future__ import annotations

import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from importlib import import_module
from multiprocessing import connection, get_context, parent_process
from threading import Thread
from typing import Any

import numpy as np

from graspfx.environment import processors
from graspfx.errors import InputError, MissingPackageError
from graspfx.progress import unheard, waiting
from graspfx.sweeps.chunk import Chunk, ChunkResult, SceneOrder, SweepError, run_chunk

FORM = (
    "none, 'threads:N', 'processes:N', 'local:N' or 'tcp://HOST:PORT' for a cluster of dask, "
    "an executor of concurrent.futures or a client of dask"
)
OWN = "127.0.0.1:0"  # address of a local cluster's pages: any port, not reachable from the network
PATIENCE = 10.0  # time for a scheduler to answer [s]
DEATHS = 3  # worker deaths before dask blames a chunk
DEPTH = 2  # chunks per worker that are submitted at a time
TRIES = 2  # attempts of a single chunk before it is taken to kill workers
KILLS = "the process that ran it was killed or crashed in every attempt"
BORN_DEAD = (
    "worker processes die before they begin: a script that sweeps in processes must do so below "
    '`if __name__ == "__main__":`, because each process runs the script again'
)
SCHEMES = ("tcp://", "tls://", "ucx://", "inproc://")


class Crew:
    """Workers that accept calls; each call returns a future.

    Args:
        executor: Executor of the calls; None for this process, which runs each call at once.
        workers: Number of simultaneous calls.
        threads: Number of threads per call; None if the process of the call decides.
        anew: Function that makes a new executor after a process has died; None if only the executor's owner can do so.
    """

    def __init__(
        self,
        executor: Executor | None,
        workers: int,
        threads: int | None = None,
        anew: Callable[[], Executor] | None = None,
    ) -> None:
        self.executor, self.workers, self.threads, self._anew = executor, max(1, workers), threads, anew

    @property
    def mends(self) -> bool:
        """Whether the crew continues after the death of a process."""
        return self._anew is not None

    def submit(self, call: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a call, or run it at once if the crew is this process."""
        if self.executor is not None:
            return self.executor.submit(call, *arguments)
        future: Future[Any] = Future()
        with unheard():
            try:
                future.set_result(call(*arguments))
            except Exception as error:  # noqa: BLE001 - it is raised again by the future's result
                future.set_exception(error)
        return future

    def mend(self) -> None:
        """End the processes and make a new executor, if the crew can do so."""
        if self._anew is not None:
            end(self.executor)
            self.executor = self._anew()


@contextmanager
def crew_of(executor: Any) -> Iterator[Crew]:
    """Make the crew for an argument; resources made for the crew end with the block.

    Args:
        executor: None for this process; "threads:N", "processes:N", "local:N", "tcp://..." (N defaults to the number of
            processors); an executor of `concurrent.futures`, or a dask client.

    Raises:
        InputError: If the argument is something else, or the cluster's scheduler cannot be reached.
        MissingPackageError: If `distributed` is not installed, for a cluster.
    """
    with ExitStack() as stack:
        crew = _crew(stack, executor)
        try:
            yield crew
        except BaseException:
            if crew.mends:
                end(crew.executor)
            raise
        if crew.mends and crew.executor is not None:
            crew.executor.shutdown()


def _crew(stack: ExitStack, executor: Any) -> Crew:
    if executor is None:
        return Crew(None, 1)
    if isinstance(executor, str):
        kind, _, count = executor.partition(":")
        if executor.startswith(SCHEMES):
            return _cluster(stack, executor, 0)
        if kind not in ("threads", "processes", "local") or not (not count or (count.isdecimal() and int(count) > 0)):
            raise InputError("executor", executor, FORM)
        number = int(count) if count else processors()
        if kind == "local":
            return _cluster(stack, "", number)
        if kind == "threads":
            return Crew(stack.enter_context(ThreadPoolExecutor(number)), number, threads=1)
        return Crew(_processes(number), number, anew=lambda: _processes(number))
    if isinstance(executor, Executor):
        number = getattr(executor, "_max_workers", None) or processors()
        threads = 1 if isinstance(executor, ThreadPoolExecutor) else None
        return Crew(executor, number, threads=threads)
    if callable(getattr(executor, "get_executor", None)) and callable(getattr(executor, "nthreads", None)):
        return _of_client(executor)
    raise InputError("executor", executor, FORM)


# Processes ------------------------------------------------------------------------------------------------------------


def _processes(count: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=follow_parent)


def follow_parent() -> None:
    """End this process with its parent, even if the parent is killed; leave Ctrl-C to the parent."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: Any) -> None:
    connection.wait([sentinel])
    os._exit(1)


def end(executor: Executor | None) -> None:
    """End an executor's processes at once."""
    if executor is None:
        return
    processes = list((getattr(executor, "_processes", None) or {}).values())
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()


# Clusters -------------------------------------------------------------------------------------------------------------


def _cluster(stack: ExitStack, address: str, count: int) -> Crew:
    """Connect to a cluster's scheduler, or make a local cluster of single-threaded processes."""
    try:
        distributed: Any = import_module("distributed")
        dask: Any = import_module("dask")
    except ImportError as error:
        raise MissingPackageError.of_extra("distributed", "a cluster", "cluster") from error
    if address:
        with waiting(f"reaching {address}"):
            try:
                return _of_client(stack.enter_context(distributed.Client(address, timeout=PATIENCE)))
            except OSError as error:
                expected = "the address of a reachable dask scheduler, as printed by `dask scheduler`"
                raise InputError("executor", address, expected, str(error).split("\n")[0]) from error
    stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": DEATHS - 1}))
    with waiting("starting workers"):
        cluster = distributed.LocalCluster(
            n_workers=count, threads_per_worker=1, processes=True, silence_logs=50,
            dashboard_address=OWN, worker_dashboard_address=OWN,
        )  # fmt: skip
        return _of_client(stack.enter_context(distributed.Client(stack.enter_context(cluster))))


def _of_client(client: Any) -> Crew:
    return Crew(client.get_executor(pure=False), sum(client.nthreads().values()), threads=1)


# Chunks handed out ----------------------------------------------------------------------------------------------------


class ChunkLoop:
    """Runs chunks and delivers each complete result.

    Args:
        crew: Workers that run the chunks.
        order: Order of the sweep.
        finish: Function that receives a chunk and its result.
        note: Function that receives sentences about problems.
    """

    def __init__(
        self,
        crew: Crew,
        order: SceneOrder,
        finish: Callable[[Chunk, ChunkResult], None],
        note: Callable[[str], None],
    ) -> None:
        self.crew, self.order, self.finish, self.note = crew, order, finish, note
        self.content = order.bytes
        self.alive = False  # whether workers have completed anything yet

    def run(self, chunks: Iterable[Chunk]) -> None:
        """Run all chunks.

        Raises:
            SweepError: If workers cannot start, or the caller's executor is broken.
        """
        left, flying = deque(chunks), dict[Future[Any], Chunk]()
        most = 1 if self.crew.executor is None else DEPTH * self.crew.workers
        try:
            while left or flying:
                while left and len(flying) < most:
                    chunk = left.popleft()
                    flying[self._submit(chunk)] = chunk
                ready, _ = wait(list(flying), return_when=FIRST_COMPLETED)
                dead: list[Chunk] = []
                for future in ready:
                    chunk, result = flying.pop(future), self._result(future)
                    if result is None:
                        dead.append(chunk)
                    else:
                        self.finish(chunk, result)
                if dead:
                    self._bury(dead, flying)
        finally:
            for future in flying:
                future.cancel()

    def _submit(self, chunk: Chunk) -> Future[Any]:
        try:
            return self.crew.submit(run_chunk, self.content, chunk, self.crew.threads)
        except BrokenExecutor as error:
            future: Future[Any] = Future()
            future.set_exception(error)
            return future

    def _result(self, future: Future[Any]) -> ChunkResult | None:
        """Wait for the result of a chunk; None if its worker died."""
        try:
            result: ChunkResult = future.result()
        except BrokenExecutor as error:
            if not self.crew.mends:
                text = "a process of the executor died, so it accepts no more calls: use another, or 'processes:N'"
                raise SweepError(f"{text}, which replaces dead processes") from error
            return None
        except CancelledError as error:
            raise SweepError("the executor or the cluster was closed before the end of the sweep") from error
        except Exception as error:
            if type(error).__name__ != "KilledWorker":  # by dask, after several attempts
                raise
            return None
        self.alive = True
        return result

    def _bury(self, dead: list[Chunk], flying: dict[Future[Any], Chunk]) -> None:
        """Repair the crew, and run alone each chunk that may have killed a process; for processes all running ones."""
        tries = 0  # dask has already made its attempts
        if self.crew.mends:
            dead += flying.values()
            flying.clear()
            self.crew.mend()
            self._require_life()
            tries = TRIES if len(dead) > 1 else TRIES - 1
        for chunk in dead:
            self.finish(chunk, self._alone(chunk, tries))

    def _require_life(self) -> None:
        """Distinguish a chunk that kills workers from workers that cannot start.

        Raises:
            SweepError: If workers cannot start.
        """
        try:
            self.alive = self.alive or self.crew.submit(partial(int, 1)).result() == 1
        except BrokenExecutor as error:
            raise SweepError(BORN_DEAD) from error

    def _alone(self, chunk: Chunk, tries: int, *, told: bool = False) -> ChunkResult:
        """Run a chunk alone, or its halves if it kills its worker; a variant that kills workers becomes a failure."""
        for _ in range(tries):
            result = self._result(self._submit(chunk))
            if result is not None:
                return result
            self.crew.mend()
        if not told:
            self.note(f"one of {len(chunk)} variants killed a process: these variants are run in smaller chunks")
        whole = ChunkResult.blank(len(chunk), self.order.shapes, self.order.statistics)
        if len(chunk) == 1:
            whole.failures[0] = KILLS
            self.note(f"variant {chunk.members[0]}: {KILLS}")
            return whole
        for places in np.array_split(np.arange(len(chunk)), 2):
            whole.include(places, self._alone(chunk.part(places), 1, told=True))
        return whole
