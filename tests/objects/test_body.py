"""A body's block: filled, refused, stepped by four integrators, locked, predicted."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.objects import integrators as at
from graspfx.objects.body import INTEGRATORS, VISCOUS_LIMIT, Body, NativeBody, create, fill_body
from graspfx.objects.body_state import BodyState, Motion
from graspfx.spatial import Vector

Array = NDArray[np.float64]
MOMENTS = (3e-5, 5e-5, 6e-5)
SPACE = {"dimensions": 3, "mass": 0.1, "inertia": MOMENTS, "rotational_viscosity": 3e-4, "viscosity": 0.8}


def block(**given: Any) -> Array:
    state = np.full(at.SIZE, np.nan)
    fill_body(state, **given)
    assert np.isfinite(state).all()  # written whole
    return state


def push(state: Array, force: Any = (), moment: Any = ()) -> Array:
    state[at.FORCE : at.FORCE + len(force)] = force
    state[at.MOMENT : at.MOMENT + len(moment)] = moment
    return state


def unit(rng: np.random.Generator) -> Array:
    q: Array = rng.normal(size=4)
    return q / np.linalg.norm(q)


def world_inertia(state: Array) -> Array:
    R = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
    return np.asarray(R @ np.diag(state[at.INERTIA : at.INERTIA + 3]) @ R.T)


def rotation_vector(R: Array) -> Array:
    """log of a rotation by less than a right angle."""
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    s = float(np.linalg.norm(v))
    return v * (math.asin(s) / s if s > 0 else 1.0)


# The block ---------------------------------------------------------------------------------------------------------


def test_defaults() -> None:
    """A body rests at the origin, unturned, free, without gravity or viscosity, semi-implicit."""
    state = block(dimensions=3, mass=0.1, inertia=4e-5)
    expected = np.zeros(at.SIZE)
    expected[[at.DIMENSIONS, at.MASS, at.INTEGRATOR, at.QUATERNION + 3]] = 3, 0.1, at.SEMI_IMPLICIT, 1
    expected[at.INERTIA : at.INERTIA + 3] = 4e-5
    expected[at.FREE : at.FREE + 6] = 1.0
    expected[at.ROTATION : at.ROTATION + 9] = np.eye(3).ravel()
    np.testing.assert_array_equal(state, expected)


def test_everything_given_stands_where_it_belongs() -> None:
    s = math.sqrt(0.5)
    state = block(
        **SPACE, integrator="exact", free=(1, 0, 1, 0, 1, 1), gravity=(0, 0, -9.81), position=(1, 2, 3),
        orientation=(s, 0, 0, s), velocity=(4, 0, 6), angular_velocity=(0, 8, 9),
    )  # fmt: skip
    body = BodyState(state)
    motion = body.motion
    assert (body.dimensions, body.mass, body.inertia) == (3, 0.1, Vector(*MOMENTS))
    assert (body.viscosity, body.rotational_viscosity, body.integrator) == (0.8, 3e-4, at.EXACT)
    assert (body.free_translation, body.free_rotation) == (Vector(1, 0, 1), Vector(0, 1, 1))
    assert (body.gravity, motion.position) == (Vector(0, 0, -9.81), Vector(1, 2, 3))
    np.testing.assert_allclose(motion.array(Motion.quaternion), [s, 0, 0, s], rtol=1e-15)
    assert (motion.angle, motion.velocity, motion.angular_velocity) == (0.0, Vector(4, 0, 6), Vector(0, 8, 9))
    # a quarter turn about x takes y to z
    np.testing.assert_allclose(motion.array(Motion.rotation), [1, 0, 0, 0, 0, -1, 0, 1, 0], atol=1e-15)


def test_free_is_in_the_order_of_the_rows_of_G() -> None:
    """Line fx; plane fx, fy, tz; space three forces, three moments."""
    assert block(dimensions=1, mass=1.0)[8:14].tolist() == [1, 0, 0, 0, 0, 0]
    plane = block(dimensions=2, mass=1.0, inertia=1.0, free=(True, False, True))
    assert plane[8:14].tolist() == [1, 0, 0, 0, 0, 1]
    assert plane[at.INERTIA : at.INERTIA + 3].tolist() == [0, 0, 1]
    np.testing.assert_array_equal(
        block(dimensions=2, mass=1.0, inertia=(7.0, 8.0, 1.0), free=(True, False, True)), plane
    )


def test_readings() -> None:
    line: Any = NativeBody(block(dimensions=1, mass=1.0, position=[2.0], velocity=[3.0]))
    assert (line.position.tolist(), line.velocity.tolist()) == ([2.0], [3.0])
    assert line.orientation is None
    assert line.angular_velocity is None
    plane: Any = NativeBody(block(dimensions=2, mass=1.0, inertia=1.0, orientation=7.0, angular_velocity=-1.0))
    assert (plane.orientation, plane.angular_velocity, plane.position.shape) == (7.0, -1.0, (2,))
    space: Any = NativeBody(block(**SPACE))
    np.testing.assert_array_equal(space.orientation, [0, 0, 0, 1])
    assert np.shape(space.angular_velocity) == (3,)
    body: Body = create(space.state)
    body.step(0.1)
    assert body.state is space.state


BAD: list[tuple[str, dict[str, Any]]] = [
    ("dimensions", {"dimensions": 4}),
    ("mass", {"mass": 0.0}),
    ("mass", {"mass": -1.0}),
    ("mass", {"mass": np.nan}),
    ("mass", {"mass": np.inf}),
    ("mass", {"mass": "heavy"}),
    ("inertia", {"inertia": None}),
    ("inertia", {"inertia": 0.0}),
    ("inertia", {"inertia": (1.0, 1.0)}),
    ("inertia", {"inertia": (1.0, 1.0, 0.0)}),
    ("inertia", {"inertia": (1.0, 1.0, 2.1)}),
    ("inertia", {"inertia": np.nan}),
    ("viscosity", {"viscosity": -1e-9}),
    ("viscosity", {"viscosity": np.inf}),
    ("rotational_viscosity", {"rotational_viscosity": -1.0}),
    ("free", {"free": (True, True)}),
    ("free", {"free": (True, True, 2, True, True, True)}),
    ("gravity", {"gravity": (0.0, 0.0)}),
    ("gravity", {"gravity": -9.81}),
    ("position", {"position": (0.0, np.nan, 0.0)}),
    ("orientation", {"orientation": (0.0, 0.0, 0.0, 1.00001)}),
    ("orientation", {"orientation": (0.0, 0.0, 0.0, 0.0)}),
    ("orientation", {"orientation": 0.3}),
    ("velocity", {"velocity": (1.0,)}),
    ("velocity", {"velocity": (1.0, 0.0, 0.0), "free": (False, True, True, True, True, True)}),
    ("angular_velocity", {"angular_velocity": 1.0}),
    ("angular_velocity", {"angular_velocity": (0.0, 0.0, 1.0), "free": (True, True, True, True, True, False)}),
    ("orientation", {"dimensions": 1, "orientation": 0.0}),
    ("angular_velocity", {"dimensions": 1, "angular_velocity": 0.0}),
    ("orientation", {"dimensions": 2, "orientation": (0.0, 0.0, 0.0, 1.0)}),
]


@pytest.mark.parametrize(("name", "wrong"), BAD)
def test_what_cannot_be_is_named(name: str, wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        block(**({"dimensions": 3, "mass": 0.1, "inertia": 4e-5} | wrong))
    assert caught.value.name == name


def test_an_unknown_integrator_gets_the_close_match() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'implicit'"):
        block(dimensions=1, mass=1.0, integrator="implict")


def test_inertia_is_not_asked_for_where_nothing_turns() -> None:
    assert not block(dimensions=3, mass=1.0, free=(1, 1, 1, 0, 0, 0))[at.INERTIA : at.INERTIA + 3].any()


def test_a_quaternion_is_normalised_to_rounding() -> None:
    state = block(**SPACE, orientation=np.array([0.6, 0.0, 0.0, 0.8]) * (1 + 5e-7))
    np.testing.assert_allclose(state[at.QUATERNION : at.QUATERNION + 4], [0.6, 0, 0, 0.8], rtol=1e-15)


@pytest.mark.parametrize("state", [np.zeros(3), np.zeros(at.SIZE), np.ones(at.SIZE, dtype=np.float32)])
def test_a_block_that_nobody_filled(state: Any) -> None:
    with pytest.raises(InputError, match="state"):
        NativeBody(state)


@pytest.mark.parametrize(
    "state",
    [
        np.zeros(3),
        np.zeros(at.SIZE + 1),
        np.zeros(2 * at.SIZE)[::2],
        np.zeros(at.SIZE, dtype=int),
        [0.0] * at.SIZE,
        None,
    ],
)
def test_a_block_that_cannot_be_filled(state: Any) -> None:
    with pytest.raises(InputError, match=rf"^state: .* a contiguous float64 array of shape \({at.SIZE},\)"):
        fill_body(state, dimensions=1, mass=1.0)


# Steps -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["explicit", "semi-implicit", "implicit"])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_one_step_is_what_the_table_says(integrator: str, d: int) -> None:
    """x and v of one step from the update as it is usually written, in translation and in plane rotation."""
    rng = np.random.default_rng(d)
    T, m, b, J, bw = 0.005, 0.1, 0.8, 4e-5, 3e-4
    x, v, f, g = rng.normal(size=(4, d))
    turns = {"inertia": J, "rotational_viscosity": bw} if d > 1 else {}
    state = block(dimensions=d, mass=m, viscosity=b, integrator=integrator, gravity=g, position=x, velocity=v, **turns)
    if d == 2:
        state[at.ANGLE], state[at.ANGULAR_VELOCITY + 2] = 0.3, 2.0
    NativeBody(push(state, f, (0, 0, 1e-4) if d == 2 else ())).step(T)

    def update(x: Any, v: Any, a: Any, rate: float) -> tuple[Any, Any]:
        if integrator == "explicit":
            return x + T * v, v + T * (a - rate * v)
        if integrator == "semi-implicit":
            v = v + T * (a - rate * v)
        else:
            v = (v + T * a) / (1 + T * rate)
        return x + T * v, v

    x, v = update(x, v, f / m + g, b / m)
    np.testing.assert_allclose(state[at.POSITION : at.POSITION + d], x, rtol=1e-15, atol=1e-16)
    np.testing.assert_allclose(state[at.VELOCITY : at.VELOCITY + d], v, rtol=1e-14)
    if d == 2:
        angle, w = update(0.3, 2.0, 1e-4 / J, bw / J)
        assert (state[at.ANGLE], state[at.ANGULAR_VELOCITY + 2]) == pytest.approx((angle, w), rel=1e-15)
        R = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
        np.testing.assert_allclose(R[:2, :2], [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


@pytest.mark.parametrize("integrator", ["explicit", "semi-implicit", "implicit"])
def test_one_step_of_rotation_in_space(integrator: str) -> None:
    """w and R of one step, with full matrices in world axes."""
    rng = np.random.default_rng(3)
    T, b = 0.005, 3e-4
    w, moment = rng.normal(size=3) * 5, rng.normal(size=3) * 1e-3
    state = block(**SPACE, integrator=integrator, orientation=unit(rng), angular_velocity=w)
    inertia, R = world_inertia(state), state[at.ROTATION : at.ROTATION + 9].reshape(3, 3).copy()
    NativeBody(push(state, (), moment)).step(T)
    gyro = np.cross(w, inertia @ w)
    if integrator == "implicit":
        new = np.linalg.solve(inertia + T * b * np.eye(3), inertia @ w + T * (moment - gyro))
    else:
        new = w + T * np.linalg.solve(inertia, moment - gyro - b * w)
    np.testing.assert_allclose(state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3], new, rtol=1e-13)
    turned = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3) @ R.T
    np.testing.assert_allclose(rotation_vector(turned), T * (w if integrator == "explicit" else new), rtol=1e-12)


def test_buffers_of_both_kinds_give_the_same_bits() -> None:
    """The kernels on an array and on a memoryview; and anywhere in a larger buffer."""
    rng = np.random.default_rng(4)
    free: tuple[tuple[bool, ...], ...] = ((True,) * 6, (True, True, False, True, False, True))
    for integrator, moves in itertools.product(INTEGRATORS, free):
        w = rng.normal(size=3) * moves[3:]
        state = push(block(**SPACE, integrator=integrator, free=moves, orientation=unit(rng), angular_velocity=w))
        large = np.concatenate([np.full(5, np.nan), state, np.full(3, np.nan)])
        view = memoryview(state)
        for _ in range(20):
            wrench = rng.normal(size=6) * 1e-3
            state[at.FORCE : at.FORCE + 6] = large[5 + at.FORCE : 5 + at.FORCE + 6] = wrench
            for S, o in ((view, 0), (large, 5)):
                at.predict(BodyState(S, o), 0.005)
                at.step(BodyState(S, o), 0.005)
        np.testing.assert_array_equal(large[5:-3], state)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_locked_freedoms_stay_exactly_where_they_are(integrator: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        free = rng.integers(2, size=6)
        v, w = rng.normal(size=3) * free[:3], 5 * rng.normal(size=3) * free[3:]
        state = block(
            **SPACE, integrator=integrator, free=free, gravity=(1, 2, 3), position=(1, 2, 3), velocity=v,
            orientation=unit(rng), angular_velocity=w,
        )  # fmt: skip
        first = state.copy()
        push(state, (1, 1, 1), (1e-3, 1e-3, 1e-3))
        for _ in range(50):
            at.step(BodyState(state), 0.005)
        locked = np.flatnonzero(free[:3] == 0)
        np.testing.assert_array_equal(state[at.POSITION + locked], first[at.POSITION + locked])
        np.testing.assert_array_equal(state[at.VELOCITY + locked], 0.0)
        locked = np.flatnonzero(free[3:] == 0)
        np.testing.assert_array_equal(state[at.ANGULAR_VELOCITY + locked], 0.0)
        if len(locked) == 3:
            np.testing.assert_array_equal(
                state[at.QUATERNION : at.QUATERNION + 4], first[at.QUATERNION : at.QUATERNION + 4]
            )


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_knob_is_the_plane_body(integrator: str, axis: int) -> None:
    """One free rotation e of a crooked body: the plane's angle with J = e'I e, for each integrator."""
    rng = np.random.default_rng(6)
    free = np.eye(6, dtype=bool)[3 + axis]
    e = np.eye(3)[axis]
    given = {**SPACE, "integrator": integrator, "free": free, "angular_velocity": 2.0 * e}
    state = push(block(**given, orientation=unit(rng)), (), 1e-4 * e)
    J = float(e @ world_inertia(state) @ e)
    R = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3).copy()
    plane = block(
        dimensions=2, mass=0.1, inertia=J, rotational_viscosity=3e-4, integrator=integrator, angular_velocity=2.0
    )
    push(plane, (), (0, 0, 1e-4))
    for _ in range(50):
        at.step(BodyState(state), 0.005)
        at.step(BodyState(plane), 0.005)
    assert state[at.ANGULAR_VELOCITY + axis] == pytest.approx(plane[at.ANGULAR_VELOCITY + 2], rel=1e-13)
    turned = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3) @ R.T
    np.testing.assert_allclose(rotation_vector(turned), plane[at.ANGLE] * e, atol=2e-14)


def test_the_angle_of_the_plane_is_unwrapped() -> None:
    """10 rad/s for 2 s."""
    body = NativeBody(block(dimensions=2, mass=1.0, inertia=1.0, angular_velocity=10.0))
    for _ in range(400):
        body.step(0.005)
    assert body.orientation == pytest.approx(20.0, rel=1e-13)


# Prediction --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("d", [1, 2, 3])
def test_a_step_is_the_prediction_plus_compliance_times_force(d: int) -> None:
    """Position to the last bit; the plane's angle to rounding."""
    rng = np.random.default_rng(d)
    turns = {"inertia": 4e-5, "rotational_viscosity": 3e-4} if d > 1 else {}
    state = block(
        dimensions=d, mass=0.1, viscosity=0.8, integrator="implicit", gravity=rng.normal(size=d),
        position=rng.normal(size=d), velocity=rng.normal(size=d), **turns,
    )  # fmt: skip
    if d == 2:
        state[at.ANGLE], state[at.ANGULAR_VELOCITY + 2] = 0.3, 2.0
        at.orient(BodyState(state))
    body, T = NativeBody(state), 0.005
    for _ in range(5):
        f = rng.normal(size=d)
        push(state, f, (0, 0, 1e-3) if d == 2 else ())
        body.free_motion(T)
        ahead = state.copy()
        body.step(T)
        assert ahead[at.COMPLIANCE] == pytest.approx(T * T / (0.1 + T * 0.8), rel=1e-15)
        expected = ahead[at.NEXT_POSITION : at.NEXT_POSITION + d] + ahead[at.COMPLIANCE] * f
        np.testing.assert_array_equal(state[at.POSITION : at.POSITION + d], expected)
        if d == 2:
            R = ahead[at.NEXT_ROTATION : at.NEXT_ROTATION + 9].reshape(3, 3)
            angle = math.atan2(R[1, 0], R[0, 0]) + ahead[at.ROTATIONAL_COMPLIANCE + 8] * 1e-3
            assert math.remainder(state[at.ANGLE] - angle, 2 * math.pi) == pytest.approx(0.0, abs=1e-15)
            assert ahead[at.ROTATIONAL_COMPLIANCE + 8] == pytest.approx(T * T / (4e-5 + T * 3e-4), rel=1e-15)


@pytest.mark.parametrize("free", [(1, 1, 1), (1, 0, 1), (0, 1, 0)])
def test_in_space_the_prediction_holds_to_first_order(free: tuple[int, ...]) -> None:
    """R+ = exp(C m) R_next but for T |w| and C |m| times that turn; C = T^2 (I + T b_w)^-1 on the free axes."""
    rng = np.random.default_rng(9)
    T, b = 0.005, 3e-4
    w, moment = 2.0 * rng.normal(size=3) * free, 1e-3 * rng.normal(size=3)
    state = block(**SPACE, integrator="implicit", free=(1, 1, 1, *free), orientation=unit(rng), angular_velocity=w)
    axes = np.flatnonzero(free)
    expected = np.zeros((3, 3))
    expected[np.ix_(axes, axes)] = T * T * np.linalg.inv((world_inertia(state) + T * b * np.eye(3))[np.ix_(axes, axes)])
    body = NativeBody(push(state, (), moment))
    body.free_motion(T)
    ahead = state.copy()
    body.step(T)
    C = ahead[at.ROTATIONAL_COMPLIANCE : at.ROTATIONAL_COMPLIANCE + 9].reshape(3, 3)
    np.testing.assert_allclose(C, expected, rtol=1e-13, atol=1e-18)
    np.testing.assert_allclose(
        state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3],
        ahead[at.NEXT_ANGULAR_VELOCITY : at.NEXT_ANGULAR_VELOCITY + 3] + C @ moment / T,
        atol=1e-14,
    )
    turned = (
        state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
        @ ahead[at.NEXT_ROTATION : at.NEXT_ROTATION + 9].reshape(3, 3).T
    )
    turn = C @ moment
    small = (T * np.linalg.norm(w) + np.linalg.norm(turn)) * np.linalg.norm(turn)
    assert np.linalg.norm(rotation_vector(turned) - turn) < small
    assert np.linalg.norm(turn) > 1e-4


def test_a_prediction_leaves_the_state_and_locked_axes_alone() -> None:
    rng = np.random.default_rng(10)
    for free in ((0, 1, 0, 0, 1, 0), (0, 0, 0, 0, 0, 0)):
        state = block(
            **SPACE, integrator="implicit", free=free, position=(1, 2, 3), orientation=unit(rng), gravity=(1, 1, 1)
        )
        before = state.copy()
        NativeBody(state).free_motion(0.005)
        np.testing.assert_array_equal(state[: at.NEXT_POSITION], before[: at.NEXT_POSITION])
        np.testing.assert_array_equal(state[at.NEXT_POSITION + np.array([0, 2])], [1.0, 3.0])
        assert state[at.NEXT_POSITION + 1] == (2.0 if not free[1] else state[at.NEXT_POSITION + 1])
        if not any(free):
            np.testing.assert_array_equal(
                state[at.NEXT_ROTATION : at.NEXT_ROTATION + 9], state[at.ROTATION : at.ROTATION + 9]
            )


@pytest.mark.parametrize("integrator", ["explicit", "semi-implicit", "exact"])
def test_only_the_implicit_integrator_predicts(integrator: str) -> None:
    with pytest.raises(InputError, match=f"given '{integrator}'"):
        NativeBody(block(dimensions=1, mass=1.0, integrator=integrator)).free_motion(0.005)


# Viscosity ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_viscosity_slows_the_body_below_the_limit_that_scenes_are_checked_for(integrator: str, d: int) -> None:
    """b T/m = 1.9 and 2.1, in translation and in rotation; a thousand for those that take any."""
    turns: list[dict[str, Any]] = [
        {},
        {"inertia": 4e-5, "angular_velocity": 1.0},
        {"inertia": MOMENTS, "angular_velocity": (1.0, 0.0, 0.0)},
    ]
    for z in (1.9, 2.1, 1000.0):
        least = 4e-5 if d == 2 else MOMENTS[0]
        T = 0.005
        for slow in ("viscosity", "rotational_viscosity")[: 1 if d == 1 else 2]:
            b = z * (0.1 if slow == "viscosity" else least) / T
            state = block(
                dimensions=d, mass=0.1, integrator=integrator, velocity=[1.0] * d, **turns[d - 1], **{slow: b}
            )
            stable = z < VISCOUS_LIMIT or integrator in ("exact", "implicit")
            for _ in range(100 if d < 3 or z < 100 else 2):
                at.step(BodyState(state), T)
            o = at.VELOCITY if slow == "viscosity" else at.ANGULAR_VELOCITY + (2 if d == 2 else 0)
            assert bool(abs(state[o]) < 1e-3) is stable


@pytest.mark.parametrize("d", [2, 3])
def test_what_is_kept_of_the_exact_step_follows_its_parameters(d: int) -> None:
    state = block(dimensions=d, mass=0.1, inertia=0.02, integrator="exact", viscosity=0.3, rotational_viscosity=0.01)
    push(state, np.full(d, 0.4))
    at.step(BodyState(state.data), 0.01)
    for entry, value in ((at.VISCOSITY, 0.0), (at.ROTATIONAL_VISCOSITY, 0.5), (at.MASS, 3.0)):
        state[entry] = value
        anew = state.copy()
        anew[at.DECAY :] = 0.0  # nothing kept
        for T in (0.01, 0.02):
            at.step(BodyState(state.data), T)
            at.step(BodyState(anew.data), T)
            assert state[: at.DECAY].tobytes() == anew[: at.DECAY].tobytes()
