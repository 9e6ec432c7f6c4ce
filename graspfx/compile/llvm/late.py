"""LLVM text of functions that compiled programs define: calls by address, the clock, and words shared by threads.

Interpreted kernels call the Python function of the same name, which is decorated with `bound_late`. The first argument
of each function is a buffer; an argument `place` is the index of an entry of the buffer. Addresses are computed from
the address of the buffer if possible, because LLVM may assume that other addresses do not alias the buffer.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class LateFunction(NamedTuple):
    """Function that a program defines if the program calls it.

    Attributes:
        text: LLVM text of the function.
        result: Type of the result.
        library: Functions of the platform's C library that the function calls.
    """

    text: str
    result: str = "i64"
    library: tuple[str, ...] = ()


DECLARATIONS = {
    "clock_gettime": "declare i32 @graspfx_clock_gettime(i32, ptr) nounwind",
    "clock_nanosleep": "declare i32 @graspfx_clock_nanosleep(i32, i32, ptr, ptr) nounwind",
}


def _indirect(name: str, parameters: str) -> LateFunction:
    return LateFunction(f"""define internal i64 @"{name}"(ptr %buffer, i64 %address, {parameters}) nounwind {{
  %function = inttoptr i64 %address to ptr
  %code = call i64 %function(ptr %buffer, {parameters})
  ret i64 %code
}}""")


NOW = """define internal double @"now"(ptr %buffer) nounwind {
  %time = alloca [2 x i64]
  %ignored = call i32 @graspfx_clock_gettime(i32 1, ptr %time)
  %nanos = getelementptr i64, ptr %time, i64 1
  %s = load i64, ptr %time
  %n = load i64, ptr %nanos
  %whole = mul i64 %s, 1000000000
  %all = add i64 %whole, %n
  %float = sitofp i64 %all to double
  %seconds = fdiv double %float, 1.0e9
  ret double %seconds
}"""
SLEEP_UNTIL = """define internal i64 @"sleep_until"(ptr %buffer, double %deadline) nounwind {
start:
  %time = alloca [2 x i64]
  %nanos = getelementptr i64, ptr %time, i64 1
  %float = fmul double %deadline, 1.0e9
  %all = fptosi double %float to i64
  %s = sdiv i64 %all, 1000000000
  %n = srem i64 %all, 1000000000
  store i64 %s, ptr %time
  store i64 %n, ptr %nanos
  br label %sleep
sleep:
  %code = call i32 @graspfx_clock_nanosleep(i32 1, i32 1, ptr %time, ptr null)
  %interrupted = icmp eq i32 %code, 4
  br i1 %interrupted, label %sleep, label %end
end:
  ret i64 0
}"""
CALL_DEVICE = """define internal i64 @"call_device"(ptr %buffer, i64 %words, i64 %block) nounwind {
start:
  %at = getelementptr ptr, ptr %buffer, i64 %words
  %function = load ptr, ptr %at
  %none = icmp eq ptr %function, null
  br i1 %none, label %end, label %go
go:
  %second = getelementptr ptr, ptr %at, i64 1
  %context = load ptr, ptr %second
  %numbers = getelementptr double, ptr %buffer, i64 %block
  %code = call i64 %function(ptr %context, ptr %numbers)
  ret i64 %code
end:
  ret i64 0
}"""
RUN_STEPS = """define internal i64 @"run_steps"(ptr %buffer, i64 %code, i64 %rows, i64 %w, i64 %k, i64 %r) nounwind {
  %function = inttoptr i64 %code to ptr
  %first = getelementptr double, ptr %buffer, i64 %rows
  %done = call i64 %function(ptr %buffer, ptr %first, i64 %w, i64 %k, i64 1, i64 %r)
  ret i64 %done
}"""
PEEK = """define internal i64 @"peek"(ptr %buffer, i64 %place) nounwind {
  %at = getelementptr i64, ptr %buffer, i64 %place
  %number = load atomic i64, ptr %at seq_cst, align 8
  ret i64 %number
}"""
PUBLISH = """define internal i64 @"publish"(ptr %buffer, i64 %place, i64 %number) nounwind {
  %at = getelementptr i64, ptr %buffer, i64 %place
  store atomic i64 %number, ptr %at seq_cst, align 8
  ret i64 0
}"""
LATE: Mapping[str, LateFunction] = {
    "call": _indirect("call", "i64 %place"),
    "call_at": _indirect("call_at", "i64 %place, double %t"),
    "call_beside": _indirect("call_beside", "i64 %place, i64 %beside, double %t"),
    "now": LateFunction(NOW, "double", ("clock_gettime",)),
    "sleep_until": LateFunction(SLEEP_UNTIL, library=("clock_nanosleep",)),
    "call_device": LateFunction(CALL_DEVICE),
    "run_steps": LateFunction(RUN_STEPS),
    "peek": LateFunction(PEEK),
    "publish": LateFunction(PUBLISH),
}
