/* The rig's controller: two planar two-link arms, four motors and four encoders, on one serial line.
 *
 * Portable C99 without a heap, floating point or a library: the same source runs on the controller and, through host.c,
 * as its own emulator. A port fills a rig_board and calls rig_byte for every byte that comes and rig_tick from a timer,
 * every 50 us or so, both from the same thread or with interrupts off.
 *
 * A frame is COBS(message, CRC-16/CCITT-FALSE of the message, low byte first), then a byte 0. A message is its kind
 * (u8), a number that counts up (u16), and what the kind asks for; all numbers are little-endian, torques in uN m at
 * the motor's shaft, encoders in counts since power came on, rates in counts a second.
 *
 *   HELLO 01 number nonce u32     -> ABOUT 81 version u8, axes u8, state u8, watchdog us i32, torque limit i32 x axes,
 *                                    nonce u32 of this HELLO, session u32
 *   ARM   02 number session u32   -> STATE; IDLE becomes ARMED: motors on, at zero torque
 *   STOP  03 number               -> STATE; motors off, IDLE
 *   RUN   10 number session u32 torque i32 x axes       no answer, unless the state is neither ARMED nor RUNNING
 *   POLL  11 number               -> STATE 90 number of the message that it answers, state u8, fault u8, time us u32,
 *                                    (count i32, rate i32) x axes
 *
 * IDLE -> ARMED -> RUNNING -> FAULT -> (HELLO) IDLE. Only a RUN that acts feeds the watchdog, and one acts whose number
 * is newer than that of ARM or the last RUN. ARM and RUN act only with the session of the last HELLO, which is another
 * one each time: frames that were recorded before do nothing when they are sent again. (It keeps out accidents, such as
 * the buffer of a program that died; it is no secret from somebody who listens.) ARMED without a RUN ends in a fault.
 *
 * When a watchdog or noise is the fault, torques decay to zero, and the motors are off at the end; any other fault
 * switches them off at once, also during the decay. A clock that steps back is late: the difference wraps around.
 */
#ifndef RIG_H
#define RIG_H

#include <stddef.h>
#include <stdint.h>

#define RIG_VERSION 2
#define RIG_AXES 4
#define RIG_FRAME 64 /* bytes of the longest frame, without its end */

#define RIG_WATCHDOG_US 5000u    /* between two RUN that act */
#define RIG_ARMED_US 5000000u    /* from ARM to the first RUN: other devices are opened meanwhile */
#define RIG_DECAY_US 20000u      /* from the torque of the last RUN to zero */
#define RIG_LIMIT_UNM 60000      /* of a motor [uN m] */
#define RIG_OVERSPEED 400000     /* [counts/s]: 42 rad/s of a joint with 60 000 counts */
#define RIG_NOISE 10             /* bad frames in a row */

enum rig_kind {
    RIG_HELLO = 0x01, RIG_ARM = 0x02, RIG_STOP = 0x03, RIG_RUN = 0x10, RIG_POLL = 0x11,
    RIG_ABOUT = 0x81, RIG_STATE = 0x90
};
enum rig_state { RIG_IDLE, RIG_ARMED, RIG_RUNNING, RIG_FAULT };
enum rig_fault {
    RIG_FINE, RIG_LATE, RIG_TOO_FAST, RIG_OVERCURRENT, RIG_ENCODER, RIG_ESTOP, RIG_NOISY
};

/* What a port does for the controller. */
typedef struct {
    void (*counts)(int32_t count[RIG_AXES], int32_t rate[RIG_AXES]);
    void (*torque)(const int32_t micro[RIG_AXES]); /* stays until the next call */
    void (*enable)(int on);                        /* motor drivers; 0 lets the motors coast */
    void (*send)(const uint8_t *bytes, size_t count);
    int (*health)(void); /* RIG_FINE, RIG_OVERCURRENT, RIG_ENCODER, or RIG_ESTOP: pressed, deadman up, or no 24 V */
} rig_board;

typedef struct {
    rig_board board;
    uint8_t state, fault;
    uint16_t number;               /* of the last RUN that acted, or of ARM */
    uint32_t session;              /* of the last HELLO */
    uint32_t fed, failed;          /* times of the last RUN that acted, or of ARM, and of the fault [us] */
    int32_t goal[RIG_AXES];        /* torques of the last RUN, within the limit */
    uint8_t frame[RIG_FRAME], length, overflow, noise;
    uint32_t good, bad;            /* frames since power came on */
} rig;

void rig_init(rig *r, const rig_board *board);
void rig_byte(rig *r, uint8_t byte, uint32_t now_us);
void rig_tick(rig *r, uint32_t now_us);

uint16_t rig_crc(const uint8_t *bytes, size_t count);
/* Frame a message: `out` has room for count + 4 bytes; gives the bytes of the frame, its end included. */
size_t rig_frame(const uint8_t *message, size_t count, uint8_t *out);

#endif
