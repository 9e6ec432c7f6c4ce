"""One BLAS thread within, nested and from several threads, and what was set before afterwards."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from graspfx.analysis.blas_threads import one_blas_thread


def threads() -> list[int]:
    return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]


def test_the_users_own_number_comes_back() -> None:
    np.linalg.eigvals(np.eye(3))
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert before
        with one_blas_thread():
            assert set(threads()) == {1}
            with one_blas_thread():
                assert set(threads()) == {1}
            assert set(threads()) == {1}
        assert threads() == before


def test_it_comes_back_after_an_exception() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with pytest.raises(ZeroDivisionError), one_blas_thread():
            raise ZeroDivisionError
        assert threads() == before


def test_a_decorated_function_may_call_itself() -> None:
    @one_blas_thread()
    def depth(n: int) -> list[int]:
        return threads() if n == 0 else depth(n - 1)

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert set(depth(3)) == {1}
        assert threads() == before


def test_a_thread_has_its_limit_too() -> None:
    def within() -> set[int]:
        with one_blas_thread():
            return set(threads())

    before = threads()
    with one_blas_thread():
        pass
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(within).result(30.0) == {1}
    assert threads() == before


def test_threads_that_overlap_leave_the_number_of_before() -> None:
    """The first to enter leaves first: what it restores is not undone by the second, which came upon the limit."""
    inside, first_out = Barrier(2, timeout=20.0), Barrier(2, timeout=20.0)

    def first() -> None:
        with one_blas_thread():
            inside.wait()
        first_out.wait()

    def second() -> None:
        with one_blas_thread():
            inside.wait()
            first_out.wait()

    with threadpool_limits(limits=2, user_api="blas"):
        pass
    before = threads()
    with ThreadPoolExecutor(2) as pool:
        for each in [pool.submit(first), pool.submit(second)]:
            each.result(30.0)
    assert threads() == before


PROGRAM = """
import json, numpy
from threadpoolctl import threadpool_info
from graspfx.analysis.blas_threads import one_blas_thread
with one_blas_thread():
    pass
import scipy.linalg
with one_blas_thread():
    print(json.dumps([each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]))
"""


def test_a_library_that_comes_later_is_limited_too() -> None:
    answer = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert set(json.loads(answer.stdout)) == {1}
