"""A stand-in for the OpenHaptics library (HD) in LLVM's language: its scheduler's thread calls one callback a period.

Where this machine has a compiler, it links a shared library that any program can load, as with `fake_library`; the
state of its devices is a file that all of them share. Else the functions are machine code in this process. Each process
has a scheduler of its own.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from graspfx.compile.emission import address, emitted, loaded
from graspfx.testing.wire.c_compiler import compiler
from graspfx.testing.wire.linking import shared

DEVICES = 3
BINS = 2048  # of a microsecond, of what the callback takes
DEVICE = 64  # words of a device
CURRENT, ERRORS, RATE, TURNS, VIOLATIONS, DEPTH, STACK, STALLED, LONGEST, STARTS = 1, 2, 19, 21, 22, 23, 24, 30, 31, 29
FIRST_BIN, FIRST_DEVICE = 32, 32 + BINS  # words
POSITION, VELOCITY, FORCE, PENDING, OWNER, ENABLED, FRAME, ERROR, NAME = 0, 3, 6, 9, 12, 13, 14, 15, 24
SIZE = FIRST_DEVICE + DEVICES * DEVICE  # words of the state
SIGNATURES: Mapping[str, tuple[Any, ...]] = {
    "hdInitDevice": (ctypes.c_uint, ctypes.c_char_p),
    "hdDisableDevice": (None, ctypes.c_uint),
    "hdMakeCurrentDevice": (None, ctypes.c_uint),
    "hdEnable": (None, ctypes.c_uint),
    "hdDisable": (None, ctypes.c_uint),
    "hdBeginFrame": (None, ctypes.c_uint),
    "hdEndFrame": (None, ctypes.c_uint),
    "hdGetDoublev": (None, ctypes.c_uint, ctypes.c_void_p),
    "hdSetDoublev": (None, ctypes.c_uint, ctypes.c_void_p),
    "hdScheduleAsynchronous": (ctypes.c_ulong, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ushort),
    "hdUnschedule": (None, ctypes.c_ulong),
    "hdSetSchedulerRate": (None, ctypes.c_ulong),
    "hdStartScheduler": (None,),
    "hdStopScheduler": (None,),
}

TEXT = """
@page = internal global ptr null
@callback = internal global ptr null
@data = internal global ptr null
@going = internal global i64 0
@inside = internal global i64 0
@thread = internal global i64 0
@path = private constant [{length} x i8] c"{path}\\00"
declare i32 @open(ptr, i32, ...)
declare ptr @mmap(ptr, i64, i32, i32, i32, i64)
declare i32 @clock_gettime(i32, ptr)
declare i32 @clock_nanosleep(i32, i32, ptr, ptr)
declare i32 @getpid()
declare i32 @kill(i32, i32)
declare i32 @strcmp(ptr, ptr)
declare i32 @pthread_create(ptr, ptr, ptr, ptr)
declare i32 @pthread_join(i64, ptr)
declare i64 @pthread_self()
declare i32 @pthread_setschedparam(i64, i32, ptr)

define internal ptr @word(i64 %i) {{
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
  %at = getelementptr i64, ptr %start, i64 %i
  ret ptr %at
}}
define internal ptr @field(i64 %device, i64 %field) {{
  %base = mul i64 %device, {device}
  %first = add i64 %base, {first_device}
  %i = add i64 %first, %field
  %at = call ptr @word(i64 %i)
  ret ptr %at
}}
define internal void @add(i64 %i) {{
  %at = call ptr @word(i64 %i)
  %old = load i64, ptr %at
  %new = add i64 %old, 1
  store i64 %new, ptr %at
  ret void
}}
define internal void @push(i64 %code) {{
  %count.at = call ptr @word(i64 {errors})
  %count = load i64, ptr %count.at
  %room = icmp slt i64 %count, 15
  br i1 %room, label %go, label %end
go:
  %new = add i64 %count, 1
  store i64 %new, ptr %count.at
  %i = add i64 %new, {errors}
  %at = call ptr @word(i64 %i)
  store i64 %code, ptr %at
  br label %end
end:
  ret void
}}
define internal void @violate() {{
  call void @add(i64 {violations})
  call void @push(i64 258)
  ret void
}}
define internal i64 @ok() {{
  %current.at = call ptr @word(i64 {current})
  %current = load i64, ptr %current.at
  %frame.at = call ptr @field(i64 %current, i64 {frame})
  %frame = load i64, ptr %frame.at
  %inside = load i64, ptr @inside
  %both = and i64 %frame, %inside
  %bad = icmp eq i64 %both, 0
  br i1 %bad, label %violation, label %fine
violation:
  call void @violate()
  ret i64 0
fine:
  ret i64 1
}}
define {{ i64, i32 }} @hdGetError() {{
  %count.at = call ptr @word(i64 {errors})
  %count = load i64, ptr %count.at
  %none = icmp eq i64 %count, 0
  br i1 %none, label %empty, label %pop
empty:
  ret {{ i64, i32 }} zeroinitializer
pop:
  %i = add i64 %count, {errors}
  %at = call ptr @word(i64 %i)
  %code = load i64, ptr %at
  %left = sub i64 %count, 1
  store i64 %left, ptr %count.at
  %result = insertvalue {{ i64, i32 }} zeroinitializer, i64 %code, 0
  ret {{ i64, i32 }} %result
}}
define internal i1 @free(i64 %device) {{
  %at = call ptr @field(i64 %device, i64 {owner})
  %owner = load i64, ptr %at
  %nobody = icmp eq i64 %owner, 0
  br i1 %nobody, label %yes, label %ask
ask:
  %process = trunc i64 %owner to i32
  %answer = call i32 @kill(i32 %process, i32 0)
  %dead = icmp ne i32 %answer, 0
  ret i1 %dead
yes:
  ret i1 1
}}
define i32 @hdInitDevice(ptr %name) {{
start:
  %unnamed = icmp eq ptr %name, null
  br label %turn
turn:
  %d = phi i64 [ 0, %start ], [ %next, %other ]
  %name.at = call ptr @field(i64 %d, i64 {name})
  br i1 %unnamed, label %state, label %compare
compare:
  %differs = call i32 @strcmp(ptr %name, ptr %name.at)
  %same = icmp eq i32 %differs, 0
  br i1 %same, label %state, label %other
state:
  %free = call i1 @free(i64 %d)
  br i1 %free, label %take, label %other
other:
  %next = add i64 %d, 1
  %more = icmp slt i64 %next, {devices}
  br i1 %more, label %turn, label %lost
take:
  %error.at = call ptr @field(i64 %d, i64 {error})
  %error = load i64, ptr %error.at
  %gone = icmp ne i64 %error, 0
  br i1 %gone, label %lost, label %open
open:
  %process = call i32 @getpid()
  %wide = sext i32 %process to i64
  %owner.at = call ptr @field(i64 %d, i64 {owner})
  store i64 %wide, ptr %owner.at
  %frame.at = call ptr @field(i64 %d, i64 {frame})
  store i64 0, ptr %frame.at
  %depth.at = call ptr @word(i64 {depth})
  store i64 0, ptr %depth.at
  %current.at = call ptr @word(i64 {current})
  store i64 %d, ptr %current.at
  %handle = trunc i64 %d to i32
  ret i32 %handle
lost:
  call void @push(i64 768)
  ret i32 -1
}}
define void @hdDisableDevice(i32 %handle) {{
  %d = zext i32 %handle to i64
  %owner.at = call ptr @field(i64 %d, i64 {owner})
  store i64 0, ptr %owner.at
  %enabled.at = call ptr @field(i64 %d, i64 {enabled})
  store i64 0, ptr %enabled.at
  br label %zero
zero:
  %i = phi i64 [ {force}, %0 ], [ %next, %zero ]
  %at = call ptr @field(i64 %d, i64 %i)
  store double 0.0, ptr %at
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, {owner}
  br i1 %more, label %zero, label %end
end:
  ret void
}}
define void @hdMakeCurrentDevice(i32 %handle) {{
  %d = zext i32 %handle to i64
  %current.at = call ptr @word(i64 {current})
  store i64 %d, ptr %current.at
  ret void
}}
define internal void @able(i64 %to) {{
  %current.at = call ptr @word(i64 {current})
  %d = load i64, ptr %current.at
  %at = call ptr @field(i64 %d, i64 {enabled})
  store i64 %to, ptr %at
  ret void
}}
define void @hdEnable(i32 %what) {{
  call void @able(i64 1)
  ret void
}}
define void @hdDisable(i32 %what) {{
  call void @able(i64 0)
  ret void
}}
define void @hdBeginFrame(i32 %handle) {{
  %d = zext i32 %handle to i64
  %frame.at = call ptr @field(i64 %d, i64 {frame})
  %frame = load i64, ptr %frame.at
  %inside = load i64, ptr @inside
  %out = icmp eq i64 %inside, 0
  %again = icmp ne i64 %frame, 0
  %bad = or i1 %out, %again
  br i1 %bad, label %violation, label %go
violation:
  call void @violate()
  ret void
go:
  store i64 1, ptr %frame.at
  %depth.at = call ptr @word(i64 {depth})
  %depth = load i64, ptr %depth.at
  %place = add i64 %depth, {stack}
  %top.at = call ptr @word(i64 %place)
  store i64 %d, ptr %top.at
  %deeper = add i64 %depth, 1
  store i64 %deeper, ptr %depth.at
  %current.at = call ptr @word(i64 {current})
  store i64 %d, ptr %current.at
  %error.at = call ptr @field(i64 %d, i64 {error})
  %error = load i64, ptr %error.at
  %wrong = icmp ne i64 %error, 0
  br i1 %wrong, label %tell, label %end
tell:
  call void @push(i64 %error)
  br label %end
end:
  ret void
}}
define void @hdEndFrame(i32 %handle) {{
  %d = zext i32 %handle to i64
  %frame.at = call ptr @field(i64 %d, i64 {frame})
  %frame = load i64, ptr %frame.at
  %none = icmp eq i64 %frame, 0
  br i1 %none, label %violation, label %look
look:
  %depth.at = call ptr @word(i64 {depth})
  %depth = load i64, ptr %depth.at
  %less = sub i64 %depth, 1
  %place = add i64 %less, {stack}
  %top.at = call ptr @word(i64 %place)
  %top = load i64, ptr %top.at
  store i64 0, ptr %frame.at
  store i64 %less, ptr %depth.at
  %nested = icmp eq i64 %top, %d
  br i1 %nested, label %go, label %crossed
crossed:
  call void @violate()
  br label %go
go:
  %enabled.at = call ptr @field(i64 %d, i64 {enabled})
  %enabled = load i64, ptr %enabled.at
  %on = icmp ne i64 %enabled, 0
  br label %turn
turn:
  %i = phi i64 [ 0, %go ], [ %next, %turn ]
  %from.i = add i64 %i, {pending}
  %to.i = add i64 %i, {force}
  %from.at = call ptr @field(i64 %d, i64 %from.i)
  %to.at = call ptr @field(i64 %d, i64 %to.i)
  %x = load double, ptr %from.at
  %shown = select i1 %on, double %x, double 0.0
  store double %shown, ptr %to.at
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, 3
  br i1 %more, label %turn, label %end
violation:
  call void @violate()
  br label %end
end:
  ret void
}}
define internal void @copy(ptr %to, ptr %from) {{
start:
  br label %turn
turn:
  %i = phi i64 [ 0, %start ], [ %next, %turn ]
  %from.at = getelementptr double, ptr %from, i64 %i
  %to.at = getelementptr double, ptr %to, i64 %i
  %x = load double, ptr %from.at
  store double %x, ptr %to.at
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, 3
  br i1 %more, label %turn, label %end
end:
  ret void
}}
define void @hdGetDoublev(i32 %what, ptr %to) {{
  %ok = call i64 @ok()
  %bad = icmp eq i64 %ok, 0
  br i1 %bad, label %end, label %go
go:
  %current.at = call ptr @word(i64 {current})
  %d = load i64, ptr %current.at
  %velocity = icmp eq i32 %what, 8273
  %field = select i1 %velocity, i64 {velocity}, i64 {position}
  %from = call ptr @field(i64 %d, i64 %field)
  call void @copy(ptr %to, ptr %from)
  br label %end
end:
  ret void
}}
define void @hdSetDoublev(i32 %what, ptr %from) {{
  %ok = call i64 @ok()
  %force = icmp eq i32 %what, 9984
  %bad = icmp eq i64 %ok, 0
  %other = xor i1 %force, 1
  %no = or i1 %bad, %other
  br i1 %no, label %end, label %go
go:
  %current.at = call ptr @word(i64 {current})
  %d = load i64, ptr %current.at
  %to = call ptr @field(i64 %d, i64 {pending})
  call void @copy(ptr %to, ptr %from)
  br label %end
end:
  ret void
}}
define i64 @hdScheduleAsynchronous(ptr %function, ptr %context, i16 zeroext %priority) {{
  %old = load ptr, ptr @callback
  %one = icmp eq ptr %old, null
  br i1 %one, label %go, label %second
second:
  call void @violate()
  ret i64 0
go:
  store ptr %context, ptr @data
  store atomic ptr %function, ptr @callback release, align 8
  ret i64 1
}}
define void @hdUnschedule(i64 %handle) {{
  store atomic ptr null, ptr @callback release, align 8
  ret void
}}
define void @hdSetSchedulerRate(i64 %rate) {{
  %at = call ptr @word(i64 {rate})
  store i64 %rate, ptr %at
  ret void
}}
define void @hdStartScheduler() {{
  %going = load i64, ptr @going
  %twice = icmp ne i64 %going, 0
  br i1 %twice, label %violation, label %go
violation:
  call void @violate()
  ret void
go:
  call void @add(i64 {starts})
  store i64 1, ptr @going
  %code = call i32 @pthread_create(ptr @thread, ptr null, ptr @schedule, ptr null)
  ret void
}}
define void @hdStopScheduler() {{
  %going = load i64, ptr @going
  %none = icmp eq i64 %going, 0
  br i1 %none, label %end, label %go
go:
  store atomic i64 0, ptr @going release, align 8
  %thread = load i64, ptr @thread
  %code = call i32 @pthread_join(i64 %thread, ptr null)
  br label %end
end:
  ret void
}}
define internal i64 @now(ptr %time) {{
  %code = call i32 @clock_gettime(i32 1, ptr %time)
  %nanos.at = getelementptr i64, ptr %time, i64 1
  %s = load i64, ptr %time
  %n = load i64, ptr %nanos.at
  %whole = mul i64 %s, 1000000000
  %all = add i64 %whole, %n
  ret i64 %all
}}
define internal ptr @schedule(ptr %ignored) {{
start:
  %time = alloca [2 x i64]
  %priority = alloca i32
  store i32 80, ptr %priority
  %self = call i64 @pthread_self()
  %code = call i32 @pthread_setschedparam(i64 %self, i32 1, ptr %priority)
  %nanos.at = getelementptr i64, ptr %time, i64 1
  %rate.at = call ptr @word(i64 {rate})
  %rate = load i64, ptr %rate.at
  %period = sdiv i64 1000000000, %rate
  %first = call i64 @now(ptr %time)
  br label %wait
wait:
  %before = phi i64 [ %first, %start ], [ %deadline, %next ]
  %deadline = add i64 %before, %period
  %s = sdiv i64 %deadline, 1000000000
  %n = srem i64 %deadline, 1000000000
  store i64 %s, ptr %time
  store i64 %n, ptr %nanos.at
  br label %sleep
sleep:
  %slept = call i32 @clock_nanosleep(i32 1, i32 1, ptr %time, ptr null)
  %again = icmp eq i32 %slept, 4
  br i1 %again, label %sleep, label %woken
woken:
  %going = load atomic i64, ptr @going acquire, align 8
  %over = icmp eq i64 %going, 0
  br i1 %over, label %end, label %look
look:
  %stalled.at = call ptr @word(i64 {stalled})
  %stalled = load i64, ptr %stalled.at
  %function = load atomic ptr, ptr @callback acquire, align 8
  %none = icmp eq ptr %function, null
  %still = icmp ne i64 %stalled, 0
  %no = or i1 %none, %still
  br i1 %no, label %next, label %turn
turn:
  %context = load ptr, ptr @data
  %began = call i64 @now(ptr %time)
  store i64 1, ptr @inside
  %result = call i32 %function(ptr %context)
  store i64 0, ptr @inside
  %done = call i64 @now(ptr %time)
  %last = icmp eq i32 %result, 0
  br i1 %last, label %drop, label %count
drop:
  store atomic ptr null, ptr @callback release, align 8
  br label %count
count:
  %took = sub i64 %done, %began
  %micros = sdiv i64 %took, 1000
  %long = icmp sgt i64 %micros, {last_bin}
  %bin = select i1 %long, i64 {last_bin}, i64 %micros
  %i = add i64 %bin, {first_bin}
  call void @add(i64 %i)
  call void @add(i64 {turns})
  %longest.at = call ptr @word(i64 {longest})
  %longest = load i64, ptr %longest.at
  %more = icmp sgt i64 %took, %longest
  %most = select i1 %more, i64 %took, i64 %longest
  store i64 %most, ptr %longest.at
  br label %next
next:
  br label %wait
end:
  ret ptr null
}}
"""


def library(state: Path, folder: Path) -> Any:
    """Make the library: the path of a shared one where there is a compiler, else an object with its functions."""
    text = TEXT.format(
        length=len(str(state)) + 1, path=state, bytes=8 * SIZE, device=DEVICE, devices=DEVICES,
        first_device=FIRST_DEVICE, errors=ERRORS, violations=VIOLATIONS, current=CURRENT, frame=FRAME, owner=OWNER,
        name=NAME, error=ERROR, depth=DEPTH, stack=STACK, enabled=ENABLED, pending=PENDING, force=FORCE,
        velocity=VELOCITY, position=POSITION, rate=RATE, starts=STARTS, stalled=STALLED, turns=TURNS, longest=LONGEST,
        last_bin=BINS - 1, first_bin=FIRST_BIN,
    )  # fmt: skip
    if compiler() is not None:
        return str(shared(text, folder, "libHD.so"))
    return SchedulerFunctions(text)


class SchedulerFunctions:
    """The library's functions in this process, by their names, as ctypes shows those of a shared library."""

    def __init__(self, text: str) -> None:
        self._engine = loaded([emitted(text)], ())
        for name, (result, *kinds) in SIGNATURES.items():
            setattr(self, name, ctypes.CFUNCTYPE(result, *kinds)(address(self._engine, name)))
        self.hdGetError = ctypes.CFUNCTYPE(_Error)(address(self._engine, "hdGetError"))


class _Error(ctypes.Structure):
    """HDErrorInfo."""

    _fields_ = (("code", ctypes.c_uint), ("internal", ctypes.c_int), ("handle", ctypes.c_uint))
