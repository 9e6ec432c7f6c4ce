"""LLVM text of the function that a vendor's thread calls in each cycle.

The function runs a tick of the loop, or exchanges readings and forces with Python through a block of memory, the
mailbox.
"""

from __future__ import annotations

MAILBOX = "graspfx_mailbox"
LOOP, CONTEXT, BUSY, TURNS, COUNT, PATIENCE, OVER, FIRST = range(8)  # words of a mailbox; its devices come last
(ASK, READ, WRITE, STOP, OWN, RAW, FORCES, SAMPLE, ORDERS, ENTRIES, SEQUENCE, NEWS, SEEN, AGE, FAULT) = range(15)
WORDS = 16  # words per device

# unsigned f(void *mailbox). Without a loop, or if the loop runs no tick, f exchanges samples and orders with the
# mailbox's devices. A device's orders (forces from Python) have two halves, and the last bit of `news` selects the
# valid one; if `news` is unchanged for more than `patience` turns, forces are zero. A device keeps its first fault, and
# is stopped from then on.
TEXT = f"""
define internal ptr @at(ptr %table, i64 %i) alwaysinline {{
  %at = getelementptr i64, ptr %table, i64 %i
  ret ptr %at
}}
define internal i64 @called(ptr %device, i64 %role, i64 %block) {{
  %function.at = call ptr @at(ptr %device, i64 %role)
  %function = load ptr, ptr %function.at
  %none = icmp eq ptr %function, null
  br i1 %none, label %nothing, label %go
nothing:
  ret i64 0
go:
  %context.at = call ptr @at(ptr %device, i64 {OWN})
  %context = load ptr, ptr %context.at
  %block.at = call ptr @at(ptr %device, i64 %block)
  %memory = load ptr, ptr %block.at
  %code = call i64 %function(ptr %context, ptr %memory)
  %bad = icmp slt i64 %code, 0
  br i1 %bad, label %note, label %end
note:
  %fault.at = call ptr @at(ptr %device, i64 {FAULT})
  %fault = load i64, ptr %fault.at
  %first = icmp eq i64 %fault, 0
  %kept = select i1 %first, i64 %code, i64 %fault
  store atomic i64 %kept, ptr %fault.at release, align 8
  br label %end
end:
  ret i64 %code
}}
define internal void @copied(ptr %to, ptr %from, i64 %count) {{
start:
  br label %turn
turn:
  %i = phi i64 [ 0, %start ], [ %next, %turn ]
  %from.at = getelementptr i64, ptr %from, i64 %i
  %to.at = getelementptr i64, ptr %to, i64 %i
  %x = load atomic i64, ptr %from.at monotonic, align 8
  store atomic i64 %x, ptr %to.at monotonic, align 8
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, %count
  br i1 %more, label %turn, label %end
end:
  ret void
}}
define internal void @received(ptr %device) {{
  %fault.at = call ptr @at(ptr %device, i64 {FAULT})
  %fault = load i64, ptr %fault.at
  %gone = icmp ne i64 %fault, 0
  br i1 %gone, label %end, label %read
read:
  %code = call i64 @called(ptr %device, i64 {READ}, i64 {RAW})
  %fresh = icmp eq i64 %code, 0
  br i1 %fresh, label %store, label %end
store:
  %sequence.at = call ptr @at(ptr %device, i64 {SEQUENCE})
  %sequence = load i64, ptr %sequence.at
  %odd = add i64 %sequence, 1
  store atomic i64 %odd, ptr %sequence.at seq_cst, align 8
  %entries.at = call ptr @at(ptr %device, i64 {ENTRIES})
  %entries = load i64, ptr %entries.at
  %both = mul i64 %entries, 2
  %raw.at = call ptr @at(ptr %device, i64 {RAW})
  %raw = load ptr, ptr %raw.at
  %sample.at = call ptr @at(ptr %device, i64 {SAMPLE})
  %sample = load ptr, ptr %sample.at
  call void @copied(ptr %sample, ptr %raw, i64 %both)
  %even = add i64 %sequence, 2
  store atomic i64 %even, ptr %sequence.at release, align 8
  br label %end
end:
  ret void
}}
define internal void @displayed(ptr %device, i64 %patience) {{
  %entries.at = call ptr @at(ptr %device, i64 {ENTRIES})
  %entries = load i64, ptr %entries.at
  %forces.at = call ptr @at(ptr %device, i64 {FORCES})
  %forces = load ptr, ptr %forces.at
  %news.at = call ptr @at(ptr %device, i64 {NEWS})
  %news = load atomic i64, ptr %news.at acquire, align 8
  %seen.at = call ptr @at(ptr %device, i64 {SEEN})
  %seen = load i64, ptr %seen.at
  %age.at = call ptr @at(ptr %device, i64 {AGE})
  %age = load i64, ptr %age.at
  %same = icmp eq i64 %news, %seen
  %older = add i64 %age, 1
  %now = select i1 %same, i64 %older, i64 0
  store i64 %now, ptr %age.at
  store i64 %news, ptr %seen.at
  %stale = icmp sgt i64 %now, %patience
  br i1 %stale, label %zero, label %order
order:
  %orders.at = call ptr @at(ptr %device, i64 {ORDERS})
  %orders = load ptr, ptr %orders.at
  %half = and i64 %news, 1
  %first = mul i64 %half, %entries
  %from = getelementptr i64, ptr %orders, i64 %first
  call void @copied(ptr %forces, ptr %from, i64 %entries)
  br label %show
zero:
  %i = phi i64 [ 0, %0 ], [ %next, %zero ]
  %at = getelementptr double, ptr %forces, i64 %i
  store double 0.0, ptr %at
  %next = add i64 %i, 1
  %more = icmp slt i64 %next, %entries
  br i1 %more, label %zero, label %show
show:
  %fault.at = call ptr @at(ptr %device, i64 {FAULT})
  %fault = load i64, ptr %fault.at
  %sound = icmp eq i64 %fault, 0
  br i1 %sound, label %write, label %stop
write:
  %code = call i64 @called(ptr %device, i64 {WRITE}, i64 {FORCES})
  %bad = icmp slt i64 %code, 0
  br i1 %bad, label %stop, label %end
stop:
  %ignored = call i64 @called(ptr %device, i64 {STOP}, i64 {FORCES})
  br label %end
end:
  ret void
}}
define i32 @{MAILBOX}(ptr %box) nounwind {{
start:
  %busy.at = call ptr @at(ptr %box, i64 {BUSY})
  store atomic i64 1, ptr %busy.at seq_cst, align 8
  %over.at = call ptr @at(ptr %box, i64 {OVER})
  %over = load atomic i64, ptr %over.at seq_cst, align 8
  %last = icmp ne i64 %over, 0
  br i1 %last, label %done, label %look
look:
  %loop.at = call ptr @at(ptr %box, i64 {LOOP})
  %loop = load atomic ptr, ptr %loop.at seq_cst, align 8
  %none = icmp eq ptr %loop, null
  br i1 %none, label %own, label %turn
turn:
  %context.at = call ptr @at(ptr %box, i64 {CONTEXT})
  %context = load ptr, ptr %context.at
  %ticked = call i32 %loop(ptr %context)
  %did = icmp ne i32 %ticked, 0
  br i1 %did, label %end, label %own
own:
  %count.at = call ptr @at(ptr %box, i64 {COUNT})
  %count = load i64, ptr %count.at
  %patience.at = call ptr @at(ptr %box, i64 {PATIENCE})
  %patience = load i64, ptr %patience.at
  br label %asked
asked:
  %a = phi i64 [ 0, %own ], [ %a.next, %ask ]
  %a.more = icmp slt i64 %a, %count
  br i1 %a.more, label %ask, label %reads
ask:
  %a.words = mul i64 %a, {WORDS}
  %a.first = add i64 %a.words, {FIRST}
  %a.device = call ptr @at(ptr %box, i64 %a.first)
  %a.code = call i64 @called(ptr %a.device, i64 {ASK}, i64 {RAW})
  %a.next = add i64 %a, 1
  br label %asked
reads:
  %r = phi i64 [ 0, %asked ], [ %r.next, %read ]
  %r.more = icmp slt i64 %r, %count
  br i1 %r.more, label %read, label %writes
read:
  %r.words = mul i64 %r, {WORDS}
  %r.first = add i64 %r.words, {FIRST}
  %r.device = call ptr @at(ptr %box, i64 %r.first)
  call void @received(ptr %r.device)
  %r.next = add i64 %r, 1
  br label %reads
writes:
  %w = phi i64 [ %count, %reads ], [ %w.next, %write ]
  %w.more = icmp sgt i64 %w, 0
  br i1 %w.more, label %write, label %end
write:
  %w.next = sub i64 %w, 1
  %w.words = mul i64 %w.next, {WORDS}
  %w.first = add i64 %w.words, {FIRST}
  %w.device = call ptr @at(ptr %box, i64 %w.first)
  call void @displayed(ptr %w.device, i64 %patience)
  br label %writes
end:
  %turns.at = call ptr @at(ptr %box, i64 {TURNS})
  %turns = load i64, ptr %turns.at
  %one.more = add i64 %turns, 1
  store atomic i64 %one.more, ptr %turns.at release, align 8
  store atomic i64 0, ptr %busy.at release, align 8
  ret i32 1
done:
  store atomic i64 0, ptr %busy.at release, align 8
  ret i32 0
}}
"""
