"""LLVM's text of devices and their frames, of the stand-in for OpenHaptics; names in braces are places in its state."""

from __future__ import annotations

FRAMES = """
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
"""
