"""Data of a page that itself runs a scene: memory of the scene, layout of rows, sliders, handles, stability limits."""

from __future__ import annotations

import gzip
import re
from base64 import b85encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.build import build
from graspfx.assembly.process.orders import FARTHEST, goal_places, guide_keys
from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.steering import Steering
from graspfx.compile import webassembly
from graspfx.compile.records import start_of
from graspfx.coupling.contacts import EXCESSIVE
from graspfx.coupling.grasp_state import GraspState
from graspfx.errors import InputError
from graspfx.live.certifier import Certifier, Verdict
from graspfx.live.guides import hand_name
from graspfx.live.sliders import Slider, live_keys, sliders, values_of, widened
from graspfx.loop import step_program
from graspfx.loop.arena import Arena
from graspfx.loop.columns import Layout
from graspfx.loop.servo import Servo, kernel_fault
from graspfx.loop.world import MOVER, OBJECT_, PLANT, SAFETY, STATION, ServoState
from graspfx.numeric import single
from graspfx.recording.header import Outcome, conclusion, description

if TYPE_CHECKING:
    from graspfx.compile.llvm.llvm import LlvmProgram
    from graspfx.recording.header import Header
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Writer = Callable[[Mapping[str, float]], FloatArray]

STOPS = 21  # number of tabulated values of a slider whose value is not itself an entry of the arena
PROBES = 33  # number of values at which stability is computed in a slider's range
HALVINGS = 12  # number of bisections of the interval in which stability is lost
CODES = 16  # end of the codes of a part's fault (exclusive); codes start at 1
PLACE = re.compile(r"\((?:[-+.\de]+, )*[-+.\de]+\)")  # in a fault's text: a position at the time when the page was made
PLAIN = bytes.maketrans(b"&<>", b",.:")  # replaces letters of base 85 that a page would have to escape
SQUEEZES = (-10.0, 10.0, 0.1)  # range and step of a hand's additional squeeze [mm]
AGREEMENT = 1e-12  # relative difference up to which a number agrees with the formula of its slider


def module() -> bytes:
    """Return the WebAssembly module that runs ticks; see `webassembly.module`."""
    return webassembly.module(step_program.program_key(), _program)


def _program() -> LlvmProgram:
    from graspfx.compile.llvm.llvm import llvm_program

    return llvm_program(step_program.source())


def running(scene: Scene, frames: int, presets: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Collect the data with which a page runs a scene.

    Args:
        scene: Scene whose hands have guides.
        frames: Number of ticks per drawn frame.
        presets: Values of sliders that a button sets, by the name of the button.

    Raises:
        InputError: If a part of the scene is plain Python, other software or hardware, if a key in a preset has no
            slider, or if a value in a preset is outside the slider's range.
    """
    verdict, numbers, margins = _margins(scene)
    parts = resolve(scene)
    with build(scene, live=live_keys(numbers)) as servo:
        arena = _whole(servo)
        memory = arena.memory.floats[: arena.memory.used]
        start = memory.copy()
        header = header_of(parts, servo.objects)
        return {
            "module": _packed(module()),
            "arena": _arena(start),
            "world": arena.offset, "width": servo.layout.width, "period": servo.period, "frames": frames,
            "row": _row(servo.layout, header),
            "grasps": _grasps(servo, arena),
            "faults": _faults(servo, arena),
            **_all_sliders(numbers, scene, _writer(numbers, scene, servo, start), start, margins),
            "judged": verdict.text,
            "presets": [_preset(name, values, numbers) for name, values in presets.items()],
            "handles": list(_handles(scene, parts, servo, arena)),
            "recording": {
                "head": description(servo.layout, header),
                "outcome": conclusion(Outcome(engine="webassembly", complete=True)),
            },
        }  # fmt: skip


def require_runnable(scene: Scene) -> None:
    """Raise InputError if a part of the scene is not a kernel of this package."""
    with build(scene, engine="interpreted") as servo:
        _whole(servo)


def _whole(servo: Servo) -> Arena:
    """Return the arena of a scene.

    Raises:
        InputError: If a part of the scene is not a kernel of this package.
    """
    arena = servo.arena
    others = {
        "a device in plain Python": arena.ports, "a body of other software (PyBullet, MuJoCo)": arena.guests,
        "a body in plain Python": arena.bodies, "a plant in plain Python": arena.plants,
        "a hand in plain Python": arena.tables, "a kernel of a plug-in": arena.foreign,
        "hardware": servo.hardware, "another program's object": [] if servo.host is None else [servo.host],
        "parts outside its memory": [] if arena.is_whole else [arena],
    }  # fmt: skip
    found = [text for text, those in others.items() if those]
    if found:
        raise InputError(
            "scene", f"a scene with {', '.join(found)}", "a scene of GraspFX's own devices, hands and bodies",
            'a page runs without Python: set `dynamics = "native"` and `device = "simulated"` where the '
            "scene allows it, or write the page of a recording: graspfx view RECORDING --html FILE",
        )  # fmt: skip
    return arena


def _packed(content: bytes) -> str:
    return b85encode(gzip.compress(content, 9, mtime=0)).translate(PLAIN).decode("ascii")


def _arena(numbers: FloatArray) -> dict[str, str]:
    """Encode an arena as its distinct numbers and, for each entry, the index of the entry's number.

    The text is short, because meshes contain many equal numbers.
    """
    found, places = np.unique(numbers.astype("<f8").view("<u8"), return_inverse=True)
    kind = "<u2" if len(found) < 1 << 16 else "<u4"
    return {"numbers": _packed(found.tobytes()), "places": _packed(places.astype(kind).tobytes()), "kind": kind[1:]}


# Rows -----------------------------------------------------------------------------------------------------------------


def _row(layout: Layout, header: Header) -> dict[str, Any]:
    """Return the index in a row at which each quantity of `live.frame` starts; -1 if the row does not contain it."""
    columns = layout.columns

    def place(*names: str) -> int:
        return next((columns[name].where.start for name in names if name in columns), -1)

    return {
        "tip": place("true_position", "finger_position"), "finger": place("finger_position"),
        "contact": place("contact_position"), "force": place("finger_force"), "touching": place("touching"),
        "status": place("status"), "saturated": place("saturated"), "gap": place("gap"),
        "objects": [
            {
                "position": place(f"objects/{name}/position"), "orientation": place(f"objects/{name}/orientation"),
                "frame": header.frames.get(name),
            }
            for name in layout.objects
        ],
    }  # fmt: skip


def _grasps(servo: Servo, arena: Arena) -> list[dict[str, Any]]:
    """Return, for each grasp, the positions of its state in the arena, its fingers and its object."""
    names = servo.layout.objects
    return [
        {
            "state": record.state, "fingers": [int(i) for i in part.fingers], "object": names.index(part.name),
            "fade": [record.state + start_of(GraspState, name) for name in ("fade_start", "fade_end")],
        }
        for record, part in zip(arena.world.grasps, servo.objects, strict=True)
    ]  # fmt: skip


def _faults(servo: Servo, arena: Arena) -> dict[str, Any]:
    """Return the positions in the arena at which a tick stores a fault, and the message for each fault code."""
    own = arena.place(arena.own)
    counts = {
        STATION: len(servo.parts.stations), OBJECT_: len(servo.objects), MOVER: len(servo.movers),
        PLANT: len(servo.plants), SAFETY: 1,
    }  # fmt: skip
    texts = {}
    for kind, count in counts.items():
        for index in range(count):
            before = ""
            for code in range(1, CODES):
                text = _fault(servo, kind, index, code)
                if text is None or (text == before and not (kind == OBJECT_ and code < EXCESSIVE)):
                    break  # code beyond the last code of the part
                texts[f"{kind} {index} {code}"] = before = PLACE.sub("(...)", text)
    names = "faulted", "tick", "kind", "index", "code"
    forces = [record.state + start_of(GraspState, "excess") for record in arena.world.grasps]
    return {"places": [own + start_of(ServoState, name) for name in names], "texts": texts, "forces": forces}


def _fault(servo: Servo, kind: int, index: int, code: int) -> str | None:
    if kind == OBJECT_ and code == EXCESSIVE:
        bound, name = servo.objects[index].grasped.state.force_bound, servo.objects[index].name
        return (
            f"the law gives a finger on {name} (force) N, above coupling.force_bound = {bound:g} N: "
            "a gain is too large for this depth or speed; all forces are zero"
        )
    try:
        return kernel_fault(servo.parts, kind, index, code)
    except (LookupError, AttributeError, ValueError):  # the part does not have this code
        return None


# Sliders --------------------------------------------------------------------------------------------------------------


def _preset(name: str, values: Mapping[str, float], numbers: Sequence[Slider]) -> dict[str, Any]:
    """Return the sliders that a button sets, and their values.

    Raises:
        InputError: If a key has no slider, or a value is outside the slider's range.
    """
    places = {each.key: i for i, each in enumerate(numbers)}
    if not isinstance(values, Mapping):
        raise InputError("presets", {name: values}, "values by key")
    for key, value in values.items():
        if key not in places:
            raise InputError("presets", {name: {key: value}}, f"keys with a slider: {', '.join(places)}")
        one, given = numbers[places[key]], single("presets", value, f"a number for {key}")
        if not one.least <= given <= one.most:
            raise InputError("presets", {name: {key: value}}, f"{key} from {one.least:g} to {one.most:g}")
    return {"name": name, "values": [[places[key], float(value)] for key, value in values.items()]}


def _all_sliders(
    numbers: Sequence[Slider], scene: Scene, written: Writer, start: FloatArray, margins: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the entries of the arena that each slider writes, and the entries that two sliders determine together.

    The latter are the gaps of an automatic fade, which depend on the stiffnesses kep and kip: each gap is
    max(floor, p + q c) with c = |1/kep - 1/kip| and constants floor, p and q, as in `assembly.grasps.set_fade`.

    Raises:
        InputError: If an entry depends on several sliders in another way.
    """
    found = [_slider(each, written, start) for each in numbers]
    owners: dict[int, list[int]] = {}
    for i, each in enumerate(found):
        for k in each.get("entries", ()):
            owners.setdefault(k, []).append(i)
    shared = {k: (who[0], who[1]) for k, who in owners.items() if len(who) == 2}
    if any(len(who) > 2 for who in owners.values()):
        raise InputError("scene", scene.title, "a scene in which each number depends on at most two sliders")
    together = []
    for a, b in sorted(set(shared.values())):
        entries = [k for k, pair in shared.items() if pair == (a, b)]
        fitted = _fit(numbers[a], numbers[b], entries, written)
        if fitted is None:
            both = f"{numbers[a].key} and {numbers[b].key}"
            expected = f"a scene in which only the gaps of a fade depend on both {both}"
            raise InputError("scene", scene.title, expected)
        together.append({"sliders": [a, b], "entries": fitted})
    for each in found:
        if any(k in shared for k in each.get("entries", ())):
            keep = [i for i, k in enumerate(each["entries"]) if k not in shared]
            each["entries"] = [each["entries"][i] for i in keep]
            each["table"] = [[row[i] for i in keep] for row in each["table"]]
            if not keep:
                del each["stops"], each["entries"], each["table"]
    return {
        "sliders": [each | {"margin": margins.get(slider.key)} for each, slider in zip(found, numbers, strict=True)],
        "together": together,
    }


def _fit(one: Slider, other: Slider, entries: list[int], written: Writer) -> list[list[float]] | None:
    """Fit max(floor, p + q |1/x - 1/y|) to each entry, as a function of the values x and y of two sliders.

    The result is a list of entry, floor, p and q, or None if the formula does not fit an entry.
    """
    if not all(each.key.endswith("stiffness") and each.least > 0.0 for each in (one, other)):
        return None
    places = [
        (one.least, other.most), (1.5 * one.least, other.most), (one.most, 0.999 * other.most),
        (one.most, other.least), (one.value, other.value), (3.0 * one.least, 2.0 * other.least),
    ]  # fmt: skip
    c = np.array([abs(1.0 / x - 1.0 / y) for x, y in places])
    table = np.array([written({one.key: x, other.key: y})[entries] for x, y in places])
    q = (table[0] - table[1]) / (c[0] - c[1])
    p, floor = table[0] - q * c[0], table[2]
    guess = np.maximum(floor, p + c[:, None] * q)
    if not np.allclose(guess, table, rtol=AGREEMENT, atol=0.0):
        return None
    return [[k, *map(float, each)] for k, each in zip(entries, zip(floor, p, q, strict=True), strict=True)]


def _slider(slider: Slider, written: Writer, start: FloatArray) -> dict[str, Any]:
    """Return the entries of the arena that a slider writes.

    An entry is the slider's value itself, a constant, or a number that is tabulated at stops in the slider's range. A
    slider with such numbers moves only to the stops. The page writes the same bits as `Session.set`.
    """
    low = slider.least if slider.least > 0.0 else slider.step
    probes = sorted({low, slider.value if slider.value > 0.0 else low, 0.5 * (slider.least + slider.most), slider.most})
    table, values = np.array([written({slider.key: v}) for v in probes]), np.array(probes)
    is_varied = (table != table[0]).any(axis=0)
    is_itself = is_varied & (table == values[:, None]).all(axis=0)
    rest = np.flatnonzero(is_varied & ~is_itself).tolist()
    always = np.flatnonzero(~is_varied & (table[0] != start)).tolist()
    about = slider.to_dict() | {
        "itself": np.flatnonzero(is_itself).tolist(), "always": [[k, float(table[0, k])] for k in always],
    }  # fmt: skip
    if rest:
        stops = np.linspace(low, slider.most, STOPS).tolist()
        about |= {"stops": stops, "entries": rest, "table": [written({slider.key: v})[rest].tolist() for v in stops]}
    return about


def _writer(numbers: Sequence[Slider], scene: Scene, servo: Servo, start: FloatArray) -> Writer:
    """Return a function that computes the arena after sliders are set during a run; it leaves the servo unchanged."""
    memory = servo.arena.memory.floats[: start.size]

    def written(values: Mapping[str, float]) -> FloatArray:
        own, changed = {**{each.key: each.value for each in numbers}, **values}, dict[str, Any]()
        for each in numbers:
            if each.key in values:
                changed |= values_of(each, numbers, own)
        steering = Steering(servo, scene, live_keys(numbers))
        servo.ticks = 1  # as in a run that has begun, so that moved parts keep their positions
        try:
            servo.write(steering.update(scene.replace(changed), changed))
            return memory.copy()
        finally:
            memory[:] = start
            servo.ticks = 0
            servo.watch.note()

    return written


def _margins(scene: Scene) -> tuple[Verdict, list[Slider], dict[str, list[list[float]]]]:
    """Compute the values of each slider at which the scene is unstable, with the other sliders at their present values.

    Returns:
        Stability of the scene, sliders of the scene, and unstable intervals of each slider, by the slider's key.
    """
    certifier = Certifier(scene)
    *_, verdict = certifier.stages({})
    numbers = [widened(each, verdict) for each in sliders(scene)]
    if verdict.is_stable is None:
        return verdict, numbers, {}
    found = {each.key: _unstable(certifier, each, numbers) for each in numbers}
    return verdict, numbers, {key: intervals for key, intervals in found.items() if intervals is not None}


def _unstable(certifier: Certifier, slider: Slider, others: Sequence[Slider]) -> list[list[float]] | None:
    """List the unstable intervals in a slider's range; return None if the stability of a value is unknown."""
    values = {each.key: each.value for each in others}

    def judge(value: float) -> bool | None:
        verdict = certifier.provisional(values_of(slider, others, values | {slider.key: value}))
        return None if verdict is None else verdict.is_stable

    least = slider.least if slider.least > 0.0 else slider.step
    places = np.linspace(least, slider.most, PROBES).tolist()
    stable = [judge(value) for value in places]
    if None in stable:
        return None
    edges = [slider.least]  # ends of intervals that are alternately stable and unstable
    for (a, is_a), (b, is_b) in pairwise(zip(places, stable, strict=True)):
        if is_a != is_b:
            low, high = a, b
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if judge(middle) == is_a else (low, middle)
            edges.append(0.5 * (low + high))
    return [list(each) for i, each in enumerate(pairwise([*edges, slider.most])) if stable[0] == bool(i % 2)]


# Handles --------------------------------------------------------------------------------------------------------------


def _handles(scene: Scene, parts: Parts, servo: Servo, arena: Arena) -> Iterator[dict[str, Any]]:
    """Yield each guided hand with the positions in the arena of its fingers' goals and of its additional squeeze."""
    places = goal_places(servo)
    for keys, place in zip(guide_keys(scene, servo), places, strict=True):
        first = arena.place(place.memory)
        yield {
            "name": hand_name(scene, keys.table, keys.fingers), "table": keys.table, "fingers": keys.fingers,
            "goals": [first + int(k) for k in place.entries[:-1]], "squeeze": first + int(place.entries[-1]),
            "start": parts.start[keys.fingers].tolist(), "farthest": FARTHEST,
            "squeezes": SQUEEZES,
        }  # fmt: skip
