"""Compiled programs compute the bits that Python computes, operator by operator and statement by statement."""

from __future__ import annotations

import itertools
import math
import random
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from graspfx.compile.native import compiled
from graspfx.errors import InputError
from tests.support.plain_programs import plain

# x and y are floats, i and j whole numbers, p and q truth values.
EXPRESSIONS = """
x + y; x - y; x * y; x / y; x // y; x % y; x ** y; x ** 2; x ** 3; x ** -1; x ** 0.5; -x; +x; -(x - x); abs(x)
i + j; i - j; i * j; i / j; i // j; i % j; i // 7; i % 7; i // -7; i % -7; i ** 2; i ** 0; (-3) ** 3; -i; +i; abs(i); -0
i + x; x - i; i * x; i / x; x / i; x // i; x % i; i // x; i % x; x ** i; i * -0.0
p + q; p * x; p - i; -p; +p; abs(p); p / i; q // 2; p * 0.0; True + x; False * -x
x < y; x <= y; x > y; x >= y; x == y; x != y; i < j; i <= j; i > j; i >= j; i == j; i != j; i < x; x == i; p == q; p < i
x < y < i; x != y != i; 0 <= i < j; 0 <= i < j <= 5; x < 1.0 / y < 3.0; p < q <= i
not x; not i; not p; not x < y; not not y
x and y; x or y; i and j; i or j; x and i; i or x; p and x; x or p; p and q or x; p or q and i; x and y and i or j
p and x < y; x < y and i; x < y or i < j or p; x or (y and i); (x < y) + (i < j); not (p and q) or i > 3 and x < 0.0
x if p else y; x if x < y else i; i if p and q else j; p if x else q; x if not p or y < x else (y if i else j)
min(x, y); max(x, y); min(i, j); max(i, j); min(x, y, i); max(x, y, j, 0.0); min(x, 0); max(0, x); max(i, 2.5)
min(p, i)
int(x); int(i); int(p); float(i); float(p); float(x); bool(x); bool(i); bool(p); int(-0.75); float(int(x))
math.sin(x); math.cos(x); math.tan(x); math.asin(x); math.acos(x); math.atan(x); math.atan2(x, y); math.atan2(i, j)
math.sinh(x); math.cosh(x); math.tanh(x); math.asinh(x); math.acosh(x); math.atanh(x)
math.sqrt(x); math.exp(x); math.log(x); math.log2(x); math.log10(x); math.log1p(x); math.expm1(x); math.pow(x, y)
math.fmod(x, y); math.copysign(x, y); math.copysign(1, x); math.fabs(x); math.fabs(i)
math.floor(x); math.ceil(x); math.trunc(x); math.floor(i); math.floor(x / 2.0) * 2; math.ceil(i)
math.frexp(x)[0]; math.frexp(x)[1]; math.frexp(i)[1]; math.frexp(y * 1e-3)[0]; math.ldexp(1.0, math.frexp(x)[1])
math.ldexp(x, j); math.ldexp(x, i * 1000); math.ldexp(x, -1060); math.ldexp(x, p); math.ldexp(i, -j)
math.isnan(x); math.isinf(x); math.isfinite(x); math.isfinite(i); math.pi * x; math.tau; math.inf - x
inf; -inf; nan * p
x * y + i; x - y * x; (x + y) - x; x * x + y * y; (x + 1.0) * (x - 1.0) - x * x; 0.1 * i + 0.2 * x; 1e300 * x * 1e10
x + 0.0; x - 0.0; 0.0 - x; x * 1.0; x * 0.0; x - x; x / x; 1e-320 * y; x / 3.0; 2.0 ** i; 0.5 ** 0.5
1 / 3 * i; x * 2 ** 10
""".replace("\n", ";")
TABLE = [text.strip() for text in EXPRESSIONS.split(";") if text.strip()]
WHOLES = re.compile(r"int\(|floor|ceil|trunc")
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, math.inf, -math.inf, math.nan, 1e308, -1e-310, 5e-324, 1e17, 0.1]
WHOLE = [0, 1, -1, 2, -3, 7, 10, -14, 1000003]


def arguments() -> list[tuple[float, float, int, int, bool, bool]]:
    """Every pair of special values, and random ones of all sizes."""
    rng = random.Random(0)
    pairs = itertools.product(SPECIAL, SPECIAL)
    more = ((rng.gauss(0.0, 1.0) * 10.0 ** rng.randint(-8, 8), rng.uniform(-5.0, 5.0)) for _ in range(400))
    some = ((rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)) for _ in range(200))
    out = []
    for x, y in itertools.chain(pairs, more, some):
        i, j = rng.choice(WHOLE), rng.choice([*WHOLE, rng.randint(-50, 50)])
        out.append((x, y, i, j, rng.random() < 0.5, rng.random() < 0.5))
    return out


def in_python(function: Callable[..., float], values: tuple[float, ...]) -> float | None:
    """Evaluate in Python; None where it refuses, or where a whole number is not one of 64 bits."""
    try:
        found = function(*values)
    except (ArithmeticError, ValueError):
        return None
    if isinstance(found, complex) or (isinstance(found, int) and abs(found) >= 2**53):
        return None
    return float(found)


def bits(value: float) -> object:
    return "nan" if value != value else (value, math.copysign(1.0, value))


def test_every_operator_gives_the_bits_that_python_gives() -> None:
    functions = [f"def e{k}(x, y, i, j, p, q):\n    return {text}\n" for k, text in enumerate(TABLE)]
    calls = [f"        R[m * {len(TABLE)} + {k}] = e{k}(x, y, i, j, p, q)" for k in range(len(TABLE))]
    entry = """
def table(A, R, n):
    for m in range(n):
        x, y, i, j = A[6 * m], A[6 * m + 1], int(A[6 * m + 2]), int(A[6 * m + 3])
        p, q = A[6 * m + 4] > 0.5, A[6 * m + 5] > 0.5
"""
    given = arguments()
    A, R = np.array(given, dtype=float).ravel(), np.zeros(len(given) * len(TABLE))
    compiled("\n".join([*functions, entry, *calls])).bind(A, R).brief(len(given))
    namespace: dict[str, Any] = {"math": math, "inf": math.inf, "nan": math.nan}
    exec("\n".join(functions), namespace)
    compared = dict.fromkeys(TABLE, 0)
    for values, row in zip(given, R.reshape(-1, len(TABLE)), strict=True):
        for k, text in enumerate(TABLE):
            if WHOLES.search(text) and abs(values[0]) >= 2**53:
                continue  # a whole number on the way that 64 bits do not hold
            expected = in_python(namespace[f"e{k}"], values)
            if expected is not None:
                assert bits(row[k]) == bits(expected), (text, values)
                compared[text] += 1
    assert min(compared.values()) > 20, compared


STATEMENTS = {
    "loops inside loops, left and gone on": """
def f(A, n):
    total = 0
    for i in range(n):
        if i % 3 == 1:
            continue
        for j in range(i, -4, -2):
            if j * i > 30:
                break
            total = total + i - j
        while total > 40:
            total //= 2
            if total == 17:
                break
        A[i] = total
    A[n] = i
    return total
""",
    "range with a step of either sign": """
def f(A, n):
    k = 0
    for s in range(-3, 4):
        if s != 0:
            for i in range(n, -n, s):
                k = k + 1
            for i in range(-n, n, s):
                k = k + 10
            for i in range(s, s):
                k = k + 1000
        A[s + 3] = k
    return k
""",
    "a loop's variable keeps its last value, and may be changed in the body": """
def f(A, n):
    i = 5
    for i in range(n):
        A[i] = i
        i = i * 2.5
        A[i > 3.0] += i
    return int(i)
""",
    "a whole number on one way and a float on another": """
def f(A, n):
    x = 1
    y = 3
    for i in range(n):
        A[2 * i] = x / 2 + y // 2
        if i % 2:
            x = x + 1
        else:
            y = y * 0.75
        A[2 * i + 1] = -x * y
    z = True
    if n > 3:
        z = 2
    if n > 4:
        z = z + 0.5
    A[40] = z
    return x
""",
    "first set in a loop, read on its next turn": """
def f(A, n):
    for i in range(n):
        for j in range(2):
            if i > 0:
                A[i] = last + other[j]
            last = i * 0.5
        other = i, last * j
    return 0
""",
    "tuples returned, unpacked, indexed, exchanged": """
def g(a, b):
    if a > b:
        return a, b, a > b
    return b, a * 1.5, 0
def h(A, k):
    return A[k], k + 1
def f(A, n):
    a, b = 1.0, 2
    for i in range(n):
        a, b = b, a + i
        t = g(a, b)
        A[3 * i], A[3 * i + 1] = t[1], t[0]
        p, q, r = t
        A[3 * i + 2] = p + q * r
        A[40], k = h(A, i)
        t = k
        A[41] = t
    return int(b)
""",
    "what stands behind `and` and `or` is not evaluated": """
def count(A, k):
    A[k] = A[k] + 1.0
    return A[k] < 4.0
def f(A, n):
    for i in range(n):
        if i > 2 and count(A, 0) or i < 5 and count(A, 1):
            A[2] += 1.0
        x = i and count(A, 3) or count(A, 4)
        A[5] = A[5] + x
        A[6] = A[6] + (1 < i < 2 + count(A, 7) < 9)
        while not (count(A, 8) and i > 1):
            A[9] += 1
            if A[9] > 20.0:
                break
    return 0
""",
    "returns from inside loops, of nothing and of numbers": """
def early(A, n):
    for i in range(n):
        while True:
            if A[i] > 2.0:
                return i
            A[i] = A[i] + 0.75
            if A[i] > 1.0:
                break
    return -0.5
def nothing(A):
    for i in range(3):
        if A[i] > 1.5:
            return
        A[i] = 9.0
def f(A, n):
    for k in range(3):
        A[30 + k] = early(A, n)
    nothing(A)
    return n > 5
""",
}


@pytest.mark.parametrize("name", STATEMENTS)
def test_statements_do_what_python_does(name: str) -> None:
    source = STATEMENTS[name]
    for n in (1, 2, 5, 9):
        A, B = np.zeros(64), np.zeros(64)
        expected = plain(source, A)(n)
        native = compiled(source).bind(B)
        assert (native.brief if n % 2 else native.long)(n) == expected
        np.testing.assert_array_equal(A.view(np.int64), B.view(np.int64))


REFUSED = {
    "def f(A):\n    A[0] = open(A[1])\n": "line 2.*open",
    "def f(A):\n    x = [1.0]\n    A[0] = x[0]\n": r"line 2.*\[1\.0\]",
    "def f(A):\n    with A:\n        A[0] = 1.0\n": "line 2.*with A",
    "def f(A):\n    for x in A:\n        A[0] = x\n": "line 2.*for x in A",
    "def f(A):\n    A[0.5] = 1.0\n": "line 2.*integer",
    "def f(A):\n    A[0] = y\n": "line 2.*'y'",
    "def f(A):\n    A[0] = math.gamma(A[1])\n": "line 2.*gamma",
    "def f(A):\n    A[0] = math.hypot(A[1], A[2])\n": "line 2.*hypot",
    "def f(A):\n    A[0] = 2 ** 70 + 1180591620717411303424\n": "64 bits",
    "def g(A):\n    A[0] = 1.0\ndef f(A):\n    A[1] = g(A)\n": "returns nothing",
    "def f(A):\n    A[0] = f(A)\n": "calls itself",
    "def f(A):\n    a, b = 1.0, 2.0, 3.0\n    A[0] = a\n": "number of targets and values",
    "def f(A):\n    A[0] = 1.0 if A[1] is A[2] else 2.0\n": "is A",
    "def f(A):\n    return A[0]\n": "returns an integer",
    "def f(n, A):\n    A[0] = n\n": "buffers first",
}


@pytest.mark.parametrize("source", REFUSED)
def test_what_cannot_be_compiled_is_said_with_its_line(source: str) -> None:
    with pytest.raises(InputError, match=REFUSED[source]):
        compiled(source)


def test_an_entry_takes_floats_and_whole_numbers() -> None:
    source = "def f(A, n, x, k):\n    A[n] = x / k\n    return k // n\n"
    A = np.zeros(4)
    assert compiled(source, floats=["x"]).bind(A).brief(2, 0.5, 7) == 3
    assert A[2] == 0.5 / 7
    with pytest.raises(InputError, match="floats"):
        compiled(source, floats=["y"])


@pytest.mark.parametrize("wrong", [np.zeros(4, np.float32), np.zeros((4, 4))[:, 0], b"12345678", np.zeros(0)])
def test_only_buffers_of_floats_are_taken(wrong: object) -> None:
    native = compiled("def f(A):\n    A[0] = 1.0\n")
    with pytest.raises(InputError, match="contiguous, writable, non-empty buffer"):
        native.bind(wrong)
    with pytest.raises(InputError, match="1: A"):
        native.bind(np.zeros(1), np.zeros(1))
