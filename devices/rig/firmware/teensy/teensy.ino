// The rig's controller on a Teensy 4.1: a proposal, compiled and tried by nobody yet.
//
// Put rig.h and rig.c beside this file. Pins and scales are those of docs/how-to/hardware.md: current = torque / constant,
// as a PWM duty of 0.1 to 0.9 with 0.5 for no current, which the motor drivers take as their analogue command.

extern "C" {
#include "rig.h"
}
#include "QuadEncoder.h"

static const int DUTY[RIG_AXES] = {28, 29, 36, 37}, ENABLE = 6, ALIVE = 12, STOP = 9, CURRENT_FAULT = 10;
static const float MICRO_NM_PER_A = 23000.0f, FULL_A = 3.0f;  // torque constant, and current at a duty of 0.9

static QuadEncoder encoder[RIG_AXES] = {
    QuadEncoder(1, 0, 1), QuadEncoder(2, 2, 3), QuadEncoder(3, 4, 5), QuadEncoder(4, 7, 8)};
static rig controller;
static int32_t last_count[RIG_AXES], last_rate[RIG_AXES];
static uint32_t last_time;

static void look() {  // once a millisecond: the rate that overspeed is judged by
    uint32_t now = micros(), since = now - last_time;
    if (since < 1000) return;
    for (int i = 0; i < RIG_AXES; i++) {
        int32_t count = encoder[i].read();
        last_rate[i] = (int32_t)((int64_t)(count - last_count[i]) * 1000000 / (int32_t)since);
        last_count[i] = count;
    }
    last_time = now;
}

static void counts(int32_t count[RIG_AXES], int32_t rate[RIG_AXES]) {
    for (int i = 0; i < RIG_AXES; i++) {
        count[i] = encoder[i].read();
        rate[i] = last_rate[i];
    }
}

static void torque(const int32_t micro[RIG_AXES]) {
    for (int i = 0; i < RIG_AXES; i++) {
        float current = (float)micro[i] / MICRO_NM_PER_A;
        analogWrite(DUTY[i], (int)(4095.0f * (0.5f + 0.4f * constrain(current / FULL_A, -1.0f, 1.0f))));
    }
}

static void enable(int on) { digitalWrite(ENABLE, on ? HIGH : LOW); }
static void send_bytes(const uint8_t *bytes, size_t count) {
    if ((size_t)Serial.availableForWrite() < count) return;  // a host that does not read must not block the watchdog
    Serial.write(bytes, count);
    Serial.send_now();
}
static int health() {  // both lines are pulled up: a cable that is off reads as pressed
    if (digitalRead(STOP)) return RIG_ESTOP;
    return digitalRead(CURRENT_FAULT) ? RIG_OVERCURRENT : RIG_FINE;
}

void setup() {
    pinMode(ENABLE, OUTPUT);
    digitalWrite(ENABLE, LOW);
    pinMode(ALIVE, OUTPUT);
    pinMode(STOP, INPUT_PULLUP);
    pinMode(CURRENT_FAULT, INPUT_PULLUP);
    analogWriteResolution(12);
    for (int i = 0; i < RIG_AXES; i++) {
        analogWriteFrequency(DUTY[i], 36000);
        encoder[i].setInitConfig();
        encoder[i].init();
    }
    const rig_board board = {counts, torque, enable, send_bytes, health};
    rig_init(&controller, &board);
    Serial.begin(115200);  // USB: the number is not looked at
}

void loop() {
    for (int left = 64; left > 0 && Serial.available() > 0; left--)
        rig_byte(&controller, (uint8_t)Serial.read(), micros());
    look();
    rig_tick(&controller, micros());
    digitalToggle(ALIVE);  // a charge pump on this pin holds the drivers' enable: a controller that hangs lets go
}
