/* The rig's controller on a desktop computer: rig.c behind a pseudo-terminal, with two simulated arms.
 *
 *   host PAGE          PAGE is a file of `struct page`, shared with the program that watches and disturbs the board
 *   host --motion T1 T2 T3 T4 SECONDS   prints the arms' directions after a free motion under these torques [N m]
 *
 * The program ends when its standard input does. As a shared library it is a board for one thread, on a clock of the
 * caller's: `host_begin`, then `host_turn` as often as anything is to happen.
 */
#define _GNU_SOURCE /* ptsname, TIOCNXCL */
#include "rig.h"

#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { FINE, LATE, DROP, FLIP, CUT, GARBAGE, WRONG_ID, UNPLUGGED, BLOCKED };

struct page {
    double rest[RIG_AXES];  /* where the hands hold the links [rad] */
    double stiffness;       /* of the hands, at each joint [N m/rad] */
    double damping;         /* [N m s/rad] */
    double slowness;        /* of the board's clock: 1 is real time */
    double number;          /* of the failure: seconds, one in so many, a probability, bytes */
    double angle[RIG_AXES]; /* directions of the links [rad] */
    double speed[RIG_AXES]; /* [rad/s] */
    double quiet;           /* when the torques became zero last [s], of the monotonic clock */
    int32_t kind;           /* of the failure */
    int32_t health;         /* what the board's sensors say, enum rig_fault */
    int32_t torque[RIG_AXES];
    int32_t enabled, state, fault;
    int32_t good, bad; /* frames */
    int32_t plugs;     /* how often there was a new pseudo-terminal */
    char port[64];
};

static struct page *page;
static rig controller;
static int line = -1, own = -1;
static double last, given = -1.0; /* `given`: the caller's time, below zero for the machine's [s] */
static long answers;

static double seconds(void)
{
    struct timespec t;
    if (given >= 0.0)
        return given;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* The arms: both motors at the base, gear 15; M(a) a'' + h = torque, with the preset of the two-link arm. */
static const double GEAR = 15.0, TURN = 4000.0 * 15.0 / 6.283185307179586;
static const double LINK = 0.128, MASSES[2] = {0.060, 0.050}, CENTRES[2] = {0.064, 0.070};
static const double INERTIAS[2] = {8.2e-5, 7.5e-5}, ROTORS[2] = {5.8e-6, 9.5e-6}, FRICTION = 3.28e-3;

static void step(double *a, double *w, const double *rest_angle, double K, double B, const double *joint, double h)
{
    double i1 = INERTIAS[0] + MASSES[0] * CENTRES[0] * CENTRES[0] + MASSES[1] * LINK * LINK + ROTORS[0] * GEAR * GEAR;
    double i2 = INERTIAS[1] + MASSES[1] * CENTRES[1] * CENTRES[1] + ROTORS[1] * GEAR * GEAR;
    double c = MASSES[1] * LINK * CENTRES[1] * cos(a[1] - a[0]), s = MASSES[1] * LINK * CENTRES[1] * sin(a[1] - a[0]);
    double t1 = joint[0] - (FRICTION + B) * w[0] + K * (rest_angle[0] - a[0]) + s * w[1] * w[1];
    double t2 = joint[1] - (FRICTION + B) * w[1] + K * (rest_angle[1] - a[1]) - s * w[0] * w[0];
    double d = i1 * i2 - c * c;
    w[0] += h * (i2 * t1 - c * t2) / d;
    w[1] += h * (i1 * t2 - c * t1) / d;
    a[0] += h * w[0];
    a[1] += h * w[1];
}

static void move(double until)
{
    double dt = until - last > 0.05 ? 0.05 : until < last ? 0.0 : until - last; /* 0: the clock stepped back */
    int count = (int)(dt / 5e-5) + 1;
    for (int k = 0; k < count; k++)
        for (int arm = 0; arm < RIG_AXES; arm += 2) {
            double joint[2] = {1e-6 * GEAR * page->torque[arm], 1e-6 * GEAR * page->torque[arm + 1]};
            step(page->angle + arm, page->speed + arm, page->rest + arm, page->stiffness, page->damping, joint,
                 dt / count);
        }
    last = until;
}

/* The board, as the controller sees it. */
static void counts(int32_t count[RIG_AXES], int32_t rate[RIG_AXES])
{
    move(seconds());
    for (int i = 0; i < RIG_AXES; i++) {
        count[i] = (int32_t)floor(page->angle[i] * TURN + 0.5);
        rate[i] = (int32_t)(page->speed[i] * TURN);
    }
}

static void torque(const int32_t micro[RIG_AXES])
{
    int before = 0, after = 0;
    move(seconds());
    for (int i = 0; i < RIG_AXES; i++) {
        before |= page->torque[i] != 0;
        after |= micro[i] != 0;
        page->torque[i] = micro[i];
    }
    if (before && !after)
        page->quiet = seconds();
}

static void enable(int on)
{
    page->enabled = on;
}

static int health(void)
{
    return page->health;
}

/* What comes out of the board, after the failure. */
static struct { double due; size_t length; uint8_t bytes[2 * RIG_FRAME]; } queue[32];
static int queued;

/* The line does not block: bytes that find it full are lost, as those of a board that nobody reads. */
static void put(const uint8_t *bytes, size_t length)
{
    if (line >= 0 && length && write(line, bytes, length) < 0)
        return;
}

static void flip(uint8_t *bytes, size_t length)
{
    if ((double)rand() / RAND_MAX < page->number)
        bytes[(size_t)rand() % length] ^= (uint8_t)(1 << rand() % 8);
}

static void emit(const uint8_t *frame, size_t length)
{
    uint8_t bytes[2 * RIG_FRAME];
    size_t count = length;
    memcpy(bytes, frame, length);
    answers++;
    switch (page->kind) {
    case LATE:
        if (queued < (int)(sizeof queue / sizeof *queue)) {
            queue[queued].due = seconds() + page->number;
            queue[queued].length = length;
            memcpy(queue[queued++].bytes, frame, length);
        }
        return;
    case DROP:
        if (answers % (page->number < 1.0 ? 1 : (long)page->number) == 0)
            return;
        break;
    case FLIP:
        flip(bytes, length);
        break;
    case CUT:
        count = page->number < 0.0 ? (size_t)answers % length : (size_t)page->number;
        count = count < length ? count : length;
        break;
    case GARBAGE:
        for (int i = 0; i < (int)page->number; i++) {
            uint8_t byte = (uint8_t)rand();
            put(&byte, 1);
        }
        break;
    case WRONG_ID: {
        uint8_t message[9 + 8 * RIG_AXES] = {RIG_STATE + 1};
        count = rig_frame(message, sizeof message, bytes);
        break;
    }
    default:
        break;
    }
    put(bytes, count);
}

static void late_answers(double now)
{
    while (queued && queue[0].due <= now) {
        put(queue[0].bytes, queue[0].length);
        memmove(queue, queue + 1, (size_t)--queued * sizeof *queue);
    }
}

/* The cable. */
static int plug(void)
{
    struct termios t;
    line = posix_openpt(O_RDWR | O_NOCTTY);
    if (line < 0 || grantpt(line) || unlockpt(line))
        return -1;
    if (fcntl(line, F_SETFL, O_NONBLOCK)) /* a driver may flush bytes after `poll` has reported them */
        return -1;
    own = open(ptsname(line), O_RDWR | O_NOCTTY); /* so that the line stays when its user goes */
    if (own < 0 || tcgetattr(own, &t))
        return -1;
    cfmakeraw(&t);
    tcsetattr(own, TCSANOW, &t);
    snprintf(page->port, sizeof page->port, "%s", ptsname(line));
    __sync_synchronize();
    page->plugs++;
    return 0;
}

static void unplug(void)
{
    close(own);
    close(line);
    line = own = -1;
    queued = 0;
}

static int motion(char **arguments)
{
    double joint[RIG_AXES], a[RIG_AXES] = {2.2, 0.7, 0.9, 2.4}, w[RIG_AXES] = {0};
    long count = (long)(atof(arguments[RIG_AXES]) / 1e-5 + 0.5);
    for (int i = 0; i < RIG_AXES; i++)
        joint[i] = GEAR * atof(arguments[i]);
    for (long k = 0; k < count; k++)
        for (int arm = 0; arm < RIG_AXES; arm += 2)
            step(a + arm, w + arm, a + arm, 0.0, 0.0, joint + arm, 1e-5);
    for (int i = 0; i < RIG_AXES; i++)
        printf("%.9g %.9g\n", a[i], w[i]);
    return 0;
}

static void begin(void)
{
    rig_board board = {counts, torque, enable, emit, health};
    memcpy(page->angle, page->rest, sizeof page->rest);
    last = seconds();
    rig_init(&controller, &board);
}

/* Take bytes, answer, and do what is due. */
static void work(uint8_t *bytes, ssize_t count)
{
    uint32_t now = (uint32_t)(int64_t)(seconds() * 1e6 / page->slowness);
    if (count > 0 && page->kind == FLIP)
        flip(bytes, (size_t)count);
    for (ssize_t i = 0; i < count; i++)
        rig_byte(&controller, bytes[i], now);
    late_answers(seconds());
    rig_tick(&controller, now);
    move(seconds()); /* hands hold the arms of a board at rest, too */
    page->state = controller.state;
    page->fault = controller.fault;
    page->good = (int32_t)controller.good;
    page->bad = (int32_t)controller.bad;
}

void host_begin(struct page *shared, int out, double time)
{
    page = shared;
    line = out;
    given = time;
    answers = queued = 0;
    srand(1);
    begin();
}

void host_turn(double time, uint8_t *bytes, size_t count)
{
    given = time;
    work(bytes, (ssize_t)count);
}

int main(int argc, char **argv)
{
    uint8_t bytes[256];
    int file;
    if (argc == 3 + RIG_AXES && !strcmp(argv[1], "--motion"))
        return motion(argv + 2);
    file = argc == 2 ? open(argv[1], O_RDWR) : -1;
    page = file < 0 ? MAP_FAILED : mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (page == MAP_FAILED) {
        perror("host PAGE");
        return 1;
    }
    begin();
    if (plug())
        return 1;
    for (;;) {
        struct pollfd ends[2] = {{STDIN_FILENO, POLLIN, 0}, {line, POLLIN, 0}}; /* poll leaves a line of -1 out */
        ssize_t count = 0;
        if (poll(ends, 2, 1) == 0 && own >= 0)
            ioctl(own, TIOCNXCL); /* a dead user's claim goes with it, as a board's does */
        if (ends[0].revents && read(STDIN_FILENO, bytes, 1) <= 0)
            return 0;
        if (page->kind == UNPLUGGED && line >= 0)
            unplug();
        else if (page->kind != UNPLUGGED && line < 0 && plug())
            return 1;
        if (line >= 0 && ends[1].revents & POLLIN && page->kind != BLOCKED) {
            count = read(line, bytes, sizeof bytes);
        } else if (ends[1].revents) {
            struct timespec pause = {0, 100000};
            nanosleep(&pause, NULL);
        }
        work(bytes, count);
    }
}
