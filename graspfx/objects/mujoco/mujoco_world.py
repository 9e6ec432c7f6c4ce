"""Rigid bodies in one MuJoCo world, in space, in a plane or on a line, where they touch obstacles and one another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from graspfx.compile.calls import Call
from graspfx.compile.memory import zeros
from graspfx.compile.records import numbers
from graspfx.cones.cone import contact_frame
from graspfx.errors import InputError
from graspfx.objects import guest
from graspfx.objects import integrators as at
from graspfx.objects.body import FloatArray
from graspfx.objects.floor.floor import plane_of
from graspfx.objects.mujoco.geometry import Geometry, geometries
from graspfx.objects.mujoco.mujoco import MujocoCarrier, MujocoMember, mujoco, new_spec
from graspfx.objects.surroundings import Meeting, Member, Obstacle
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form import proxy

# Contact parameters with which bodies rest and grasps hold, as measured: docs/explanation/worlds.md.
IMPEDANCE = 0.9999  # MuJoCo's largest value: how much a contact acts as a constraint instead of a spring
SETTLING = 0.02  # time constant with which a penetration decays [s]
STICKING = 1e4  # ratio of a contact's tangential to its normal stiffness
ITERATIONS = 100
TOLERANCE = 1e-20
NO_FRICTION = 1e-5  # MuJoCo's smallest coefficient


class MujocoWorld(MujocoCarrier):
    """Bodies and obstacles in one MuJoCo world.

    MuJoCo's stiffness and damping are set so that one step removes a fraction of a contact's penetration, and stops the
    tangential motion of the contact if the force is within Coulomb's circular cone.

    Args:
        members: Bodies, as blocks filled by `fill_body` with shapes.
        obstacles: Fixed shapes, including concave meshes.
        meeting: Friction and restitution of all pairs of shapes, and whether the bodies collide with one another.

    Raises:
        MissingPackageError: If MuJoCo is not installed.
        InputError: If a shape is unbounded, or if a body with a shape has exactly two free rotations.
    """

    def __init__(self, members: Sequence[Member], obstacles: Sequence[Obstacle], meeting: Meeting) -> None:
        self._members, self._meeting = members, meeting
        self._count = 0  # number of shapes
        self._friction = meeting.friction if meeting.friction > NO_FRICTION else 0.0
        self._spec = spec = new_spec()
        _set_solver(spec)
        buffer = zeros(len(members) * guest.SIZE)
        parts = buffer.reshape(-1, guest.SIZE)
        carried = [MujocoMember(m.state, part, spec, i) for i, (m, part) in enumerate(zip(members, parts, strict=True))]
        for member, one in zip(members, carried, strict=True):
            _require_joints(member, one)
        shapes = [
            [self._add(one.shape_body, geometry, f"{i}") for geometry in _geometries(member, one.dimensions)]
            for i, (member, one) in enumerate(zip(members, carried, strict=True))
        ]
        for number, obstacle in enumerate(obstacles):
            for i, names in self._place(number, obstacle):
                self._meet(shapes[i], names)
        if meeting.collide:
            for i in range(len(members)):
                for j in range(i):
                    if not (carried[i].fixed and carried[j].fixed):
                        self._meet(shapes[i], shapes[j])
        super().__init__(buffer, carried, spec)

    def contact_wrench(self, number: int) -> FloatArray:
        """Return force and moment (about the body's centre) of all contacts of a body in the last step, (6,) [N, N m].

        Args:
            number: Index of the body among the members.
        """
        total = np.zeros(6)
        body = self.model.body(str(number)).id
        centre = self.data.xpos[body]
        force = np.zeros(6)
        for i, contact in enumerate(self.data.contact):
            owners = [int(self.model.geom_bodyid[geom]) for geom in contact.geom]
            if body not in owners:
                continue
            mujoco().mj_contactForce(self.model, self.data, i, force)
            push = (1.0 if owners[1] == body else -1.0) * (contact.frame.reshape(3, 3).T @ force[:3])
            total[:3] += push
            total[3:] += np.cross(contact.pos - centre, push)
        return total

    def _stepping(self) -> Call:
        friction, restitution = self._friction, self._meeting.restitution
        if friction == restitution == 0.0:
            return super()._stepping()
        return Call(ContactStep(mujoco(), self.model, self.data, friction, restitution), ())

    def _set_step(self, T: float) -> None:
        super()._set_step(T)
        share = -math.expm1(-T / SETTLING)
        d = IMPEDANCE
        self.model.pair_solref[:] = -share * d / (T * T), -d / T  # MuJoCo divides the first by d

    def _add(self, body: Any, geometry: Geometry, owner: str) -> str:
        """Add a shape to a MuJoCo body, and return the name of the shape."""
        spec = self._spec
        name = f"{owner}.{self._count}"
        self._count += 1
        settings: dict[str, Any] = {"pos": geometry.position, "quat": geometry.quaternion}
        if geometry.points is not None:
            mesh = spec.add_mesh(name=name, uservert=np.ravel(geometry.points).tolist())
            mesh.inertia = mujoco().mjtMeshInertia.mjMESH_INERTIA_CONVEX
            settings["meshname"] = name
        else:
            settings["size"] = geometry.size
        kind = getattr(mujoco().mjtGeom, f"mjGEOM_{geometry.kind}")
        body.add_geom(name=name, type=kind, contype=0, conaffinity=0, **settings)
        return name

    def _meet(self, shapes: Sequence[str], others: Sequence[str]) -> None:
        """Enable the contacts of each shape in `shapes` with each shape in `others`."""
        mu = self._friction
        for one in shapes:
            for other in others:
                self._spec.add_pair(
                    name=f"{one} {other}", geomname1=one, geomname2=other, condim=3 if mu > 0.0 else 1,
                    friction=[max(mu, NO_FRICTION)] * 2 + [NO_FRICTION] * 3,
                    solimp=(IMPEDANCE, IMPEDANCE, 1.0, 0.5, 1.0),
                )  # fmt: skip

    def _place(self, number: int, obstacle: Obstacle) -> Iterator[tuple[int, list[str]]]:
        """Add an obstacle's shapes to the world; yield each member's index and the shapes that the member can touch."""
        world, owner = self._spec.worldbody, f"obstacle {number}"
        d = int(self._members[0].state[at.DIMENSIONS])
        kind = getattr(obstacle.shape, "kind", None)
        if kind not in (proxy.HALF_SPACE, proxy.PLANE):
            names = [
                self._add(world, geometry.at(obstacle.position, obstacle.rotation), owner)
                for geometry in geometries(obstacle.shape, d, fixed=True)
            ]
            yield from ((i, names) for i in range(len(self._members)))
            return
        sides: dict[tuple[float, ...], str] = {}
        for i, member in enumerate(self._members):
            normal, _ = plane_of(obstacle, member.state[at.POSITION : at.POSITION + 3])
            side = tuple(normal.tolist())
            if side not in sides:
                n, first, second = np.reshape(list(numbers(contact_frame(Vector(*side), 3))), (3, 3))
                face = Geometry("PLANE", (0.0, 0.0, 1.0))
                sides[side] = self._add(
                    world, face.at(obstacle.position, np.stack([first, second, n], axis=1)), owner + str(len(sides))
                )
            yield i, [sides[side]]


def _geometries(member: Member, d: int) -> Iterator[Geometry]:
    """Yield the shapes of a member in the frame of its MuJoCo body, which in 2-D is not rotated at the start."""
    start = member.state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
    for geometry in geometries(member.shape, d):
        yield geometry.at(np.zeros(3), start) if d == 2 else geometry


def _set_solver(spec: Any) -> None:
    library, option = mujoco(), spec.option
    option.cone = library.mjtCone.mjCONE_ELLIPTIC
    option.solver = library.mjtSolver.mjSOL_NEWTON
    option.jacobian = library.mjtJacobian.mjJAC_DENSE
    option.enableflags = int(library.mjtEnableBit.mjENBL_DIAGEXACT)
    option.disableflags |= int(library.mjtDisableBit.mjDSBL_REFSAFE) | int(library.mjtDisableBit.mjDSBL_ISLAND)
    option.impratio = STICKING
    option.iterations, option.ls_iterations = ITERATIONS, ITERATIONS
    option.tolerance, option.ls_tolerance = TOLERANCE, 1e-3
    option.ccd_tolerance, option.ccd_iterations = 1e-12, 100


def _require_joints(member: Member, carried: MujocoMember) -> None:
    if member.shape is not None and len(carried.turns) == 2:
        raise InputError(
            "free", "two of three rotations", "none, one or three for a body with contacts",
            "native dynamics allow two on half-spaces and planes",
        )  # fmt: skip


ROUNDS = 30
ACCURACY = 1e-9  # relative to the largest lift: accuracy of the lifts


class ContactStep:
    """Function that steps a world whose contacts have friction, restitution or both.

    MuJoCo computes contact forces f such that y = A f + a0 - a_ref + R f lies in the dual friction cone and is
    orthogonal to f. Here A is the inverse inertia at the contacts, a0 the accelerations without contact forces, a_ref
    the reference accelerations, and R the regularisation. This class corrects a_ref in two cases:

    - By the dual cone, a contact that slides by y_t separates by the lift mu |y_t|, so that a box at 0.5 m/s hops 2 mm
      high. The lift is therefore subtracted from the normal reference, and the problem is solved again until the lift
      equals that of its solution. This solution obeys Coulomb's law (De Saxce and Feng 1998). If all contacts stick or
      separate, MuJoCo's first solution already obeys Coulomb's law.
    - A contact that closes at a normal velocity v < 0 separates at -e v or at the speed that removes its penetration,
      whichever is larger, and not at the sum of both speeds.

    Args:
        library: The package `mujoco`.
        model, data: Model and data of the world. Its only constraints are contacts, with three rows each, or one row
            without friction. The Jacobian is dense, and the normal reference is (share r/T - v)/T, where r is the
            penetration, v the normal velocity, T the period, and share the fraction of r that one step removes.
        friction: Coefficient of friction mu of every contact.
        restitution: Coefficient of restitution e of every contact.
    """

    def __init__(self, library: Any, model: Any, data: Any, friction: float, restitution: float) -> None:
        self._library, self._model, self._data = library, model, data
        self._friction, self._restitution = friction, restitution
        self._rows = 3 if friction > 0.0 else 1
        self._sliding = int(library.mjtConstraintState.mjCNSTRSTATE_CONE)
        self._lifts: FloatArray = np.zeros(0)

    def __call__(self) -> None:
        """Step the world once."""
        library, model, data = self._library, self._model, self._data
        library.mj_step1(model, data)
        library.mj_fwdAcceleration(model, data)
        if self._restitution > 0.0:
            self._bounce()
        library.mj_fwdConstraint(model, data)
        if self._friction > 0.0 and self._sliding in data.efc_state:
            self._slide()
        else:
            self._lifts = np.zeros(0)
        library.mj_Euler(model, data)

    def _bounce(self) -> None:
        """Raise the normal reference acceleration of each closing contact to that of restitution, if it is lower."""
        data, T = self._data, self._model.opt.timestep
        across, speeds = data.efc_aref[:: self._rows], data.efc_vel[:: self._rows]
        np.maximum(across, -(1.0 + self._restitution) / T * speeds, out=across, where=speeds < 0.0)

    def _slide(self) -> None:
        """Solve until the lifts agree with the solution; begin with the last step's lifts if their number is equal."""
        solve, model, data, rows = self._library.mj_fwdConstraint, self._model, self._data, self._rows
        aref, R, qacc = data.efc_aref, data.efc_R, data.qacc
        J = data.efc_J.reshape(len(aref), -1)
        across = aref[::rows]
        unlifted = across.copy()
        lifts = self._lifts
        if len(lifts) == len(across):
            across[:] = unlifted - lifts
            solve(model, data)
        for _ in range(ROUNDS):
            y = J @ qacc - aref + R * data.efc_force
            new = self._friction * np.hypot(y[1::rows], y[2::rows])
            settled = len(lifts) == len(new) and np.abs(new - lifts).max() <= ACCURACY * new.max()
            lifts = new
            if settled:
                break
            across[:] = unlifted - lifts
            solve(model, data)
        self._lifts = lifts
