"""Kernels on records and values: as they are written and lowered they give the same bits; what cannot be is refused."""

from __future__ import annotations

import marshal
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspfx.compile import cache, records
from graspfx.compile.kernel import inline, kernel, source_function, written
from graspfx.compile.lower.lowering import Lowering, Store, lowered_text
from graspfx.compile.machine import compiled
from graspfx.compile.records import (
    Floats,
    Many,
    Record,
    Ref,
    Table,
    floats,
    many,
    name_of,
    room,
    size_for,
    size_of,
    table,
)
from graspfx.errors import InputError
from graspfx.spatial import ZERO, Matrix, Quaternion, Vector, angle_matrix, cross, dot, length, outer


class Site(Record):
    point: Vector
    weight: float


class Finger(Record):
    position: Vector
    site: Site
    touching: bool
    face: int


class Problem(Record):
    residual: float


class Grasp(Record):
    count: int
    dimensions: int
    moving: bool
    rotation: Matrix
    next_rotation: Matrix
    turn: Quaternion
    force: Vector
    problem: Ref[Problem]
    fingers: Many[Finger] = many("count")
    modes: Table = table("6", "1 + 3 * count")
    rest: Floats = floats("count if moving else 2")


@dataclass(frozen=True, slots=True)
class Hit:
    face: int
    point: Vector
    gap: float


@inline
def half(v: Vector) -> Vector:
    k = 0.5
    return k * v


@kernel
def hit(grasp: Grasp, p: Vector, gap: float = 0.25) -> Hit:
    """Find a made-up hit."""
    return Hit(grasp.count, grasp.rotation.transpose @ p, gap * dot(p, p))


@kernel
def weigh(sites: Many[Site], into: Floats) -> float:
    """Add up weights of records inside of records."""
    total = 0.0
    for i, site in enumerate(sites):
        total += site.weight * site.point.x
        into[i] = total
    return total


@kernel
def residual(problem: Problem | None) -> float:
    """Read an optional record."""
    return -1.0 if problem is None else problem.residual


@kernel
def both(a: Vector, b: Vector) -> tuple[float, Vector]:
    """Return a number and a vector."""
    return dot(a, b), a - b


@kernel
def everything(grasp: Grasp) -> int:
    """Use each construct once."""
    R = grasp.next_rotation if grasp.moving else grasp.rotation
    force = ZERO
    touched = 0
    for finger in grasp.fingers:
        f = R @ finger.position
        if grasp.dimensions > 2:
            f += cross(finger.site.point, finger.position)
        force += f
        finger.touching = dot(f, f) > 1.0
        finger.face = touched
        if finger.touching and hit(grasp, f).gap > 0.5:
            touched += 1
        best = hit(grasp, f, gap=0.5).point if finger.touching else half(finger.position)
        finger.position = best - 2.0 * f / 3.0
        for a in range(grasp.dimensions):
            finger.site.point[a] += best.x
        grasp.modes[1, grasp.dimensions] = f.y
        row = grasp.modes[2]
        row[0] = -f.z
    product, difference = both(force, grasp.force)
    grasp.force, k = difference, product
    a = b = k  # type: ignore[assignment] # a kernel's numbers are floats from there on
    while a > 1.0:
        a *= 0.5  # type: ignore[assignment]
    grasp.rest[0] = a + b + weigh(grasp.fingers.part(Finger.site), grasp.rest) + residual(None)
    grasp.problem.residual += residual(grasp.problem)
    M = outer(force, difference)
    grasp.next_rotation = M.transpose
    grasp.turn = grasp.turn @ grasp.turn.conjugate
    for v in (force, difference):
        if not abs(v.x) <= math.inf:
            return -1
    return touched


def block(seed: int, count: int = 3, moving: bool = True) -> np.ndarray:
    rng = np.random.default_rng(seed)
    S = rng.normal(size=size_for(Grasp, count=count, moving=moving) + 1)
    S[:3] = count, int(rng.integers(1, 4)), moving
    Grasp(S).buffer[int(np.argmax(S)) * 0 + _offset("problem")] = S.size - 1
    return S


def _offset(name: str) -> int:
    from graspfx.compile.records import start_of

    return start_of(Grasp, name)


@pytest.mark.parametrize("seed", range(20))
def test_written_and_lowered_give_the_same_bits(seed: int) -> None:
    S = block(seed, count=seed % 4, moving=seed % 3 > 0)
    A, B = S.copy(), S.copy()
    assert written(everything)(Grasp(A)) == everything(Grasp(B))
    assert A.tobytes() == B.tobytes()
    assert A.tobytes() != S.tobytes()


def test_a_kernel_may_use_the_names_that_a_lowering_chooses() -> None:
    A = block(5)
    B = A.copy()
    written(names_of_a_lowering)(Grasp(A))
    names_of_a_lowering(Grasp(B))
    assert A.tobytes() == B.tobytes()


def test_values_come_back_as_values() -> None:
    S = block(1)
    result = hit(Grasp(S), Vector(1.0, 2.0, 2.0))
    assert isinstance(result, Hit)
    assert result.gap == 0.25 * 9.0
    assert result.face == 3
    assert both(Vector(1.0, 0.0, 0.0), ZERO) == (0.0, Vector(1.0, 0.0, 0.0))


def test_buffers_and_numbers_are_taken_as_they_are() -> None:
    S = block(2)
    assert source_function(residual)(S, S.size - 1) == residual(Problem(S, S.size - 1)) == S[-1]
    assert residual(S, -1) == -1.0  # type: ignore[arg-type, call-arg] # as kernels of plain buffers call it


def test_entries_have_names_and_sizes() -> None:
    S = block(3, count=2)
    names = [name_of(Grasp, k, S) for k in range(S.size - 1)]
    assert names[:4] == ["count", "dimensions", "moving", "rotation.xx"]
    assert len(set(names)) == len(names)
    assert "fingers[1].site.point.z" in names
    assert "modes[5, 6]" in names
    assert names[-1] == "rest[1]"
    assert size_of(Finger) == 9
    view = Grasp(S).fingers.array(Finger.position)
    view[1] = 7.0
    assert Grasp(S).fingers[1].position == Vector(7.0, 7.0, 7.0)


@kernel
def two_kinds(grasp: Grasp) -> None:
    """Give a name two kinds."""
    v = ZERO
    if grasp.moving:
        v = 1.0  # type: ignore[assignment] # what is refused
    grasp.force = v


@kernel
def unknown_field(grasp: Grasp) -> None:
    """Name no field."""
    grasp.forces = ZERO  # type: ignore[attr-defined] # what is refused


@kernel
def test_in_while(grasp: Grasp) -> None:
    """Call for a value in a loop's test."""
    while hit(grasp, ZERO).gap > 0.0:
        grasp.count = 0


@kernel
def own_vector(grasp: Grasp) -> None:
    """Index a local value with a variable."""
    v = half(grasp.force)
    grasp.rest[0] = v[grasp.count]


@kernel
def names_of_a_lowering(grasp: Grasp) -> None:
    """Use names for numbers that a lowering chooses for its own variables."""
    t1, i2_x, i2, t3_x, half_k, grasp_0 = 5.0, 7.0, 11.0, 13.0, 17.0, 19.0
    v = half(cross(grasp.force, half(grasp.force)) + grasp.force)
    grasp.rest[0] = t1 + i2_x + i2 + t3_x + half_k + grasp_0 + dot(v, cross(v, grasp.force)) + grasp.rest[1]
    grasp.force = half(v)


@kernel
def name_of_a_part(grasp: Grasp) -> None:
    """Use a vector's name with an underscore for a number."""
    v_x = 7.0
    v = half(grasp.force)
    grasp.rest[0] = v_x + v.x


@kernel
def name_of_a_loop(grasp: Grasp) -> None:
    """Use the name of a loop's offset for a number."""
    finger_at = 7.0
    for finger in grasp.fingers:
        finger.site.weight += finger_at


@kernel
def name_of_a_parameter(grasp: Grasp) -> None:
    """Use the name of a parameter's buffer for a number."""
    grasp_ = 7.0
    grasp.rest[0] = grasp_


test_in_while.__test__ = False  # type: ignore[attr-defined] # a kernel, no test


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (two_kinds, "assigns values of different kinds"),
        (unknown_field, "has no field 'forces'"),
        (test_in_while, "compute it before the loop and at the end of its body"),
        (own_vector, "indexes a local value with a variable; use a constant index"),
        (name_of_a_part, "lowers 'v' to 'v_x'"),
        (name_of_a_loop, "lowers 'finger' to 'finger_at'"),
        (name_of_a_parameter, "lowers 'grasp' to 'grasp_'"),
    ],
)
def test_what_a_kernel_cannot_hold_is_refused_with_its_line(function: Any, why: str) -> None:
    with pytest.raises(InputError, match=why) as error:
        lowered_text(written(function))
    assert "test_lower.py:" in str(error.value)


def test_a_record_of_unknown_kinds_is_refused() -> None:
    class Bad(Record):
        name: str

    with pytest.raises(InputError, match=r"Bad\.name"):
        size_of(Bad)


@kernel
def other_kind(grasp: Grasp) -> float:
    """See the first finger's entries through a record of its own, and a table's width."""
    finger = Finger(grasp.buffer, grasp.fingers.offset)
    return finger.position.x + angle_matrix(finger.position.y).xy


def test_a_view_at_an_offset_and_functions_of_math_in_what_is_written_out() -> None:
    S = block(1)
    assert other_kind(Grasp(S)) == written(other_kind)(Grasp(S))


class Ring(Record):
    length: int
    values: Floats = floats("length")


class Rings(Record):
    count: int
    each: int
    rings: Many[Ring] = many("count", "each")
    rows: Table = table("2", "count + 1")


@kernel
def turn_rings(rings: Rings, factor: float) -> float:
    """Change records whose size varies, each as long as their owner says."""
    total = 0.0
    for ring in rings.rings:
        ring.values[ring.length - 1] *= factor
        total += ring.values[0]
    return total + rings.rows.columns


def test_records_of_varying_size_stand_as_far_apart_as_their_owner_says() -> None:
    S = np.zeros(size_for(Rings, count=3, each=4) + 2)
    S[2:4] = 3, 4
    rings = Rings(S, 2)
    for ring in rings.rings:
        ring.length = 3
        ring.values[0], ring.values[2] = 1.0, 2.0
    A, B, C = S.copy(), S.copy(), S.copy()
    assert written(turn_rings)(Rings(A, 2), 3.0) == turn_rings(Rings(B, 2), 3.0) == 3.0 + 4.0
    assert compiled(turn_rings)(C, 2, 3.0) == 7.0
    assert A.tobytes() == B.tobytes() == C.tobytes()
    assert rings.rings[2].offset == 2 + 2 + 2 * 4
    assert Rings(B, 2).rings[1].values[2] == 6.0
    assert name_of(Rings, 2 + 2 + 4 + 1, S, offset=2) == "rings[1].values[0]"


@kernel
def add_up(places: Many[Vector], rows: Table) -> Vector:
    """Add up values of a group and tell how wide a table is."""
    force = ZERO
    for i, place in enumerate(places):
        force += place + places[i]
    return force * (rows[1, 1] * rows.columns)


@dataclass(frozen=True, slots=True)
class Counts:
    rows: int
    share: float


@kernel
def repeat(counts: Counts) -> float:
    """Count up to a number of a value."""
    total = 0.0
    for _ in range(counts.rows):
        total += counts.share
    return total


def test_groups_of_values_and_whole_numbers_of_values() -> None:
    S = block(4, count=3)
    grasp = Grasp(S)
    places = grasp.fingers.part(Finger.position)
    assert add_up(places, grasp.modes) == written(add_up)(places, grasp.modes)
    assert places[1] == grasp.fingers[1].position
    assert repeat(Counts(3, 0.5)) == written(repeat)(Counts(3, 0.5)) == 1.5


def test_a_kernel_by_itself_is_compiled() -> None:
    """Buffers, offsets and numbers go in flat."""
    S = block(5, count=3)
    table = Grasp(S).modes
    places = Grasp(S).fingers.part(Finger.position)
    run = compiled(add_up)
    result = run(S, places.offset, places.stride, places.count, S, table.offset, table.columns)
    assert Vector(*result) == add_up(places, table)


@kernel
def far(a: Vector, b: Vector) -> float:
    """Compute a length, by a function of another module that takes a root."""
    return length(a - b)


def test_mathematics_of_other_modules_is_written_out() -> None:
    a, b = Vector(1.0, 2.0, 3.0), Vector(0.5, 0.25, 7.0)
    assert far(a, b) == written(far)(a, b) == math.sqrt(0.5**2 + 1.75**2 + 16.0)


def test_a_lowering_is_kept_and_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))
    function: Any = written(everything)
    text, callees, _ = lowered_text(function)
    names = {alias: (callee.__module__, callee.__qualname__) for alias, callee in callees.items()}
    code = compile(text, "test", "exec")
    first = Store("lowered-test")
    first.add(function, Lowering(text, code, names, (__file__,)))
    assert first.find(function) is None  # no source of ours: the key would not know of a change
    first.add(function, Lowering(text, code, names, (records.__file__,)))
    first.save()
    content = cache.load("lowered-test")
    assert content is not None
    again = Store("lowered-test", marshal.loads(content)).find(function)
    assert again is not None
    assert (again.text, again.code, again.callees, again.files) == (text, code, names, (records.__file__,))


class Shelf(Record):
    """Two records whose sizes vary, one after the other."""

    lower_entries: int
    upper_entries: int
    lower: Ring = room("lower_entries")
    upper: Ring = room("upper_entries")


@kernel
def compare_rings(shelf: Shelf) -> float:
    """Read one record of varying size and change the other."""
    lower, upper = shelf.lower, shelf.upper
    upper.values[0] = lower.values[lower.length - 1]
    return lower.length - upper.length


def test_a_record_of_varying_size_takes_the_entries_that_its_owner_says() -> None:
    S = np.zeros(size_for(Shelf, lower_entries=4, upper_entries=3) + 1)
    S[1:3] = 4, 3
    shelf = Shelf(S, 1)
    shelf.lower.length, shelf.upper.length, shelf.lower.values[2] = 3, 2, 5.0
    A, B, C = S.copy(), S.copy(), S.copy()
    assert written(compare_rings)(Shelf(A, 1)) == compare_rings(Shelf(B, 1)) == compiled(compare_rings)(C, 1) == 1.0
    assert A.tobytes() == B.tobytes() == C.tobytes()
    assert Shelf(A, 1).upper.offset == 1 + 2 + 4
    assert A[1 + 2 + 4 + 1] == 5.0
    assert name_of(Shelf, 1 + 2 + 4 + 1, S, offset=1) == "upper.values[0]"


def test_a_field_cannot_take_the_name_of_a_views_own_attribute() -> None:
    with pytest.raises(InputError, match=r"Bad\.offset"):
        type("Bad", (Record,), {"__annotations__": {"offset": float}})
