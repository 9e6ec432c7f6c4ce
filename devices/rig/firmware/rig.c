/* The rig's controller: frames, states, watchdog. See rig.h. */
#include "rig.h"

#define STATE_SIZE (9 + 8 * RIG_AXES)
#define ABOUT_SIZE (16 + 4 * RIG_AXES)
#define RUN_SIZE (7 + 4 * RIG_AXES)

uint16_t rig_crc(const uint8_t *bytes, size_t count)
{
    uint16_t crc = 0xFFFF;
    while (count--) {
        crc = (uint16_t)(crc ^ (uint16_t)(*bytes++ << 8));
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)((crc & 0x8000) ? (crc << 1) ^ 0x1021 : crc << 1);
    }
    return crc;
}

/* COBS of messages under 254 bytes: each zero becomes the distance to the next one. */
size_t rig_frame(const uint8_t *message, size_t count, uint8_t *out)
{
    uint16_t crc = rig_crc(message, count);
    size_t length = 1, mark = 0;
    for (size_t i = 0; i < count + 2; i++) {
        uint8_t byte = i < count ? message[i] : (uint8_t)(i == count ? crc & 0xFF : crc >> 8);
        if (byte) {
            out[length++] = byte;
        } else {
            out[mark] = (uint8_t)(length - mark);
            mark = length++;
        }
    }
    out[mark] = (uint8_t)(length - mark);
    out[length++] = 0;
    return length;
}

/* Undo COBS in place and check the CRC; gives the bytes of the message, 0 for a bad frame. */
static size_t unframe(uint8_t *bytes, size_t count)
{
    size_t from = 0, to = 0;
    while (from < count) {
        uint8_t run = bytes[from++];
        if (run == 0 || from + run - 1u > count)
            return 0;
        for (uint8_t i = 1; i < run; i++)
            bytes[to++] = bytes[from++];
        if (from < count)
            bytes[to++] = 0;
    }
    if (to < 3 || rig_crc(bytes, to - 2) != (uint16_t)(bytes[to - 2] | bytes[to - 1] << 8))
        return 0;
    return to - 2;
}

static void put16(uint8_t *at, uint16_t value)
{
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
}

static void put32(uint8_t *at, uint32_t value)
{
    put16(at, (uint16_t)value);
    put16(at + 2, (uint16_t)(value >> 16));
}

static int32_t get32(const uint8_t *at)
{
    return (int32_t)((uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24);
}

static void torques(rig *r, uint32_t part, uint32_t whole)
{
    int32_t out[RIG_AXES];
    for (int i = 0; i < RIG_AXES; i++)
        out[i] = (int32_t)((int64_t)r->goal[i] * part / whole);
    r->board.torque(out);
}

static void rest(rig *r)
{
    for (int i = 0; i < RIG_AXES; i++)
        r->goal[i] = 0;
    torques(r, 1, 1);
    r->board.enable(0);
}

static void fail(rig *r, uint8_t fault, uint32_t now)
{
    int decays = fault == RIG_LATE || fault == RIG_NOISY;
    if (r->state == RIG_FAULT && (decays || (r->fault != RIG_LATE && r->fault != RIG_NOISY)))
        return; /* the first fault stays, but for one in its decay that ends it */
    r->state = RIG_FAULT;
    r->fault = fault;
    r->failed = now;
    if (!decays)
        rest(r);
}

static void send(rig *r, const uint8_t *message, size_t count)
{
    uint8_t frame[RIG_FRAME];
    r->board.send(frame, rig_frame(message, count, frame));
}

static void tell_state(rig *r, const uint8_t *question, uint32_t now)
{
    uint8_t m[STATE_SIZE];
    int32_t count[RIG_AXES], rate[RIG_AXES];
    r->board.counts(count, rate);
    m[0] = RIG_STATE;
    m[1] = question[1];
    m[2] = question[2];
    m[3] = r->state;
    m[4] = r->fault;
    put32(m + 5, now);
    for (int i = 0; i < RIG_AXES; i++) {
        put32(m + 9 + 8 * i, (uint32_t)count[i]);
        put32(m + 13 + 8 * i, (uint32_t)rate[i]);
    }
    send(r, m, sizeof m);
}

static void tell_about(rig *r, const uint8_t *question)
{
    uint8_t m[ABOUT_SIZE];
    m[0] = RIG_ABOUT;
    m[1] = RIG_VERSION;
    m[2] = RIG_AXES;
    m[3] = r->state;
    put32(m + 4, RIG_WATCHDOG_US);
    for (int i = 0; i < RIG_AXES; i++)
        put32(m + 8 + 4 * i, RIG_LIMIT_UNM);
    put32(m + 8 + 4 * RIG_AXES, (uint32_t)get32(question + 3));
    put32(m + 12 + 4 * RIG_AXES, r->session);
    send(r, m, sizeof m);
}

static void run(rig *r, const uint8_t *m, uint16_t number, uint32_t now)
{
    uint16_t step = (uint16_t)(number - r->number);
    if (r->state != RIG_ARMED && r->state != RIG_RUNNING) {
        tell_state(r, m, now);
        return;
    }
    if ((uint32_t)get32(m + 3) != r->session || step == 0 || step >= 0x8000) /* a recorded, an old or repeated command never acts */
        return;
    for (int i = 0; i < RIG_AXES; i++) {
        int32_t torque = get32(m + 7 + 4 * i);
        r->goal[i] = torque > RIG_LIMIT_UNM ? RIG_LIMIT_UNM : torque < -RIG_LIMIT_UNM ? -RIG_LIMIT_UNM : torque;
    }
    r->number = number;
    r->state = RIG_RUNNING;
    r->fed = now;
    torques(r, 1, 1);
}

/* Act on a message; gives 0 for one that is none. */
static int act(rig *r, const uint8_t *m, size_t count, uint32_t now)
{
    uint16_t number;
    if (count != (m[0] == RIG_RUN ? RUN_SIZE : m[0] == RIG_HELLO || m[0] == RIG_ARM ? 7 : 3))
        return 0;
    number = (uint16_t)(m[1] | m[2] << 8);
    switch (m[0]) {
    case RIG_HELLO:
        rest(r);
        r->state = RIG_IDLE;
        r->fault = RIG_FINE;
        r->session = (r->session + (uint32_t)get32(m + 3) + now) * 1664525u + 1013904223u;
        tell_about(r, m);
        return 1;
    case RIG_ARM:
        if (r->state == RIG_IDLE && (uint32_t)get32(m + 3) == r->session && r->board.health() == RIG_FINE) {
            rest(r);
            r->board.enable(1);
            r->number = number;
            r->fed = now;
            r->state = RIG_ARMED;
        }
        tell_state(r, m, now);
        return 1;
    case RIG_STOP:
        rest(r);
        if (r->state != RIG_FAULT)
            r->state = RIG_IDLE;
        tell_state(r, m, now);
        return 1;
    case RIG_RUN:
        run(r, m, number, now);
        return 1;
    case RIG_POLL:
        tell_state(r, m, now);
        return 1;
    default:
        return 0;
    }
}

void rig_init(rig *r, const rig_board *board)
{
    r->board = *board;
    r->state = RIG_IDLE;
    r->fault = RIG_FINE;
    r->number = 0;
    r->session = r->fed = r->failed = r->good = r->bad = 0;
    r->length = r->overflow = r->noise = 0;
    rest(r);
}

void rig_byte(rig *r, uint8_t byte, uint32_t now)
{
    size_t count;
    if (byte) {
        if (r->length < RIG_FRAME)
            r->frame[r->length++] = byte;
        else
            r->overflow = 1;
        return;
    }
    if (r->length == 0) /* two ends in a row: a host that begins afresh */
        return;
    count = r->overflow ? 0 : unframe(r->frame, r->length);
    r->length = r->overflow = 0;
    if (count && act(r, r->frame, count, now)) {
        r->good++;
        r->noise = 0;
        return;
    }
    r->bad++;
    if (r->noise < RIG_NOISE)
        r->noise++;
    if (r->noise == RIG_NOISE && r->state == RIG_RUNNING)
        fail(r, RIG_NOISY, now);
}

void rig_tick(rig *r, uint32_t now)
{
    int decays = r->state == RIG_FAULT && (r->fault == RIG_LATE || r->fault == RIG_NOISY)
                 && now - r->failed < RIG_DECAY_US;
    if (r->state == RIG_ARMED || r->state == RIG_RUNNING || decays) {
        int32_t count[RIG_AXES], rate[RIG_AXES];
        int health = r->board.health();
        r->board.counts(count, rate);
        for (int i = 0; i < RIG_AXES; i++)
            if (health == RIG_FINE && (rate[i] > RIG_OVERSPEED || rate[i] < -RIG_OVERSPEED))
                health = RIG_TOO_FAST;
        if (health != RIG_FINE)
            fail(r, (uint8_t)health, now);
        else if (r->state != RIG_FAULT
                 && now - r->fed > (r->state == RIG_ARMED ? RIG_ARMED_US : RIG_WATCHDOG_US))
            fail(r, RIG_LATE, now);
    }
    if (r->state == RIG_FAULT && (r->fault == RIG_LATE || r->fault == RIG_NOISY)) {
        uint32_t since = now - r->failed;
        if (since >= RIG_DECAY_US)
            rest(r);
        else
            torques(r, RIG_DECAY_US - since, RIG_DECAY_US);
    }
}
