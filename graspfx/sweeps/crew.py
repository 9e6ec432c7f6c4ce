"""Execution of a sweep's chunks in this process, threads, processes, executors or clusters; replaces dead workers."""

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
KILLS = "the process that ran this variant was killed or crashed in every attempt"
BORN_DEAD = (
    "worker processes end before they begin: a script must start a sweep in processes below "
    '`if __name__ == "__main__":`, because each process runs the script again'
)
SCHEMES = ("tcp://", "tls://", "ucx://", "inproc://")


class Crew:
    """Workers to which calls are submitted.

    Args:
        executor: Executor that runs the calls; None to run each call immediately in this process.
        workers: Number of simultaneous calls.
        threads: Number of threads of each call; None for the default of `run_chunk`.
        anew: Function that creates a new executor after a worker process has died; None for an executor that cannot be
            replaced.
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
        """Whether a new executor is created after a worker process has died."""
        return self._anew is not None

    def submit(self, call: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a call and return its future; without an executor, run the call immediately."""
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
        """End the worker processes and create a new executor; do nothing if the executor cannot be replaced."""
        if self._anew is not None:
            end(self.executor)
            self.executor = self._anew()


@contextmanager
def crew_of(executor: Any) -> Iterator[Crew]:
    """Create the workers for the argument `executor` of `sweep`, and release created resources after the `with` block.

    Args:
        executor: None for this process; "threads:N" or "processes:N"; "local:N" for a local dask cluster, where N is
            the number of workers, by default the number of processors; "tcp://HOST:PORT" for the scheduler of a dask
            cluster; an executor of `concurrent.futures`; or a dask client.

    Raises:
        InputError: If the argument has another form, or the scheduler of a cluster cannot be reached.
        MissingPackageError: If a cluster is requested and `distributed` is not installed.
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
    """End this process when its parent ends, even if the parent is killed; ignore Ctrl-C, which the parent handles."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: Any) -> None:
    connection.wait([sentinel])
    os._exit(1)


def end(executor: Executor | None) -> None:
    """Terminate the processes of an executor immediately."""
    if executor is None:
        return
    processes = list((getattr(executor, "_processes", None) or {}).values())
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()


# Clusters -------------------------------------------------------------------------------------------------------------


def _cluster(stack: ExitStack, address: str, count: int) -> Crew:
    """Connect to the scheduler at `address`; if it is empty, start a local cluster of `count` processes."""
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
    """Runs chunks on workers, and passes each result to a function.

    Args:
        crew: Workers that run the chunks.
        order: Specification of the sweep.
        finish: Function that is called with each chunk and its result.
        note: Function that is called with a text about each problem.
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
            SweepError: If workers cannot start, or a process of the caller's executor has died.
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
        """Return the result of a chunk; None if the worker that ran the chunk died."""
        try:
            result: ChunkResult = future.result()
        except BrokenExecutor as error:
            if not self.crew.mends:
                text = "a process of the executor died, and the executor accepts no more calls"
                raise SweepError(f"{text}: use a new executor, or 'processes:N', which replaces processes") from error
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
        """Replace the executor, and run again, one at a time, each chunk that may have killed a process.

        In a pool of processes, the death of one process ends all running chunks, so that each of them may be the cause.
        """
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
        """Check that workers can start: they have completed a chunk before, or now complete a trivial call.

        Raises:
            SweepError: If workers cannot start.
        """
        try:
            self.alive = self.alive or self.crew.submit(partial(int, 1)).result() == 1
        except BrokenExecutor as error:
            raise SweepError(BORN_DEAD) from error

    def _alone(self, chunk: Chunk, tries: int, *, told: bool = False) -> ChunkResult:
        """Run a chunk while no other chunk runs, and return its result.

        If all attempts kill the worker, the halves of the chunk are run. A single variant that kills the worker is
        recorded as a failure.

        Args:
            tries: Number of attempts before the chunk is halved.
            told: Whether the user has been told that the chunk is divided.
        """
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
