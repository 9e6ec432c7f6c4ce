/* A stand-in for the OpenHaptics library (HD): a thread calls one callback a period; devices are the file STATE, which
 * all programs share that load it. Each program has a scheduler of its own.
 *
 *   cc -shared -fPIC -pthread -DSTATE='"FILE"' libhd.c
 */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define GET(x) __atomic_load_n(&(x), __ATOMIC_ACQUIRE)
#define SET(x, value) __atomic_store_n(&(x), value, __ATOMIC_RELEASE)

enum { DEVICES = 3, ERRORS = 16, BINS = 2048, PRIORITY = 80 };
enum { VELOCITY = 0x2051, FORCE = 0x2700, INVALID = 0x102, NO_DEVICE = 0x300 };
static const int64_t SECOND = 1000000000, PAUSE = 20000; /* [ns]; PAUSE between two looks at what is due */

struct device { /* FakeDevice in emulator.py */
    double position[3], velocity[3], force[3], pending[3]; /* mm, mm/s, N */
    int64_t owner, enabled, frame, error, refusal;         /* errors left by every frame, and by every force but 0 */
    char name[64];
};

struct state { /* FakeScheduler in emulator.py */
    int64_t current, depth, stack[DEVICES]; /* of frames */
    int64_t error_count, errors[ERRORS];
    int64_t rate, turns, violations, starts, stalled;
    int64_t paced, due, passed, running; /* paced: turns come as they are due, and not by the machine's clock */
    int64_t bins[BINS];                  /* callbacks by how long they took, a microsecond each */
    struct device devices[DEVICES];
};

typedef struct { unsigned code; int internal; unsigned device; } error_info;

static unsigned (*callback)(void *);
static void *context;
static int going, inside;
static pthread_t thread;

static struct state *state(void)
{
    static struct state *page;
    if (!page)
        page = mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, open(STATE, O_RDWR), 0);
    return page;
}

static void leave(int64_t error)
{
    if (state()->error_count < ERRORS)
        state()->errors[state()->error_count++] = error;
}

static void violate(void)
{
    state()->violations++;
    leave(INVALID);
}

/* Give the device whose frame is open, inside of the callback; NULL is a violation. */
static struct device *current(void)
{
    struct device *d = state()->devices + state()->current;
    if (d->frame && inside)
        return d;
    violate();
    return NULL;
}

error_info hdGetError(void)
{
    error_info error = {0, 0, 0};
    if (state()->error_count)
        error.code = (unsigned)state()->errors[--state()->error_count];
    return error;
}

unsigned hdInitDevice(const char *name)
{
    for (unsigned k = 0; k < DEVICES; k++) {
        struct device *d = state()->devices + k;
        int is_free = !d->owner || kill((pid_t)d->owner, 0);
        if (name ? strcmp(name, d->name) : !is_free)
            continue;
        if (!is_free || d->error)
            break;
        d->owner = getpid();
        d->frame = 0;
        state()->depth = 0;
        state()->current = k;
        return k;
    }
    leave(NO_DEVICE);
    return (unsigned)-1;
}

void hdDisableDevice(unsigned handle)
{
    struct device *d = state()->devices + handle;
    d->owner = d->enabled = 0;
    memset(d->force, 0, sizeof d->force);
    memset(d->pending, 0, sizeof d->pending);
}

void hdMakeCurrentDevice(unsigned handle)
{
    state()->current = handle;
}

void hdEnable(unsigned what)
{
    (void)what;
    state()->devices[state()->current].enabled = 1;
}

void hdDisable(unsigned what)
{
    (void)what;
    state()->devices[state()->current].enabled = 0;
}

void hdBeginFrame(unsigned handle)
{
    struct device *d = state()->devices + handle;
    if (!inside || d->frame) {
        violate();
        return;
    }
    d->frame = 1;
    state()->stack[state()->depth++] = handle;
    state()->current = handle;
    if (d->error)
        leave(d->error);
}

void hdEndFrame(unsigned handle)
{
    struct device *d = state()->devices + handle;
    if (!d->frame) {
        violate();
        return;
    }
    d->frame = 0;
    if (state()->stack[--state()->depth] != handle)
        violate(); /* frames cross */
    for (int i = 0; i < 3; i++)
        d->force[i] = d->enabled ? d->pending[i] : 0.0;
}

void hdGetDoublev(unsigned what, double *values)
{
    struct device *d = current();
    if (d)
        memcpy(values, what == VELOCITY ? d->velocity : d->position, sizeof d->position);
}

void hdSetDoublev(unsigned what, const double *values)
{
    struct device *d = current();
    if (!d || what != FORCE)
        return;
    if (d->refusal && (values[0] != 0.0 || values[1] != 0.0 || values[2] != 0.0))
        leave(d->refusal);
    else
        memcpy(d->pending, values, sizeof d->pending);
}

unsigned long hdScheduleAsynchronous(unsigned (*function)(void *), void *data, unsigned short priority)
{
    (void)priority;
    if (callback) {
        violate();
        return 0;
    }
    context = data;
    SET(callback, function);
    return 1;
}

void hdUnschedule(unsigned long handle)
{
    (void)handle;
    SET(callback, NULL);
}

void hdSetSchedulerRate(unsigned long rate)
{
    state()->rate = (int64_t)rate;
}

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * SECOND + t.tv_nsec;
}

static void turn(struct state *s)
{
    unsigned (*function)(void *) = GET(callback);
    int64_t began, took;
    if (!function || GET(s->stalled))
        return;
    began = now();
    inside = 1;
    if (!function(context))
        SET(callback, NULL);
    inside = 0;
    took = (now() - began) / 1000;
    s->bins[took < BINS ? took : BINS - 1]++;
    s->turns++;
}

static void *schedule(void *ignored)
{
    struct sched_param priority = {.sched_priority = PRIORITY};
    struct state *s = state();
    int64_t next = now(), period = s->paced ? PAUSE : SECOND / s->rate;
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority); /* where it is allowed */
    for (;;) {
        struct timespec t;
        next += period;
        t.tv_sec = next / SECOND;
        t.tv_nsec = next % SECOND;
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
            ;
        if (!GET(going))
            return ignored;
        if (s->paced && s->passed >= GET(s->due))
            continue;
        turn(s);
        SET(s->passed, s->passed + 1);
    }
}

void hdStartScheduler(void)
{
    struct state *s = state();
    if (going) {
        violate();
        return;
    }
    s->starts++;
    going = 1;
    s->passed = s->due;
    s->running = 1;
    pthread_create(&thread, NULL, schedule, NULL);
}

void hdStopScheduler(void)
{
    if (!going)
        return;
    SET(going, 0);
    pthread_join(thread, NULL);
    state()->running = 0;
}
