"""Elementary functions for kernels: sin, cos, exp, atan2, asin, acos and the cube root, bit-identical on all machines.

The math library of a platform selects code by processor, and a browser has another library, so results on another
machine may differ in the last digits. The functions of this module use only operations that IEEE 754 rounds correctly
(+ - * / and sqrt) and exact scaling, and compiled kernels do not contract these operations. Python, native code and
WebAssembly therefore return the same bits. Kernels of the package call these functions. Third-party kernels may call
`math`, whose results depend on the platform.

Polynomials are nearly minimax on their intervals (Chebyshev expansions, computed with 60 digits and rounded). Comments
state the largest error of each polynomial before rounding.
"""

from __future__ import annotations

import math

LARGEST_ANGLE = 1e8  # largest angle that is reduced with pi/2 in four parts without loss of digits [rad]

# pi/2 in parts of 26, 26, 26 and 53 bits: multiples of the first three by less than 2^27 are exact
HALF_PI_1 = float.fromhex("0x1.921fb50000000p+0")
HALF_PI_2 = float.fromhex("0x1.110b460000000p-26")
HALF_PI_3 = float.fromhex("0x1.1a62630000000p-54")
HALF_PI_4 = float.fromhex("0x1.8a2e03707344ap-81")
TWO_OVER_PI = 0.6366197723675814

LN2_HIGH = float.fromhex("0x1.62e42fee00000p-1")  # 32 bits: a multiple by less than 2^21 is exact
LN2_LOW = float.fromhex("0x1.a39ef35793c76p-33")
ONE_OVER_LN2 = 1.4426950408889634
OVERFLOW, UNDERFLOW = 709.782712893384, -745.1332191019412  # exp x is infinite above the first, zero below the second

HALF_PI, HALF_PI_LOW = 1.5707963267948966, 6.123233995736766e-17
PI_LOW = 1.2246467991473532e-16  # pi - fl(pi)


def sin(x: float) -> float:
    """Return sin x, within one unit in the last place; NaN if |x| exceeds `LARGEST_ANGLE`."""
    sine, _ = sin_cos(x)
    return sine


def cos(x: float) -> float:
    """Return cos x, within one unit in the last place; NaN if |x| exceeds `LARGEST_ANGLE`."""
    _, cosine = sin_cos(x)
    return cosine


def sin_cos(x: float) -> tuple[float, float]:
    """Return sin x and cos x, each within one unit in the last place; NaN if |x| exceeds `LARGEST_ANGLE`."""
    if not abs(x) <= LARGEST_ANGLE:
        return math.nan, math.nan
    if x == 0.0:
        return x, 1.0  # zero keeps its sign
    quarter, r, e = _reduced(x)
    sine, cosine = _sin(r, e), _cos(r, e)
    if quarter == 0:
        return sine, cosine
    if quarter == 1:
        return cosine, -sine
    if quarter == 2:
        return -sine, -cosine
    return -cosine, sine


def exp(x: float) -> float:
    """Return exp x, within one unit in the last place; infinity on overflow."""
    if x > OVERFLOW:
        return math.inf
    if x < UNDERFLOW:
        return 0.0
    if x != x:
        return x
    k = math.floor(x * ONE_OVER_LN2 + 0.5)
    high, low = x - k * LN2_HIGH, k * LN2_LOW
    r = high - low
    e = (high - r) - low  # rounding error of r
    q = 2.7557255400206422e-06 + r * (2.75572736431103e-07 + r * (2.5105217004720745e-08 + r * 2.0914686968086876e-09))
    q = 0.0013888888888883748 + r * (0.00019841269874820627 + r * (2.4801587325547743e-05 + r * q))
    q = 0.5 + r * (0.1666666666666667 + r * (0.04166666666666667 + r * (0.008333333333326136 + r * q)))  # 1.4e-18
    return math.ldexp(1.0 + (r + (r * r * q + e)), k)


def atan2(y: float, x: float) -> float:
    """Return the angle of the point (x, y), within two units in the last place, with the sign rules of C's `atan2`."""
    if x != x or y != y:
        return math.nan
    if x == 0.0 and y == 0.0:
        return math.copysign(0.0 if math.copysign(1.0, x) > 0.0 else math.pi, y)
    if abs(x) == math.inf and abs(y) == math.inf:
        return math.copysign(0.25 * math.pi if x > 0.0 else 0.75 * math.pi, y)
    if x == 0.0 or abs(y) == math.inf:
        return math.copysign(HALF_PI, y)
    angle = _atan(abs(y / x))
    if x < 0.0:
        angle = math.pi - (angle - PI_LOW)
    return math.copysign(angle, y)


def asin(x: float) -> float:
    """Return arcsin x, within two units in the last place; NaN outside of [-1, 1]."""
    if not abs(x) <= 1.0:
        return math.nan
    return atan2(x, math.sqrt((1.0 - x) * (1.0 + x)))


def acos(x: float) -> float:
    """Return arccos x, within two units in the last place; NaN outside of [-1, 1]."""
    if not abs(x) <= 1.0:
        return math.nan
    return atan2(math.sqrt((1.0 - x) * (1.0 + x)), x)


def cube_root(x: float) -> float:
    """Return the cube root of x, within one unit in the last place."""
    if x == 0.0 or not abs(x) < math.inf:
        return x
    m, k = math.frexp(abs(x))
    third = k // 3
    m = math.ldexp(m, k - 3 * third)  # now in [0.5, 4)
    y = 0.6 + m * (0.4 - 0.035 * m)
    for _ in range(3):  # Halley's steps, each of which triples the number of correct digits
        cube = y * y * y
        y += y * ((m - cube) / (2.0 * cube + m))
    return math.copysign(math.ldexp(y, third), x)


def _reduced(x: float) -> tuple[int, float, float]:
    """Reduce an angle: x = n pi/2 + r + e with |r| <= pi/4; return n mod 4, r, and the rounding error e of r."""
    n = math.floor(x * TWO_OVER_PI + 0.5)
    if n == 0:
        return 0, x, 0.0
    a = (x - n * HALF_PI_1) - n * HALF_PI_2  # exact
    b = n * HALF_PI_3  # exact
    s = a - b
    back = a - s
    lost = (a - (s + back)) + (back - b)  # a - b = s + lost, exactly
    low = lost - n * HALF_PI_4
    r = s + low
    return n % 4, r, (s - r) + low


def _sin(r: float, e: float) -> float:
    """Return sin(r + e) for |r| <= pi/4 and a small e."""
    z = r * r
    p = 2.755731610068303e-06 + z * (-2.5051131455427946e-08 + z * 1.591810123027412e-10)
    p = 0.008333333333330946 + z * (-0.0001984126983675497 + z * p)
    return r + (r * z * (-0.16666666666666666 + z * p) + e * (1.0 - 0.5 * z))  # 2e-17


def _cos(r: float, e: float) -> float:
    """Return cos(r + e) for |r| <= pi/4 and a small e."""
    z = r * r
    p = -2.7557317270560326e-07 + z * (2.0876146024689747e-09 - z * 1.1382614868556325e-11)
    p = 0.041666666666666664 + z * (-0.0013888888888887395 + z * (2.4801587298763433e-05 + z * p))  # 1.3e-18
    h = 0.5 * z
    w = 1.0 - h
    return w + (((1.0 - w) - h) + (z * z * p - r * e))


def _atan(x: float) -> float:
    """Return arctan x for x >= 0 by tan(a - b) = (tan a - tan b)/(1 + tan a tan b), with one of five angles b."""
    if x < 0.4375:
        return _atan_about(0.0, 0.0, x)
    if x < 0.6875:
        return _atan_about(0.4636476090008061, 2.2698777452961687e-17, (2.0 * x - 1.0) / (2.0 + x))
    if x < 1.1875:
        return _atan_about(0.7853981633974483, 3.061616997868383e-17, (x - 1.0) / (x + 1.0))
    if x < 2.4375:
        return _atan_about(0.982793723247329, 1.3903311031230998e-17, (x - 1.5) / (1.0 + 1.5 * x))
    return _atan_about(HALF_PI, HALF_PI_LOW, -1.0 / x)


def _atan_about(b: float, low: float, t: float) -> float:
    """Return b + low + arctan t for |t| <= 7/16."""
    z = t * t
    p = 0.05847702282571461 + z * (-0.05033837562503339 + z * (0.03782249492335978 - z * 0.017544246015330268))
    p = -0.09090900184586848 + z * (0.07692087120366835 + z * (-0.06663236416463504 + z * p))
    p = -0.14285714283144457 + z * (0.11111110900259029 + z * p)
    p = -0.33333333333333326 + z * (0.19999999999987744 + z * p)  # 1e-16
    return b + (t + (t * z * p + low))
