/* A stand-in for Force Dimension's library: its functions count their calls, return what a test wishes, and work on
 * devices whose state is the file STATE, which all programs share that load it.
 *
 *   cc -shared -fPIC -DSTATE='"FILE"' -DNAMES='"dhdOpen", ...' libdrd.c      NAMES number the functions
 */
#define _POSIX_C_SOURCE 200809L
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define ENTER(id)                       \
    struct device *d = device(id);      \
    int code = enter(d, __func__);      \
    if (code < 0)                       \
        return code

static const char *const names[] = {NAMES};
enum { DEVICES = 4, STATUS = 17, FUNCTIONS = sizeof names / sizeof *names };

struct device { /* FakeDevice in emulator.py */
    double position[3], velocity[3], force[3], max_force;
    int64_t written[2]; /* when the force was set last, by the monotonic clock [s, ns] */
    int64_t calls[FUNCTIONS];
    int32_t codes[FUNCTIONS]; /* that the functions return */
    int32_t status[STATUS], serial, owner, enabled, braking, watchdog, guard;
    char text[64];
};

static struct device *device(int id)
{
    static struct device *page;
    if (!page)
        page = mmap(NULL, DEVICES * sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, open(STATE, O_RDWR), 0);
    return page + (id < 0 ? 0 : id % DEVICES);
}

static int enter(struct device *d, const char *name)
{
    int k = 0;
    while (strcmp(names[k], name))
        k++;
    d->calls[k]++;
    return d->codes[k];
}

static int is_free(int id)
{
    return !device(id)->owner || kill(device(id)->owner, 0);
}

static int take(int id)
{
    if (!is_free(id))
        return -1;
    device(id)->owner = getpid();
    return id;
}

int dhdOpen(void)
{
    int id = 0;
    while (id < DEVICES && !is_free(id))
        id++;
    if (id == DEVICES)
        return -1;
    ENTER(id);
    return take(id);
}

int dhdOpenSerial(int serial)
{
    int id = 0;
    while (id < DEVICES && device(id)->serial != serial)
        id++;
    if (id == DEVICES)
        return -1;
    ENTER(id);
    return take(id);
}

int dhdClose(char id)
{
    ENTER(id);
    d->owner = 0;
    return code;
}

int dhdStop(char id)
{
    ENTER(id);
    d->braking = 1;
    d->enabled = 0;
    return code;
}

int dhdEnableForce(unsigned char on, char id)
{
    ENTER(id);
    d->enabled = on;
    d->braking = 0;
    return code;
}

int dhdSetMaxForce(double limit, char id)
{
    ENTER(id);
    d->max_force = limit;
    return code;
}

int dhdGetPosition(double *x, double *y, double *z, char id)
{
    ENTER(id);
    *x = d->position[0], *y = d->position[1], *z = d->position[2];
    return code;
}

int dhdSetForce(double x, double y, double z, char id)
{
    struct timespec now;
    ENTER(id);
    d->force[0] = x, d->force[1] = y, d->force[2] = z;
    clock_gettime(CLOCK_MONOTONIC, &now);
    d->written[0] = now.tv_sec, d->written[1] = now.tv_nsec;
    return code;
}

int dhdGetStatus(int status[STATUS], char id)
{
    ENTER(id);
    memcpy(status, d->status, sizeof d->status);
    return code;
}

int dhdEnableExpertMode(void)
{
    ENTER(0);
    return code;
}

int dhdDisableExpertMode(void)
{
    ENTER(0);
    return code;
}

int dhdGetWatchdog(unsigned char *units, char id)
{
    ENTER(id);
    *units = (unsigned char)d->watchdog;
    return code;
}

int dhdSetWatchdog(unsigned char units, char id)
{
    ENTER(id);
    d->watchdog = units;
    return code;
}

int dhdSetTimeGuard(int microseconds, char id)
{
    ENTER(id);
    d->guard = microseconds;
    return code;
}

const char *dhdErrorGetLastStr(void)
{
    return device(0)->text;
}
