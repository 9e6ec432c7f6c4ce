"""LLVM's text of rounds: a program's entry and calls of Python's functions in turn, without Python between."""

from __future__ import annotations

from graspfx.compile.llvm.method import DECLARED

ROUNDS = "graspfx_rounds"
CALLED = {
    "PyObject_Call": "ptr @PyObject_Call(ptr, ptr, ptr)",
    "PyFloat_FromDouble": "ptr @PyFloat_FromDouble(double)",
    "PyList_SetItem": "i32 @PyList_SetItem(ptr, i64, ptr)",
    "Py_DecRef": "void @Py_DecRef(ptr)",
}  # Python's stable interface, beside `DECLARED`
PLAN = ("entry", "buffers", "flag", "calls", "call_count", "done")  # words of the plan
CALL = (
    "function", "arguments", "keywords", "tested", "first", "second", "mask", "sends", "send_count",
    "receipts", "receipt_count",
)  # fmt: skip # words of a call
SEND = ("list", "memory", "count")  # words of what goes into a call
RECEIPT = ("place", "memory", "count")  # and of what comes back


def rounds_text() -> str:
    """Write the function of Python's own kind `rounds(k, count, row)`: it gives how many rounds were done.

    Its `self` is a tuple that begins with the plan's address, as bytes. Round i runs the entry with (k + i, 1,
    row + i), stops before the calls if the flag is not zero then, and makes the calls. Without an entry a round is its
    calls. If a call raises, so does the function; the plan's last word has the number of rounds done in any case.
    """
    names = [*DECLARED.values(), *CALLED.values()]
    return "\n".join([*(f"declare {signature}" for signature in names), _CHANGED, _SENT, _RECEIVED, _ALL, _loop()])


def _fields(base: str, words: tuple[str, ...], pointers: tuple[str, ...]) -> str:
    """Write the loads of a record's words, into registers of their names."""
    lines = []
    for k, name in enumerate(words):
        lines += [
            f"  %{name}.at = getelementptr i64, ptr %{base}, i64 {k}",
            f"  %{name} = load {'ptr' if name in pointers else 'i64'}, ptr %{name}.at",
        ]
    return "\n".join(lines)


# Whether one of the floats at `first` differs, in the bits of the mask, from that at `second`, or none is compared.
_CHANGED = """
define internal i1 @changed(i64 %count, ptr %first, ptr %second, i64 %mask) nounwind {
start:
  %always = icmp eq i64 %count, 0
  br i1 %always, label %end, label %turn
turn:
  %j = phi i64 [ 0, %start ], [ %next, %turn ]
  %bits = phi i64 [ 0, %start ], [ %now, %turn ]
  %one.at = getelementptr i64, ptr %first, i64 %j
  %other.at = getelementptr i64, ptr %second, i64 %j
  %one = load i64, ptr %one.at
  %other = load i64, ptr %other.at
  %difference = xor i64 %one, %other
  %masked = and i64 %difference, %mask
  %now = or i64 %bits, %masked
  %next = add i64 %j, 1
  %more = icmp slt i64 %next, %count
  br i1 %more, label %turn, label %told
told:
  %differs = icmp ne i64 %now, 0
  br label %end
end:
  %result = phi i1 [ true, %start ], [ %differs, %told ]
  ret i1 %result
}"""

# Fills lists with floats; false if Python has raised. PyList_SetItem takes the float over whether it fails or not.
_SENT = f"""
define internal i1 @sent(ptr %sends, i64 %send_count) nounwind {{
start:
  br label %each
each:
  %s = phi i64 [ 0, %start ], [ %s.next, %full ]
  %any = icmp slt i64 %s, %send_count
  br i1 %any, label %fill, label %good
fill:
  %send = getelementptr [{len(SEND)} x i64], ptr %sends, i64 %s
{_fields("send", SEND, ("list", "memory"))}
  br label %turn
turn:
  %j = phi i64 [ 0, %fill ], [ %next, %set ]
  %more = icmp slt i64 %j, %count
  br i1 %more, label %new, label %full
new:
  %number.at = getelementptr double, ptr %memory, i64 %j
  %number = load double, ptr %number.at
  %float = call ptr @PyFloat_FromDouble(double %number)
  %none = icmp eq ptr %float, null
  br i1 %none, label %bad, label %put
put:
  %code = call i32 @PyList_SetItem(ptr %list, i64 %j, ptr %float)
  %wrong = icmp ne i32 %code, 0
  br i1 %wrong, label %bad, label %set
set:
  %next = add i64 %j, 1
  br label %turn
full:
  %s.next = add i64 %s, 1
  br label %each
good:
  ret i1 true
bad:
  ret i1 false
}}"""

# Reads floats of a result's tuples, which it owns no part of; false if Python has raised.
_RECEIVED = f"""
define internal i1 @received(ptr %result, ptr %receipts, i64 %receipt_count) nounwind {{
start:
  br label %each
each:
  %s = phi i64 [ 0, %start ], [ %s.next, %full ]
  %any = icmp slt i64 %s, %receipt_count
  br i1 %any, label %open, label %good
open:
  %receipt = getelementptr [{len(RECEIPT)} x i64], ptr %receipts, i64 %s
{_fields("receipt", RECEIPT, ("memory",))}
  %tuple = call ptr @PyTuple_GetItem(ptr %result, i64 %place)
  %missing = icmp eq ptr %tuple, null
  br i1 %missing, label %bad, label %turn
turn:
  %j = phi i64 [ 0, %open ], [ %next, %read ]
  %more = icmp slt i64 %j, %count
  br i1 %more, label %item, label %full
item:
  %float = call ptr @PyTuple_GetItem(ptr %tuple, i64 %j)
  %none = icmp eq ptr %float, null
  br i1 %none, label %bad, label %read
read:
  %number = call double @PyFloat_AsDouble(ptr %float)
  %number.at = getelementptr double, ptr %memory, i64 %j
  store double %number, ptr %number.at
  %next = add i64 %j, 1
  br label %turn
full:
  %error = call ptr @PyErr_Occurred()
  %fine = icmp eq ptr %error, null
  %s.next = add i64 %s, 1
  br i1 %fine, label %each, label %bad
good:
  ret i1 true
bad:
  ret i1 false
}}"""

_ALL = f"""
define internal i1 @all(ptr %list_of_calls, i64 %call_count) nounwind {{
start:
  br label %each
each:
  %c = phi i64 [ 0, %start ], [ %c.next, %done ]
  %any = icmp slt i64 %c, %call_count
  br i1 %any, label %test, label %good
test:
  %call = getelementptr [{len(CALL)} x i64], ptr %list_of_calls, i64 %c
{_fields("call", CALL, ("function", "arguments", "keywords", "first", "second", "sends", "receipts"))}
  %needed = call i1 @changed(i64 %tested, ptr %first, ptr %second, i64 %mask)
  br i1 %needed, label %send, label %done
send:
  %full = call i1 @sent(ptr %sends, i64 %send_count)
  br i1 %full, label %run, label %bad
run:
  %result = call ptr @PyObject_Call(ptr %function, ptr %arguments, ptr %keywords)
  %raised = icmp eq ptr %result, null
  br i1 %raised, label %bad, label %receive
receive:
  %whole = call i1 @received(ptr %result, ptr %receipts, i64 %receipt_count)
  call void @Py_DecRef(ptr %result)
  br i1 %whole, label %done, label %bad
done:
  %c.next = add i64 %c, 1
  br label %each
good:
  ret i1 true
bad:
  ret i1 false
}}"""


def _loop() -> str:
    return f"""
define ptr @{ROUNDS}(ptr %self, ptr %operands, i64 %operand_count) nounwind {{
start:
  %numbers = alloca [3 x i64]
  %middle = getelementptr i64, ptr %numbers, i64 1
  %last = getelementptr i64, ptr %numbers, i64 2
  store i64 1, ptr %middle
  %right = icmp eq i64 %operand_count, 3
  br i1 %right, label %read, label %wrong
read:
  %count.at = getelementptr ptr, ptr %operands, i64 1
  %row.at = getelementptr ptr, ptr %operands, i64 2
  %k.object = load ptr, ptr %operands
  %count.object = load ptr, ptr %count.at
  %row.object = load ptr, ptr %row.at
  %k = call i64 @PyLong_AsLongLong(ptr %k.object)
  %rounds = call i64 @PyLong_AsLongLong(ptr %count.object)
  %row = call i64 @PyLong_AsLongLong(ptr %row.object)
  %error = call ptr @PyErr_Occurred()
  %fine = icmp eq ptr %error, null
  br i1 %fine, label %begin, label %fail
begin:
  %bytes = call ptr @PyTuple_GetItem(ptr %self, i64 0)
  %table = call ptr @PyBytes_AsString(ptr %bytes)
  %plan = load ptr, ptr %table
{_fields("plan", PLAN[:-1], ("entry", "buffers", "flag", "calls"))}
  %done.at = getelementptr i64, ptr %plan, i64 {PLAN.index("done")}
  %bare = icmp eq ptr %entry, null
  br label %round
round:
  %i = phi i64 [ 0, %begin ], [ %next, %after ]
  store i64 %i, ptr %done.at
  %more = icmp slt i64 %i, %rounds
  br i1 %more, label %turn, label %end
turn:
  br i1 %bare, label %call, label %run
run:
  %k.now = add i64 %k, %i
  %row.now = add i64 %row, %i
  store i64 %k.now, ptr %numbers
  store i64 %row.now, ptr %last
  %code = call i64 %entry(ptr %buffers, ptr %numbers)
  %flag.now = load double, ptr %flag
  %stop = fcmp une double %flag.now, 0.0
  br i1 %stop, label %end, label %call
call:
  %good = call i1 @all(ptr %calls, i64 %call_count)
  br i1 %good, label %after, label %fail
after:
  %next = add i64 %i, 1
  br label %round
end:
  %told = call ptr @PyLong_FromLongLong(i64 %i)
  ret ptr %told
wrong:
  %ignored = call i32 @PyErr_BadArgument()
  br label %fail
fail:
  ret ptr null
}}
"""
