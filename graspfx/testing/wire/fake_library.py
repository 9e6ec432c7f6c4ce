"""A stand-in for a vendor's library of C functions, written in LLVM's language: no compiler is needed for it.

Where this machine has a compiler, it links a shared library that any program can load; the state of its devices is a
file that all of them share. Else the functions are machine code in this process.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from graspfx.compile.emission import address, emitted, loaded
from graspfx.testing.wire.c_compiler import compiler
from graspfx.testing.wire.linking import shared

DEVICES = 4
STATUS = 17  # entries of dhdGetStatus
TEXT = 64


class Function(NamedTuple):
    """A function of the library: counted, with a return code that can be set, and what it copies.

    Args:
        arguments: in their order, each as LLVM's type and what becomes of it: "id" picks the device, "in FIELD" is
            stored, "out FIELD" is loaded into where the argument points, "serial" picks a device by its number.
        sets: fields of the device that it sets to a number.
        opens: whether it opens the device that it picks, and gives its id.
    """

    arguments: tuple[str, ...] = ("i8 id",)
    sets: tuple[tuple[str, int], ...] = ()
    opens: bool = False


def _three(way: str, kind: str, field: str) -> tuple[str, ...]:
    return *(f"{kind} {way} {field}{i}" for i in range(3)), "i8 id"


FUNCTIONS: Mapping[str, Function] = {
    "dhdGetDeviceCount": Function(()),
    "dhdGetAvailableCount": Function(()),
    "dhdOpen": Function((), opens=True),
    "dhdOpenSerial": Function(("i32 serial",), opens=True),
    "dhdOpenID": Function(opens=True),
    "dhdClose": Function(sets=(("owner", 0),)),
    "dhdStop": Function(sets=(("braking", 1), ("enabled", 0))),
    "dhdEnableForce": Function(("i8 in enabled", "i8 id"), (("braking", 0),)),
    "dhdSetMaxForce": Function(("double in max_force", "i8 id")),
    "dhdGetPosition": Function(_three("out", "double", "position")),
    "dhdGetLinearVelocity": Function(_three("out", "double", "velocity")),
    "dhdSetForce": Function(_three("in", "double", "force")),
    "dhdGetSerialNumber": Function(("i16 out serial", "i8 id")),
    "dhdGetSystemType": Function(),
    "dhdGetStatus": Function(("status", "i8 id")),
    "dhdEnableExpertMode": Function(()),
    "dhdDisableExpertMode": Function(()),
    "dhdGetWatchdog": Function(("i8 out watchdog", "i8 id")),
    "dhdSetWatchdog": Function(("i8 in watchdog", "i8 id")),
    "dhdSetTimeGuard": Function(("i32 in guard", "i8 id")),
    "dhdErrorGetLast": Function(()),
}
NUMBERS = {name: k for k, name in enumerate(FUNCTIONS)}


class FakeDevice(ctypes.Structure):
    """The state of one device, which the functions work on."""

    _fields_ = (
        *((f"{name}{i}", ctypes.c_double) for name in ("position", "velocity", "force") for i in range(3)),
        ("max_force", ctypes.c_double),
        ("written", ctypes.c_int64 * 2),  # when the force was set last, by the monotonic clock [s, ns]
        ("calls", ctypes.c_int64 * len(FUNCTIONS)),
        ("codes", ctypes.c_int32 * len(FUNCTIONS)),  # that the functions return
        ("status", ctypes.c_int32 * STATUS),
        ("serial", ctypes.c_int32),
        ("owner", ctypes.c_int32),  # the process that has it open, 0 for none
        ("enabled", ctypes.c_int32),
        ("braking", ctypes.c_int32),
        ("watchdog", ctypes.c_int32),
        ("guard", ctypes.c_int32),
        ("text", ctypes.c_char * TEXT),
    )


FLOATS = {"max_force"} | {f"{name}{i}" for name in ("position", "velocity", "force") for i in range(3)}
SIZE = ctypes.sizeof(FakeDevice)

HEAD = """
@page = internal global ptr null
@path = private constant [{length} x i8] c"{path}\\00"
declare i32 @open(ptr, i32, ...)
declare ptr @mmap(ptr, i64, i32, i32, i32, i64)
declare i32 @clock_gettime(i32, ptr)
declare i32 @getpid()
declare i32 @kill(i32, i32)

define internal ptr @device(i8 %id) {{
  %old = load ptr, ptr @page
  %none = icmp eq ptr %old, null
  br i1 %none, label %map, label %ready
map:
  %file = call i32 (ptr, i32, ...) @open(ptr @path, i32 2)
  %new = call ptr @mmap(ptr null, i64 {bytes}, i32 3, i32 1, i32 %file, i64 0)
  store ptr %new, ptr @page
  br label %ready
ready:
  %start = load ptr, ptr @page
  %negative = icmp slt i8 %id, 0
  %own = select i1 %negative, i8 0, i8 %id
  %wide = zext i8 %own to i64
  %which = urem i64 %wide, {devices}
  %offset = mul i64 %which, {size}
  %device = getelementptr i8, ptr %start, i64 %offset
  ret ptr %device
}}

define internal i32 @enter(ptr %device, i64 %number) {{
  %count = getelementptr i8, ptr %device, i64 {calls}
  %at = getelementptr i64, ptr %count, i64 %number
  %old = load i64, ptr %at
  %new = add i64 %old, 1
  store i64 %new, ptr %at
  %codes = getelementptr i8, ptr %device, i64 {codes}
  %place = getelementptr i32, ptr %codes, i64 %number
  %code = load i32, ptr %place
  ret i32 %code
}}

define internal i1 @free(ptr %device) {{
  %at = getelementptr i8, ptr %device, i64 {owner}
  %owner = load i32, ptr %at
  %nobody = icmp eq i32 %owner, 0
  br i1 %nobody, label %yes, label %ask
ask:
  %answer = call i32 @kill(i32 %owner, i32 0)
  %dead = icmp ne i32 %answer, 0
  ret i1 %dead
yes:
  ret i1 1
}}

define ptr @dhdErrorGetLastStr() {{
  %device = call ptr @device(i8 0)
  %text = getelementptr i8, ptr %device, i64 {text}
  ret ptr %text
}}
"""


def _offset(field: str) -> int:
    return int(getattr(FakeDevice, field).offset)


def _source(state: Path) -> str:
    """Write the library, for devices whose state is in a file."""
    head = HEAD.format(
        length=len(str(state)) + 1,
        path=state,
        bytes=DEVICES * SIZE,
        devices=DEVICES,
        size=SIZE,
        **{name: _offset(name) for name in ("calls", "codes", "owner", "text")},
    )
    return head + "\n".join(_definition(name, function) for name, function in FUNCTIONS.items())


def _definition(name: str, function: Function) -> str:
    """Write a function of the library."""
    kinds = [_kind(argument) for argument in function.arguments]
    lines = [f"define i32 @{name}({', '.join(f'{kind} %a{i}' for i, kind in enumerate(kinds))}) {{"]
    device = next((f"%a{i}" for i, argument in enumerate(function.arguments) if argument == "i8 id"), "0")
    if function.opens and device == "0":
        lines += _choice("%a0" if function.arguments else None)
        device = "%id"
    lines += [
        f"  %device = call ptr @device(i8 {device})",
        f"  %code = call i32 @enter(ptr %device, i64 {NUMBERS[name]})",
        "  %bad = icmp slt i32 %code, 0",
        "  br i1 %bad, label %out, label %go",
        "out:",
        "  ret i32 %code",
        "go:",
    ]
    for i, argument in enumerate(function.arguments):
        lines += _copy(i, argument)
    for field, value in function.sets:
        lines += [*_at(f"s_{field}", field), f"  store i32 {value}, ptr %s_{field}"]
    if name == "dhdSetForce":
        lines += [*_at("time", "written"), "  %done = call i32 @clock_gettime(i32 1, ptr %time)"]
    if name in ("dhdGetDeviceCount", "dhdGetAvailableCount"):
        lines.append(f"  ret i32 {DEVICES}")
    elif function.opens:
        lines += _opening(device)
    else:
        lines.append("  ret i32 %code")
    return "\n".join([*lines, "}", ""])


def _kind(argument: str) -> str:
    if argument == "status" or " out " in argument:
        return "ptr"
    return argument.split()[0]


def _at(name: str, field: str) -> list[str]:
    return [f"  %{name} = getelementptr i8, ptr %device, i64 {_offset(field)}"]


def _copy(i: int, argument: str) -> list[str]:
    """Write what becomes of an argument."""
    if argument == "status":
        return [
            *_at("status", "status"),
            *(
                line
                for k in range(STATUS)
                for line in (
                    f"  %f{k} = getelementptr i32, ptr %status, i64 {k}",
                    f"  %v{k} = load i32, ptr %f{k}",
                    f"  %t{k} = getelementptr i32, ptr %a{i}, i64 {k}",
                    f"  store i32 %v{k}, ptr %t{k}",
                )
            ),
        ]
    kind, _, rest = argument.partition(" ")
    way, _, field = rest.partition(" ")
    if way not in ("in", "out"):
        return []
    inside = "double" if field in FLOATS else "i32"
    lines, value = _at(f"p{i}", field), f"%a{i}"
    if way == "in":
        if kind != inside:
            lines.append(f"  %w{i} = zext {kind} %a{i} to {inside}")
            value = f"%w{i}"
        return [*lines, f"  store {inside} {value}, ptr %p{i}"]
    lines.append(f"  %w{i} = load {inside}, ptr %p{i}")
    value = f"%w{i}"
    if kind != inside:
        lines.append(f"  %n{i} = trunc {inside} %w{i} to {kind}")
        value = f"%n{i}"
    return [*lines, f"  store {kind} {value}, ptr %a{i}"]


def _choice(serial: str | None) -> list[str]:
    """Write the choice of a device: by its serial number, or the first that is free."""
    lines, best = [], "-1"
    for k in reversed(range(DEVICES)):
        lines += [
            f"  %d{k} = call ptr @device(i8 {k})",
            f"  %q{k} = getelementptr i8, ptr %d{k}, i64 {_offset('serial')}",
            f"  %s{k} = load i32, ptr %q{k}",
            f"  %y{k} = icmp eq i32 %s{k}, {serial}" if serial else f"  %y{k} = call i1 @free(ptr %d{k})",
            f"  %c{k} = select i1 %y{k}, i8 {k}, i8 {best}",
        ]
        best = f"%c{k}"
    return [
        *lines,
        f"  %id = add i8 {best}, 0",
        "  %lost = icmp slt i8 %id, 0",
        "  br i1 %lost, label %nothing, label %something",
        "nothing:",
        "  ret i32 -1",
        "something:",
    ]


def _opening(device: str) -> list[str]:
    """Write the opening of a device that is free."""
    return [
        "  %open = call i1 @free(ptr %device)",
        "  br i1 %open, label %take, label %refuse",
        "refuse:",
        "  ret i32 -1",
        "take:",
        "  %process = call i32 @getpid()",
        *_at("whose", "owner"),
        "  store i32 %process, ptr %whose",
        f"  %number = sext i8 {device} to i32",
        "  ret i32 %number",
    ]


def library(state: Path, folder: Path) -> Any:
    """Make the library: the path of a shared one where there is a compiler, else an object with its functions."""
    text = _source(state)
    if compiler() is not None:
        return str(shared(text, folder, "libdrd.so"))
    return Functions(text)


class Functions:
    """The library's functions in this process, by their names, as ctypes shows those of a shared library."""

    def __init__(self, text: str) -> None:
        self._engine = loaded([emitted(text)], ())
        for name, function in FUNCTIONS.items():
            kinds = [CTYPES[_kind(argument)] for argument in function.arguments]
            setattr(self, name, ctypes.CFUNCTYPE(ctypes.c_int, *kinds)(address(self._engine, name)))
        last = address(self._engine, "dhdErrorGetLastStr")
        self.dhdErrorGetLastStr = ctypes.CFUNCTYPE(ctypes.c_char_p)(last)


CTYPES: Mapping[str, Any] = {
    "i8": ctypes.c_byte,
    "i16": ctypes.c_short,
    "i32": ctypes.c_int,
    "double": ctypes.c_double,
    "ptr": ctypes.c_void_p,
}
