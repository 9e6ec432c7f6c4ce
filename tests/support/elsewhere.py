"""Another system than this one, as far as Python tells: for a process of its own, before GraspFX is imported."""

from __future__ import annotations

import ctypes
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any

POSIX = ("fcntl", "termios", "tty", "pty", "resource", "grp", "pwd", "_posixshmem")
OF_OS = (
    "memfd_create", "pidfd_open", "nice", "fork", "forkpty", "openpty", "ttyname", "geteuid", "getuid", "getgid",
    "getpgid", "getpgrp", "killpg", "uname", "mkfifo", "pread", "preadv", "pwrite", "fchmod", "fchown", "chown",
    "lchown", "posix_fallocate", "setsid", "waitid", "WNOHANG", "O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_NOCTTY",
)  # fmt: skip
OF_SIGNAL = (
    "SIGKILL", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGPIPE", "pidfd_send_signal", "setitimer", "alarm",
    "pthread_sigmask", "pause",
)  # fmt: skip
OF_TIME = ("clock_gettime", "clock_getres", "CLOCK_MONOTONIC", "CLOCK_REALTIME")
LIBRARIES = {"ucrtbase": "libm.so.6", "vcruntime140": "libc.so.6", "msvcrt": "libc.so.6"}
OTHERS = (  # what others' code asks the system for is not ours to test
    "asyncio", "concurrent.futures.process", "h5py", "llvmlite.binding", "logging.handlers", "mpmath",
    "matplotlib.backends.backend_agg", "matplotlib.patches", "matplotlib.ticker", "multiprocessing.connection",
    "platform", "pydantic", "scipy.linalg", "scipy.optimize", "scipy.sparse.linalg", "scipy.spatial", "shutil",
    "socketserver", "subprocess", "tempfile", "threadpoolctl", "tree_sitter", "tree_sitter_toml", "trimesh", "uuid",
    "websockets.sync.server", "websockets.sync.client",
)  # fmt: skip


def be_windows(others: Sequence[str] = OTHERS) -> None:
    """Take from this process what Python on Windows has not, and call the platform win32.

    Locks are let pass, and names of Windows' C libraries lead to those that are here.
    """
    for name in others:
        import_module(name)
    for name in POSIX:
        sys.modules[name] = None  # type: ignore[assignment] # how Python is told that there is no such module
    subprocess.Popen.kill = lambda process: process.send_signal(9)  # type: ignore[method-assign, assignment] # it asks for SIGKILL
    for module, names in ((os, OF_OS), (signal, OF_SIGNAL), (time, OF_TIME), (select, ("poll", "epoll"))):
        for name in (*names, *(each for each in vars(os) if module is os and each.lower().startswith("sched_"))):
            if hasattr(module, name):
                delattr(module, name)
    locks: Any = ModuleType("msvcrt")
    locks.LK_NBLCK, locks.locking = 2, lambda descriptor, mode, size: None
    sys.modules["msvcrt"] = locks
    sys.platform = "win32"
    seek, library = os.lseek, ctypes.CDLL

    class Library(library):  # type: ignore[misc, valid-type] # a class from a variable
        def __init__(self, name: str | None, *others: Any, **more: Any) -> None:
            if name is None:
                raise TypeError("Windows has no library of all that is loaded")
            super().__init__(LIBRARIES.get(name, name), *others, **more)

    ctypes.CDLL = Library  # type: ignore[misc, assignment]
    os.lseek = lambda file, place, whence: seek(file, min(place, 1 << 40), whence)
