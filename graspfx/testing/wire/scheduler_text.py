"""LLVM's text of a scheduler's thread and its callback, of the stand-in for OpenHaptics."""

from __future__ import annotations

from graspfx.testing.wire.frame_text import FRAMES

TEXT = (
    FRAMES
    + """
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
  %due.at = call ptr @word(i64 {due})
  %due = load i64, ptr %due.at
  %passed.at = call ptr @word(i64 {passed})
  store i64 %due, ptr %passed.at
  %running.at = call ptr @word(i64 {running})
  store i64 1, ptr %running.at
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
  %running.at = call ptr @word(i64 {running})
  store i64 0, ptr %running.at
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
  %wall = sdiv i64 1000000000, %rate
  %paced.at = call ptr @word(i64 {paced})
  %paced = load i64, ptr %paced.at
  %as.due = icmp ne i64 %paced, 0
  %period = select i1 %as.due, i64 20000, i64 %wall
  %due.at = call ptr @word(i64 {due})
  %passed.at = call ptr @word(i64 {passed})
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
  br i1 %over, label %end, label %ask
ask:
  %due = load atomic i64, ptr %due.at acquire, align 8
  %passed = load i64, ptr %passed.at
  %early = icmp sge i64 %passed, %due
  %rests = and i1 %as.due, %early
  br i1 %rests, label %next, label %look
look:
  %stalled.at = call ptr @word(i64 {stalled})
  %stalled = load i64, ptr %stalled.at
  %function = load atomic ptr, ptr @callback acquire, align 8
  %none = icmp eq ptr %function, null
  %still = icmp ne i64 %stalled, 0
  %no = or i1 %none, %still
  br i1 %no, label %past, label %turn
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
  br label %past
past:
  %more.passed = add i64 %passed, 1
  store atomic i64 %more.passed, ptr %passed.at release, align 8
  br label %next
next:
  br label %wait
end:
  ret ptr null
}}
"""
)
