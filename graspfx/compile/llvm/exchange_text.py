"""LLVM text of an exchange with other software: a sequence of calls of Python functions."""

from __future__ import annotations

from graspfx.compile.llvm.method import DECLARED

EXCHANGE = "graspfx_exchange"
CALLED = {
    "PyObject_Call": "ptr @PyObject_Call(ptr, ptr, ptr)",
    "PyFloat_FromDouble": "ptr @PyFloat_FromDouble(double)",
    "PyList_SetItem": "i32 @PyList_SetItem(ptr, i64, ptr)",
    "Py_DecRef": "void @Py_DecRef(ptr)",
}  # functions of Python's stable ABI, in addition to `DECLARED`
PLAN = ("calls", "call_count")  # words of a plan
CALL = (
    "function", "arguments", "keywords", "tested", "first", "second", "mask", "sends", "send_count",
    "receipts", "receipt_count",
)  # fmt: skip # words of a call
SEND = ("list", "memory", "count")  # words of an argument list
RECEIPT = ("place", "memory", "count")  # words of a result tuple


def exchange_text() -> str:
    """Return the text of exchange(buffer, place), which makes the calls of the plan at an index of the buffer.

    The function returns 0, or 1 if a call has raised an exception. The caller must hold the interpreter's lock.
    """
    names = [*DECLARED.values(), *CALLED.values()]
    return "\n".join([*(f"declare {signature}" for signature in names), _CHANGED, _SENT, _RECEIVED, _ALL, _EXCHANGE])


def _fields(base: str, words: tuple[str, ...], pointers: tuple[str, ...]) -> str:
    """Return instructions that load a record's words into registers of the same names."""
    lines = []
    for k, name in enumerate(words):
        lines += [
            f"  %{name}.at = getelementptr i64, ptr %{base}, i64 {k}",
            f"  %{name} = load {'ptr' if name in pointers else 'i64'}, ptr %{name}.at",
        ]
    return "\n".join(lines)


# Whether a float at `first` differs from that at `second` in the bits of the mask; true if no floats are compared.
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

# Fills lists with floats; false if Python has raised. PyList_SetItem steals the reference even if it fails.
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

# Reads floats from a result's tuples by borrowed references; false if Python has raised.
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


_EXCHANGE = f"""
define i64 @{EXCHANGE}(ptr %buffer, i64 %place) nounwind {{
  %plan = getelementptr i64, ptr %buffer, i64 %place
{_fields("plan", PLAN, ("calls",))}
  %good = call i1 @all(ptr %calls, i64 %call_count)
  %failed = xor i1 %good, true
  %code = zext i1 %failed to i64
  ret i64 %code
}}"""
