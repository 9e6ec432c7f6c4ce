"""Plan of a run of a scene: steps of a tick that are executed or skipped, calls per tick, and engine, with reasons."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, NamedTuple

from graspfx.assembly.bodies import meeting
from graspfx.assembly.build import build
from graspfx.assembly.device_limits import forceless_text, hidden_text, limit_text
from graspfx.assembly.grasps import grasps
from graspfx.assembly.hands import descriptions, holdings
from graspfx.assembly.meshes import mesh_name
from graspfx.assembly.resolve import Parts, resolve
from graspfx.card import span
from graspfx.certificate.device_plan import Row, lateness_rows, loop_rows, moment_rows, safety_rows
from graspfx.certificate.notes import is_damped, why_not_gradual
from graspfx.compile.cache import folder_text
from graspfx.errors import GraspFXError, InputError, KernelError, SceneError, message
from graspfx.loop.engine import is_machine_code, kept_program, machine_codes
from graspfx.loop.servo import foreign, guests, looked_ahead
from graspfx.objects.dynamics_table import dynamics_of
from graspfx.scene.model import Scene
from graspfx.scene.tables.hand_tables import Moving
from graspfx.scene.tables.part_tables import Device, Object, ObjectImpedance, Placement
from graspfx.scene.tables.reading import listed
from graspfx.scene.tables.shapes import MeshShape

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo

INSTALL = "llvmlite is not installed: run `pip install llvmlite`"


class PlanRow(NamedTuple):
    """Row of a plan.

    Attributes:
        step: Name of a step of a tick.
        runs: Whether the step is executed.
        why: Method of the step, or the reason why it is executed or skipped.
    """

    step: str
    runs: bool
    why: str


def plan(scene: Scene) -> list[PlanRow]:
    """Return the start positions of fingers, the steps of a tick in order, and the packages that a run imports."""
    return [PlanRow(*row) for row in _rows(resolve(scene))]


def _rows(parts: Parts) -> Iterator[Row]:
    scene = parts.scene
    yield from _starts(parts)
    yield "read", True, _listing(_drivers(scene))
    yield _velocity(scene)
    yield from _host_rows(scene) if scene.host is not None else _law_rows(parts)
    yield from safety_rows(parts)
    yield from loop_rows(parts)
    yield "write", True, "the negative of each finger's force, recorded as displayed_force"
    yield from moment_rows(scene)
    yield from lateness_rows(parts)
    for thing in scene.object if scene.host is None else ():
        yield _of_object(scene, thing, "move"), True, _body(scene, thing)
        yield _of_object(scene, thing, "turn"), *_turn(scene, thing)
        if scene.obstacle or "world" in scene.model_fields_set or len(scene.object) > 1:
            yield _of_object(scene, thing, "meet"), *meeting(scene, thing)
    if scene.obstacle:
        yield "fingers on obstacles", False, "fingers pass through obstacles; only objects touch obstacles"
    yield _hand(scene)
    yield "record", True, "one row per recorded tick, written to disk in blocks outside the tick"
    yield "packages", True, f"{', '.join(packages(scene))}, and imports of the drivers"


def _host_rows(scene: Scene) -> Iterator[Row]:
    """Yield the steps of a tick that process forces from another program, the host."""
    host = scene.host
    assert host is not None
    yield "host", True, f"forces of {host.name!r}, another program; they fade after {host.silence:g} s without a sample"
    yield "predict between samples", host.predict != "hold", host.predict
    first = f"{host.tank:g} J each for push and squeeze, {host.tank_room:g} J at most"
    yield "tanks", host.tank > 0.0, first if host.tank > 0.0 else "host.tank = 0: the host may create energy"


def _law_rows(parts: Parts) -> Iterator[Row]:
    """Yield the steps of a tick that compute forces from the motion of the fingers and objects."""
    scene = parts.scene
    for thing in scene.object:
        yield _of_object(scene, thing, "predict"), *_prediction(thing)
    yield from _contact_points(parts)
    yield _fingertips(scene)
    yield _weights(parts)
    yield from _split(scene)
    yield _metric(scene)
    yield _impedance(scene)
    yield _pads(scene)
    yield _projection(scene)
    yield _gradual(scene)
    yield _torsion(scene)
    yield from _limits(parts)
    yield "reaction", True, f"acts at the {'fingertip' if scene.coupling.reaction == 'fingertip' else 'contact point'}"
    yield _energy(scene)


def packages(scene: Scene) -> list[str]:
    """List the packages that a run of the scene imports, except those for figures, tables and drivers."""
    names = ["numpy", "pydantic (scene)", "h5py (recording)"]
    tables = [holding.table for holding in holdings(scene)]
    if any(each.kind == "path" for hand in tables if isinstance(hand, Moving) for each in listed(hand.motion)):
        names.append("scipy (recorded path)")
    if any(isinstance(thing.shape, MeshShape) for thing in scene.object):
        names.append("trimesh (mesh)")
    engines = {dynamics_of(thing.dynamics).package for thing in scene.object}
    names += [f"{package} (dynamics)" for package in sorted(engines) if package]
    return names


def _starts(parts: Parts) -> Iterator[Row]:
    """Yield the start positions of fingers that are placed at a distance from the object along a direction."""
    for finger, name, place in zip(parts.scene.finger, parts.scene.finger_names, parts.start.tolist(), strict=True):
        if isinstance(finger.start, Placement):
            ball = f", a ball of {1e3 * finger.radius:g} mm" if finger.radius else ""
            where = ", ".join(f"{round(x, 12) + 0.0:.6g}" for x in place)  # neither a rounding error nor minus zero
            why = f"at {where} m, {1e3 * finger.start.gap:g} mm from the surface{ball}"
            yield f"start {name}", True, why


def _drivers(scene: Scene) -> list[str]:
    tables: list[Device] = [*scene.device, *(f.device for f in scene.finger if isinstance(f.device, Device))]
    return [table.name for table in tables]


def _listing(names: list[str]) -> str:
    counts = {name: names.count(name) for name in names}
    return ", ".join(f"{count} x {name}" for name, count in counts.items())


def _velocity(scene: Scene) -> Row:
    damped = is_damped(scene)
    return (
        "rate of displacement",
        damped,
        "for the damping of eq. (4)" if damped else "no damping: forces depend on positions only",
    )


def _prediction(thing: Object) -> tuple[bool, str]:
    if thing.dynamics == "native" and thing.integrator == "implicit":
        return True, "implicit: forces and the motion of the object are solved together"
    return False, "forces follow from the object's present state (integrator = 'implicit' would solve both at once)"


def _contact_points(parts: Parts) -> Iterator[Row]:
    scene = parts.scene
    if scene.coupling.contact == "attached":
        yield "contact points", False, "attached: contact points are fixed in the object and never release"
    else:
        shapes = [thing.shape for thing in scene.object if thing.shape is not None]
        kinds = sorted({shape.kind for shape in shapes if not isinstance(shape, MeshShape)})
        if kinds:
            yield "contact points", True, f"closed form on {' and '.join(kinds)}, a proxy that stays on its face"
        for part in parts.objects:
            if part.solid.mesh is not None:
                faces = f"{len(part.solid.mesh.mesh.faces):,} triangles"
                yield (
                    "contact points",
                    True,
                    f"adjacency walk on {mesh_name(part.table)}, {faces}; a box tree while free",
                )


def _fingertips(scene: Scene) -> Row:
    radii = [1e3 * finger.radius for finger in scene.finger if finger.radius > 0.0]
    if not radii:
        return "ball fingertips", False, "fingertips are points"
    sizes = span(radii, "mm")
    return "ball fingertips", True, f"{len(radii)} of {len(scene.finger)}, radius {sizes}: contact on the offset shape"


def _weights(parts: Parts) -> Row:
    scene, coupling = parts.scene, parts.scene.coupling
    if coupling.contact == "attached":
        return "fade", False, "attached: every finger stays in the split"
    if equal_gains(scene):
        reader = _weighed_by(scene)
        if not reader:
            return "fade", False, "equal gains: there is no split"
        return "fade", True, f"equal gains need no split, but {reader} fingers by their gap"
    if coupling.absent == "follow":
        return "fade", False, "absent = 'follow': a free finger stays in the split"
    if coupling.fade == "auto":
        states = {part.name: part.grasped.state for part in grasps(parts)}
        between = {f"{1e3 * s.fade_start:.3g} to {1e3 * s.fade_end:.3g} mm": name for name, s in states.items()}
        text = " or ".join(f"{each} of {name}" if len(between) > 1 else each for each, name in between.items())
        return "fade", True, f"auto: a free finger fades out of the split as its gap grows from {text}"
    low, high = (1e3 * gap for gap in coupling.fade)
    return "fade", True, f"a free finger fades out of the split as its gap grows from {low:g} to {high:g} mm"


def _weighed_by(scene: Scene) -> str:
    """Return why fingers are weighted although gains are equal, as subject and verb; empty if they are not."""
    if any(scene.coefficients):
        return "friction weights"
    if scene.coupling.passivity != "off":
        return "the energy ledger weights"
    if not _scalar(scene):
        return "gains per finger or matrices weight"
    return "the implicit integrator weights" if _is_implicit(scene) else ""


def _is_implicit(scene: Scene) -> bool:
    """Return whether the scene has an object with the implicit integrator."""
    return any(thing.dynamics == "native" and thing.integrator == "implicit" for thing in scene.object)


def _resplit(scene: Scene) -> str:
    """Return a text that says when the split is recomputed."""
    d = scene.dimensions
    for free in map(scene.free, scene.object):
        shifts, turns = free[:d], free[d:]
        if d > 1 and (any(shifts) != all(shifts) or any(turns) != all(turns)):
            return "in every sample: locked directions rotate relative to the object"
    if scene.coupling.contact == "attached":
        return "once: contacts are fixed in the object"
    return "when a contact has moved in the object"


def _split(scene: Scene) -> Iterator[Row]:
    if equal_gains(scene):
        why = "equal external and internal gains: the conventional method, eqs. (20)-(23)"
        if _is_implicit(scene) and _scalar(scene):
            basis = "the rigid modes of eq. (3) are the implicit integrator's unknowns"
            yield "split", True, f"{why}; but {basis}, computed {_resplit(scene)}"
        else:
            yield "split", False, why
        return
    yield "split", True, f"eq. (3), {_resplit(scene)}"
    turning = [thing for thing in scene.object if scene.turns(thing)]
    if turning:
        if scene.coupling.blend == "off":
            yield "split: rotation", True, "joins the external space at any arm of the contacts: blend = 'off'"
            return
        low, high = (1e3 * arm for arm in scene.coupling.blend)
        yield "split: rotation", True, f"joins the external space between {low:g} and {high:g} mm of arm"
    else:
        why = "a line has none" if scene.dimensions == 1 else "locked: forces that would rotate the object are internal"
        yield "split: rotation", False, why


def _impedance(scene: Scene) -> Row:
    coupling = scene.coupling
    if _scalar(scene):
        return "impedance", True, "eq. (4) with scalar gains: one projection of one vector"
    if isinstance(coupling.external, ObjectImpedance):
        return "impedance", True, "eq. (4) with the stiffness of the object, distributed over its fingers"
    return "impedance", True, f"eq. (4) with gains per finger or matrices, {coupling.form} form"


def _scalar(scene: Scene) -> bool:
    """Return whether each stiffness and damping of the coupling is a number."""
    gains = (scene.coupling.external, scene.coupling.internal)
    return all(isinstance(value, float) for each in gains for value in (each.stiffness, each.damping))


def _projection(scene: Scene) -> Row:
    if scene.coupling.contact == "attached":
        return "letting go", False, "attached: the contact is bilateral, no cone"
    if any(scene.coefficients):
        each_mu = ", ".join(f"{mu:g}" for mu in dict.fromkeys(scene.coefficients))
        law = "by Coulomb's law, or the associated law if that has no solution"
        why = f"fingers only push; friction mu = {each_mu} {law}"
        return "letting go", True, f"{why}; the column law of the recording states which of them"
    law = "holds where it touched" if scene.coupling.friction == "stick" else "slips freely"
    return "letting go", True, f"fingers only push, eqs. (24)-(26); a touching finger {law}"


def _gradual(scene: Scene) -> Row:
    why = why_not_gradual(scene)
    if why:
        return "damping by depth", False, why
    depth = 1e3 * scene.coupling.damping_depth
    return (
        "damping by depth",
        True,
        f"it grows to its value over {depth:g} mm of penetration depth, without a step at contact",
    )


def _pads(scene: Scene) -> Row:
    stiffness = [finger.pad.stiffness for finger in scene.finger if finger.pad is not None]
    if not stiffness:
        return "pads", False, "fingertips are rigid: no finger.pad"
    of = f"{min(stiffness):g}" if min(stiffness) == max(stiffness) else f"{min(stiffness):g} to {max(stiffness):g}"
    why = f"{len(stiffness)} of {len(scene.finger)} fingertips, f_n = k depth^1.5, k = {of} N/m^1.5"
    return "pads", True, f"{why}: depths are solved with the forces of eq. (4), in a few iterations"


def _metric(scene: Scene) -> Row:
    counts = scene.coupling.split
    if counts == "pseudoinverse":
        return "metric", False, "equal: all fingers have the same weight in the split"
    what = "its device's mass" if counts == "mass" else "its coupling.weights"
    return "metric", True, f"{counts}: a finger's weight is {what} over the mean, in the split and in the gains"


def _torsion(scene: Scene) -> Row:
    count = sum(finger.model == "soft" for finger in scene.finger)
    if not count:
        return "torsion", False, "hard fingers exert forces only"
    limit = ", at most mu rho f_n" if any(scene.coefficients) else ""
    why = f"{count} soft of {len(scene.finger)} fingers: about the normal{limit}; it acts on the object"
    return "torsion", True, f"{why}, but devices that display only forces do not display it"


def _limits(parts: Parts) -> Iterator[Row]:
    """Yield rows about the force limits of devices, devices that display no force, and limits that are not known."""
    scene, wired = parts.scene, parts.wires
    limits, hidden = limit_text(scene, wired), hidden_text(scene, wired)
    if parts.safety is not None:
        low, high = float(parts.safety.force.min()), float(parts.safety.force.max())
        own = f"{low:.4g} N" if low == high else f"{low:.4g} to {high:.4g} N"
        limits = f"{limits}; {own} by [safety]" if limits else f"{own} by [safety]"
    if limits:
        ways = {limits_inside(scene, thing) for thing in scene.object}
        way = "inside the projection, on cones truncated at the limit" if True in ways else ""
        way += ", or " if len(ways) > 1 else ""
        way += "scaled within the cones: internal forces first, without a change of the wrench" if False in ways else ""
        yield "limit", True, f"{limits}; {way}; before the reaction, so that the object receives what is displayed"
    else:
        yield "limit", False, "no device states a largest force"
    if silent := forceless_text(scene, wired):
        yield "display", False, f"no force is displayed by {silent}: the object receives it, but it is not felt"
    if hidden:
        why = "a reduction by its `write` is neither recorded nor applied to the object"
        yield "private limit", False, f"not visible: {hidden} states no largest force (features.peak_force); {why}"


def limits_inside(scene: Scene, thing: Object) -> bool:
    """Return whether the projection on friction cones also limits the forces on an object (see `limit.is_inside`)."""
    attached = scene.coupling.contact == "attached"
    if thing.dynamics == "native" and thing.integrator == "implicit":
        return False
    fingers = [i for i, k in enumerate(scene.finger_objects) if scene.object[k] is thing]
    if not attached and any(scene.coefficients[i] for i in fingers):
        return True
    padded = any(scene.finger[i].pad is not None for i in fingers)
    if padded and scene.coupling.friction == "stick" and not equal_gains(scene):
        return False
    return _scalar(scene)


def _energy(scene: Scene) -> Row:
    if scene.coupling.passivity == "off":
        return "energy", False, "coupling.passivity = 'off': no energy ledger, no passivity controller"
    why = "recorded for each object: energy of squeezing, translation and rotation, and of the object"
    if scene.coupling.passivity == "observe":
        return "energy", True, f"{why}; observed only"
    return (
        "energy",
        True,
        f"{why}; a mode that generates energy is damped by the smallest sufficient force, and fingers still only push",
    )


def _body(scene: Scene, thing: Object) -> str:
    if not any(scene.free(thing)[: scene.dimensions]):
        return f"{thing.dynamics}; every translation is locked"
    if thing.dynamics == "native":
        return f"native, {thing.integrator}"
    engine = dynamics_of(thing.dynamics)
    name = f"{engine.label}, with exact viscosity" if engine.integrator else engine.label
    ignored = f" (integrator = {thing.integrator!r} is ignored)" if "integrator" in thing.model_fields_set else ""
    return f"{name}{ignored}"


def _turn(scene: Scene, thing: Object) -> tuple[bool, str]:
    if scene.dimensions == 1:
        return False, "a line has no rotation"
    if not scene.turns(thing):
        return False, "every rotation is locked"
    return True, "angular velocity and orientation"


def _hand(scene: Scene) -> Row:
    simulated = [finger for finger in scene.finger if finger.hand is not None]
    if not simulated:
        return "hand", False, "no finger has a hand"
    return "hand", True, f"{len(simulated)} of {len(scene.finger)} fingers held; {'; '.join(descriptions(scene))}"


def _of_object(scene: Scene, thing: Object, step: str) -> str:
    return step if len(scene.object) == 1 else f"{step} {thing.name}"


def equal_gains(scene: Scene) -> bool:
    """Return whether external and internal gains are equal, as in the conventional method."""
    external, internal = scene.coupling.external, scene.coupling.internal
    if isinstance(external, ObjectImpedance):
        return False
    return external.stiffness == internal.stiffness and external.damping == internal.damping


# Calls and engine ----------------------------------------------------------------------------------------------------


def engine_plan(scene: Scene) -> list[PlanRow]:
    """Return the rows of a plan about calls per tick and the engine.

    The scene is assembled, but no tick is computed, and the program of all scenes is not compiled.

    Raises:
        SceneError: If the scene cannot be assembled, so that no run can begin.
    """
    try:
        with build(scene, engine="interpreted") as servo:
            return [PlanRow("calls", True, _calls(servo)), _engine(scene, servo)]
    except SceneError:
        raise
    except GraspFXError as error:
        raise scene.error([((), message(error))]) from error


def _calls(servo: Servo) -> str:
    world, ahead = servo.arena.world, looked_ahead(servo)
    why_ahead = "it is not a kernel" if len(ahead) == 1 else "they are not kernels"
    beforehand = f"; the targets of {', '.join(ahead)} are computed in advance, because {why_ahead}" if ahead else ""
    if not world.pauses:
        return f"one call for many ticks{beforehand}" if ahead else "all parts are kernels: one call for many ticks"
    called, moved = foreign(servo), guests(servo)
    calls = "two calls for each tick" if world.ports else "one call for each tick"
    why = [f"{_listed(called)} not {'a kernel' if len(called) == 1 else 'kernels'}"] if called else []
    why += [f"{_listed(moved)} moved by other software between ticks"] if moved else []
    return f"{calls}, because {' and '.join(why)}{beforehand}"


def _listed(parts: Collection[str]) -> str:
    return f"{', '.join(parts)} {'is' if len(parts) == 1 else 'are'}"


def _engine(scene: Scene, servo: Servo) -> PlanRow:
    says = "" if scene.engine == "auto" else ", as the scene requires"
    if scene.engine == "interpreted":
        return PlanRow("engine", True, f"interpreted{says}")
    if why := _obstacle(servo):
        if scene.engine == "auto":
            return PlanRow("engine", True, f"interpreted: {why}")
        return PlanRow("engine", False, f"cannot be compiled, although the scene requires it: {why}")
    program = kept_program()
    if program is None:
        where = f"compiled before the first tick, once per version and machine (`graspfx warmup`), into {folder_text()}"
    else:
        where = f"{1e-3 * program.size:.0f} kB in {program.place}"
    return PlanRow("engine", True, f"compiled{says}, by the program of all scenes: {where}")


def _obstacle(servo: Servo) -> str:
    """Return the reason why the scene cannot run with the compiled engine; empty if it can.

    Raises:
        KernelError: If a third-party kernel is invalid.
    """
    if not is_machine_code():
        return INSTALL
    try:
        machine_codes(servo.arena)
    except KernelError:
        raise
    except InputError as error:
        return message(error)
    return ""
