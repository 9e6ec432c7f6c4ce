"""Every argument of every public name, given what it cannot use: an error of GraspFX, or a number, but never NaN."""

from __future__ import annotations

import itertools
import math
import string
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import graspfx as gx
from graspfx.errors import InputError
from graspfx.objects import integrators as at
from graspfx.objects.body import fill_body
from graspfx.surfaces.closed_form import shape
from graspfx.surfaces.triangles.mesh import make_mesh
from tests.support.bad_values import bad_values, outcome
from tests.support.families import efforts, family

FAMILY = family("inputs: refused or used", "an error of GraspFX, or no NaN")

POINTS = np.array([[0.05, 0.0, 0.0], [-0.02, 0.04, 0.0], [-0.02, -0.04, 0.01]])
NORMALS = -POINTS
CORNERS = 0.05 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
NOW = 0.5  # stands for the next second
STATES = (np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[100.0]]))
DEVICE = {"mass": 0.1, "damping": 0.2, "period": 0.005}
OBJECT = {"object_mass": 0.1, "object_damping": 0.8}

Target = tuple[Callable[..., Any], dict[str, Any]]


def body(**arguments: Any) -> np.ndarray:
    state = np.zeros(at.SIZE)
    fill_body(state, **arguments)
    return state


def parts(split: gx.Split) -> tuple[Any, ...]:
    return split.external, split.internal_basis, split.condition


def targets() -> dict[str, Target]:
    """A call of every public name with good arguments, each of which is then spoilt."""
    grasp = gx.Grasp(POINTS, NORMALS)
    soft = gx.Grasp(POINTS, NORMALS, model="soft")
    split, law = grasp.split(), gx.Coupling(gx.Impedance(30.0), gx.Impedance(70.0, 1.0))
    K, e, scene = 100.0 * np.eye(9), np.full(9, 1e-3), gx.load("reference-1dof")
    mesh, box = make_mesh(CORNERS, FACES), shape.Box((0.1, 0.1, 0.1))
    linear: dict[str, Any] = {
        "period": 0.005, "mass": 0.1, "friction": 0.2, "G": np.array([[1.0, 1.0]]), "inertia": 0.1, "viscosity": 0.8,
        "stiffness": 50.0, "damping": 0.1, "hand_stiffness": 33.0, "hand_damping": 0.1, "delay": 0, "object_delay": 0,
        "integrator": "exact", "preload": np.zeros((3, 3)), "G_displacement": np.array([[1.0, 1.0]]),
        "rate": "difference",
    }  # fmt: skip
    s, p = gx.stability, gx.passivity
    impedance, rec = gx.ObjectImpedance(np.eye(6), point=np.zeros(3)), gx.run("sphere-three-fingers", duration=0.02)
    feedback, clock = gx.Feedback(fingers=3), itertools.count(1)
    return {
        "divide": (gx.divide, {"grasp": grasp, "force": np.ones((3, 3)), "kind": "stiffness", "stiffness": np.ones(3)}),
        "divide many sets": (gx.divide, {"grasp": gx.Grasp(np.stack([POINTS, 2.0 * POINTS])), "force": np.ones(9)}),
        "least_friction": (gx.least_friction, {"grasp": grasp, "wrench": [0.0, 0.0, -0.1, 0.0, 0.0, 0.0],
                                               "normal_force": 2.0}),
        "PointCoupling": (lambda **k: gx.PointCoupling(gx.Impedance(30.0), gx.Impedance(70.0), **k).engine,
                          {"fingers": 3, "dimensions": 3, "tolerance": 1e-12, "engine": "auto"}),
        "Coupling.turned": (gx.Coupling(gx.Impedance(np.eye(3)), gx.Impedance(70.0)).turned, {"R": np.eye(3)}),
        "ObjectImpedance.turned": (impedance.turned, {"R": np.eye(3)}),
        "ObjectImpedance.about": (impedance.about, {"origin": np.zeros(3)}),
        "Feedback": (gx.Feedback, {"push_gain": np.eye(3), "squeeze_gain": 1.0, "moment_gain": 1.0, "fingers": 3,
                                   "fade": 0.05, "largest": 1e3, "engine": "auto"}),
        "Feedback.update": (lambda time, **k: feedback.update(time=next(clock) if time is NOW else time, **k).push, {
            "points": POINTS, "forces": NORMALS, "time": NOW, "normals": NORMALS, "torques": np.zeros((3, 3)),
            "finger": [0, 1, 2], "reference": np.zeros(3)}),
        "Recording.part": (lambda **k: rec.part(**k).finger_position, {"first": 2, "stop": 5}),
        "Recording.read": (rec.read, {"column": "finger_position", "first": 2, "stop": 5}),
        "stability.least_friction": (s.least_friction, {"mass": 0.1, "period": 0.005, **OBJECT, "stiffness": 30.0,
                                                        "margin": 1.5}),
        "stability.least_wall_friction": (s.least_wall_friction, {"mass": 0.1, "period": 0.005, "stiffness": 30.0,
                                                                  "margin": 1.5}),
        "stability.external_stable_map of gains": (s.external_stable_map, {"gain": [10.0, 20.0], **DEVICE, **OBJECT}),
        "grasp_matrix": (gx.grasp_matrix, {"points": POINTS, "normals": NORMALS, "model": "hard", "free": [True] * 6,
                                           "origin": np.zeros(3)}),
        "grasp_matrix frictionless": (gx.grasp_matrix, {"points": POINTS, "normals": NORMALS, "model": "frictionless"}),
        "Grasp frames": (lambda **k: gx.Grasp(**k).matrix,
                         {"points": POINTS, "frames": np.tile(np.eye(3), (3, 1, 1)), "model": "soft"}),
        "Grasp.metric": (soft.metric, {"torsion_length": 0.01, "weights": [1.0, 2.0, 3.0]}),
        "Grasp.split": (lambda **k: parts(grasp.split(**k)), {"metric": np.ones(9), "tolerance": 1e-6}),
        "Grasp.measures": (lambda **k: grasp.measures(**k).singular_values,
                           {"length": 0.1, "about": np.zeros(3), "torsion_length": 0.1}),
        "Grasp.force_closure": (lambda **k: grasp.force_closure(**k).closed, {"friction": 0.5, "torsion": 0.0}),
        "Grasp.margin": (lambda **k: grasp.margin(**k).reached,
                         {"friction": 0.5, "torsion": 0.0, "length": 0.05, "about": np.zeros(3), "tolerance": 1e-3}),
        "Grasp.virtual_linkage": (lambda **k: grasp.virtual_linkage(**k).rank,
                                  {"actuators": [(0, 1), (1, 2), (0, 2)], "tolerance": 1e-6}),
        "Split": (lambda **k: parts(gx.Split(**k)), {"G": grasp.matrix, "metric": np.ones(9), "tolerance": 1e-6}),
        "Split.divide": (split.divide, {"force": np.ones(9)}),
        "Split.internal_coordinates": (split.internal_coordinates, {"names": ["a", "b", "c"]}),
        "Impedance": (gx.Impedance, {"stiffness": 30.0, "damping": 1.0}),
        "Impedance per finger": (gx.Impedance, {"stiffness": [30.0, 20.0], "damping": np.eye(3)}),
        "Coupling": (gx.Coupling, {"external": law.external, "internal": law.internal, "form": "literal"}),
        "Coupling.force": (law.force, {"split": split, "e": e, "de": e}),
        "Coupling.stiffness": (law.stiffness, {"split": split}),
        "Coupling.damping": (law.damping, {"split": split}),
        "unilateral_force": (lambda **k: gx.unilateral_force(**k).force,
                             {"stiffness": K, "displacement": e, "normals": NORMALS, "friction": 0.5}),
        "unilateral_force frictionless": (lambda **k: gx.unilateral_force(**k).force,
                                          {"stiffness": K, "displacement": e, "normals": NORMALS, "friction": None}),
        "stability.wall_limit": (s.wall_limit, {**DEVICE, "spring": 33.0, "wall_damping": 0.1, "delay": 0,
                                                "spring_damping": 0.1}),
        "stability.external_limit": (s.external_limit, {
            **DEVICE, **OBJECT, "fingers": 2, "spring": 33.0, "integrator": "exact", "delay": 0, "object_delay": 0,
            "coupling_damping": 0.1, "spring_damping": 0.1}),
        "stability.stable_intervals": (s.stable_intervals, {
            **DEVICE, **OBJECT, "fingers": 2, "spring": 33.0, "integrator": "exact", "delay": 0, "object_delay": 0,
            "upper": 1e4}),
        "stability.wall_limit_map": (s.wall_limit_map, {**DEVICE, "mass": [0.1, 0.2], "spring": 33.0}),
        "stability.external_limit_map": (s.external_limit_map, {**DEVICE, **OBJECT, "mass": [0.1, 0.2]}),
        "stability.external_stable_map": (s.external_stable_map,
                                          {"gain": 100.0, **DEVICE, **OBJECT, "mass": [0.1, 0.2]}),
        "stability.spectral_radius": (lambda of: s.spectral_radius(of), {"of": scene}),
        "stability.modes": (lambda of: s.modes(of), {"of": scene}),
        "stability.loop_matrix": (lambda of: s.loop_matrix(of), {"of": s.Linearisation(**linear)}),
        "stability.Linearisation": (lambda **k: s.spectral_radius(s.Linearisation(**k)), linear),
        "stability.preloaded": (lambda **k: s.preloaded(**k).preload, {
            "contacts": POINTS, "displacement": 0.01 * POINTS, "force": POINTS, "centre": np.zeros(3),
            "free": [True] * 6, "reaction": "fingertip"}),
        "passivity.wall_limit": (p.wall_limit, {"damping": 0.2, "period": 0.005, "wall_damping": 0.1, "delay": 0.001}),
        "passivity.guaranteed_wall_limit": (p.guaranteed_wall_limit, {
            "damping": 0.2, "period": 0.005, "wall_damping": 0.1, "delay": 0.001}),
        "passivity.required_damping": (p.required_damping, {"H": STATES, "period": 0.005}),
        "passivity.required_damping of a number": (p.required_damping, {"H": 100.0, "period": 0.005}),
        "passivity.damping_margin": (p.damping_margin, {"H": STATES, "damping": 1.0, "period": 0.005}),
        "passivity.external_limit": (p.external_limit, {"damping": 0.2, "period": 0.005, "object_viscosity": 0.8,
                                                        "coupling_damping": 0.1}),
        "passivity.coupling_limits": (lambda **k: p.coupling_limits(**k).external, {
            "G": grasp.matrix, "damping": 0.2, "period": 0.005, "object_viscosity": 0.8, "external_damping": 0.1,
            "internal_damping": 0.1}),
        "passivity.leak_matrix": (p.leak_matrix, {"K": K, "G": grasp.matrix, "period": 0.005, "damping": np.eye(9)}),
        "passivity.leak_margin": (p.leak_margin, {"K": K, "G": grasp.matrix, "damping": 0.1, "object_viscosity": 0.8,
                                                  "period": 0.005, "coupling_damping": 0.1}),
        "passivity.grasp_display": (p.grasp_display, {"K": K, "G": grasp.matrix, "mass": 0.1, "viscosity": 0.8,
                                                      "period": 0.005, "damping": 0.1, "integrator": "exact"}),
        "passivity.quantised_wall": (p.quantised_wall, {"stiffness": 100.0, "damping": 0.1, "period": 0.005,
                                                        "friction": 0.1, "resolution": 1e-5, "delay": 0.0}),
        "passivity.quantised_wall_limit": (p.quantised_wall_limit, {"damping": 0.1, "period": 0.005, "friction": 0.1,
                                                                    "resolution": 1e-5}),
        "passivity.worst_motion": (lambda **k: p.worst_motion(**k).margin,
                                   {"H": STATES, "damping": 1.0, "period": 0.005, "samples": 20}),
        "fill_body in space": (body, {
            "dimensions": 3, "mass": 1.0, "inertia": [0.1, 0.1, 0.1], "viscosity": 1.0, "rotational_viscosity": 0.1,
            "integrator": "exact", "free": [True] * 6, "gravity": np.zeros(3), "position": np.zeros(3),
            "orientation": [0.0, 0.0, 0.0, 1.0], "velocity": np.zeros(3), "angular_velocity": np.zeros(3)}),
        "fill_body in the plane": (body, {
            "dimensions": 2, "mass": 1.0, "inertia": 0.1, "viscosity": 1.0, "rotational_viscosity": 0.1,
            "integrator": "exact", "free": [True] * 3, "gravity": np.zeros(2), "position": np.zeros(2),
            "orientation": 0.0, "velocity": np.zeros(2), "angular_velocity": 0.0}),
        "Box": (shape.Box, {"size": (0.1, 0.1, 0.1)}),
        "Sphere": (shape.Sphere, {"radius": 0.1}),
        "HalfSpace": (shape.HalfSpace, {"normal": (0.0, 0.0, 1.0)}),
        "Capsule": (shape.Capsule, {"radius": 0.1, "length": 0.2}),
        "Cylinder": (shape.Cylinder, {"radius": 0.1, "length": 0.2}),
        "Ellipsoid": (shape.Ellipsoid, {"semi_axes": (0.1, 0.2, 0.3)}),
        "Box.contact": (lambda **k: box.contact(**k).gap, {"points": POINTS, "faces": [0, 1, 2], "previous": POINTS,
                                                           "radius": 0.0}),
        "Box.inertia": (box.inertia, {"mass": 1.0, "d": 3}),
        "make_mesh": (lambda **k: make_mesh(**k).vertices, {"vertices": CORNERS, "faces": FACES, "scale": 1.0}),
        "Mesh.contact": (lambda **k: mesh.contact(**k).gap, {"points": POINTS, "state": None, "radius": 0.001}),
        "Mesh.mass_properties": (lambda **k: mesh.mass_properties(**k).inertia, {"mass": 1.0}),
        "load": (gx.load, {"name": "reference-1dof", "overrides": {}}),
        "Scene.replace": (scene.replace, {"overrides": {"period": 0.001}}),
        "run": (lambda **k: gx.run(**k).rows, {"scene": scene, "duration": 0.01}),
        "Recording.load": (gx.Recording.load, {"path": "no/such/file.h5"}),
        "testing.check_device": (gx.testing.check_device, {"device": None}),
        "testing.check_scene": (gx.testing.check_scene, {"scene": None}),
    }  # fmt: skip


TARGETS = targets()


@pytest.mark.parametrize("name", TARGETS)
def test_every_argument_of_every_public_name(name: str, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    call, good = TARGETS[name]
    assert name in ("Recording.load", "testing.check_device", "testing.check_scene") or not outcome(call, good)
    silent = []
    for key, value in good.items():
        for bad in bad_values(value):
            FAMILY.tried()
            found = outcome(call, {**good, key: bad})
            if found:
                silent.append(f"{key} = {bad!r:.60}: {found:.100}")
    assert not silent, "\n".join(silent)


ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(string.printable, max_size=4)
    | st.complex_numbers(),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=12,
)


@pytest.mark.filterwarnings("ignore:Do not use the `random` module")  # servers' threads of other tests draw numbers
@efforts(short=40, full=2500)
def test_arbitrary_values(cases: int, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = [(name, key) for name, (_, good) in TARGETS.items() if name != "Recording.load" for key in good]

    @settings(max_examples=cases, suppress_health_check=[HealthCheck.too_slow])
    @given(st.sampled_from(arguments), ANYTHING)
    def holds(argument: tuple[str, str], value: Any) -> None:
        name, key = argument
        call, good = TARGETS[name]
        FAMILY.tried()
        found = outcome(call, {**good, key: value})
        assert not found, f"{name}: {key} = {value!r}: {found}"

    holds()


def test_a_stiffness_too_large_for_its_products_is_refused() -> None:
    # forces of 1e197 m on 1 N/m were NaN without a word
    with pytest.raises(InputError, match="use at most 1e\\+40 in SI units"):
        gx.unilateral_force(np.eye(3), np.array([1e197, 0.0, 0.0]), [[1.0, 0.0, 0.0]], 0.5)


@pytest.mark.parametrize("bad", [np.ones((2, 2)) * 1j, np.array([["1.0", "2.0"]]), 10**400, [[1.0], [1.0, 2.0]]])
def test_what_is_no_array_of_real_numbers_is_refused_by_kind(bad: object) -> None:
    # numpy casts complex numbers and text with a warning or without, and raises its own errors for the others
    with pytest.raises(InputError, match=r"points: given .*, expected numbers in a rectangular array"):
        gx.grasp_matrix(bad)  # type: ignore[arg-type]


def test_directions_may_have_any_length() -> None:
    # 3-4-5 at sizes whose squares overflow or underflow, everywhere where a direction is taken
    for factor in (1e-300, 1.0, 1e300):
        touch = gx.unilateral_force(100.0 * np.eye(2), [0.003, 0.004], [[3.0 * factor, 4.0 * factor]])
        assert np.allclose(touch.force, [0.3, 0.4], rtol=1e-14)
        assert math.isclose(shape.HalfSpace((3.0 * factor, 4.0 * factor)).normal[0], 0.6, rel_tol=1e-15)


def test_a_delay_of_many_samples_is_refused_and_not_tried() -> None:
    """Matrices of that size would take all memory there is."""
    with pytest.raises(InputError, match="at most 1000"):
        gx.stability.Linearisation(
            period=0.005, mass=0.15, friction=0.2, G=np.ones((1, 1)), inertia=0.05 * np.eye(1),
            viscosity=0.4 * np.eye(1), stiffness=30.0 * np.eye(1), delay=100_000,
        )  # fmt: skip
