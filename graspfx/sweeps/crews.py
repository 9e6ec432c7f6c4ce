"""Those who run a sweep's chunks: this process, threads, processes of its own, any executor, or a cluster of dask."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from multiprocessing import connection, get_context, parent_process
from threading import Thread
from typing import Any

from graspfx.environment import processors
from graspfx.errors import InputError, MissingPackageError
from graspfx.progress import unheard, waiting

FORM = (
    "none, 'threads:N', 'processes:N', 'local:N' or 'tcp://HOST:PORT' for a cluster of dask, "
    "an executor of concurrent.futures or a client of dask"
)
OWN = "127.0.0.1:0"  # where pages of a cluster on this machine are: on no network, at any port
PATIENCE = 10.0  # [s] for a scheduler to answer
DEATHS = 3  # of workers before dask says of a chunk that it kills them
SCHEMES = ("tcp://", "tls://", "ucx://", "inproc://")


class Crew:
    """A crew that takes one call after the other, and gives a future of each.

    Args:
        executor: that runs them; None for this process, which runs each when it comes.
        workers: how many run at a time.
        threads: that each call may have; None for as many as its process decides.
        anew: makes another executor when a process of this one has died; None where its owner has to.
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
        """Whether the crew goes on when a process of it has died."""
        return self._anew is not None

    def submit(self, call: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Begin a call, or in this process make it."""
        if self.executor is not None:
            return self.executor.submit(call, *arguments)
        future: Future[Any] = Future()
        with unheard():
            try:
                future.set_result(call(*arguments))
            except Exception as error:  # noqa: BLE001 - it is raised again by whoever asks the future
                future.set_exception(error)
        return future

    def mend(self) -> None:
        """Take new processes for those that have died."""
        if self._anew is not None:
            end(self.executor)
            self.executor = self._anew()


@contextmanager
def crew_of(executor: Any) -> Iterator[Crew]:
    """Give the crew that an argument stands for; what is made for it ends with the block.

    Args:
        executor: None for this process; "threads:N", "processes:N", "local:N", "tcp://..." (N for as many as there are
            processors if left out); an executor of `concurrent.futures`, or a client of dask.

    Raises:
        InputError: something else.
        MissingPackageError: no distributed, for a cluster.
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
    """End this process with the one that made it, also where that is killed; Ctrl-C is for that one."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: Any) -> None:
    connection.wait([sentinel])
    os._exit(1)


def end(executor: Executor | None) -> None:
    """End an executor's processes at once, whatever they do."""
    if executor is None:
        return
    processes = list((getattr(executor, "_processes", None) or {}).values())
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()


# Clusters -------------------------------------------------------------------------------------------------------------


def _cluster(stack: ExitStack, address: str, count: int) -> Crew:
    """Reach the scheduler of a cluster, or make one of some processes on this machine, with a thread each."""
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
                expected = "the address of a scheduler of dask that answers, as `dask scheduler` prints it"
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
