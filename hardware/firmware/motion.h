// Servo commands: configuration, queue of waypoints, interpolation, braking. Plain C.
//
// Values are raw: microseconds of pulse, or the byte of a smart servo; commands are in sixteenths of a raw step. Motion
// time runs with the board's clock, or slower while braking: the arm then stays on its path and comes to rest on it.
// Times and waypoint indices wrap; only their differences are compared, so that a motion may last for days.
#pragma once
#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

enum {
  SLOT_US = 3333,         // one pulse output after the other, six per servo frame of 20 ms
  FRAME_US = 20000,       // period that a rate limit refers to
  PACKET_US = 27456,      // from the choice of a chain's goals to their arrival
  BRAKE_SLOTS = 16,       // from full speed to rest in 53 ms ...
  BRAKE_US = 28000,       // ... which takes 25 ms of motion time, and one more slot to detect
  STOP_MARGIN_MS = 130,   // braking, a packet in flight and the packet with the final goals
  MIN_GAP_US = 1000,
  MAX_GAP_US = 1000000,   // the host fills longer gaps between waypoints
  MAX_LEAD_US = 10000000, // a start further ahead than this is a mistake
  POOL_BYTES = 768,
};

struct joint {
  uint8_t channel, offset;  // offset of its value in a waypoint
  uint16_t low, high, step, safe;
};

struct motion {
  struct joint joints[MAX_JOINTS];
  uint8_t joint_count, records, value_bytes, entry_bytes;
  uint8_t driven_by[MAX_JOINTS];  // joint + 1 of each pulse output, then of each place on a chain; 0 for none
  uint16_t records_crc, calibration;
  int32_t stop_us, release_us;  // silence to tolerate
  bool configured;
  uint8_t chains;  // one bit per chain that has joints

  uint8_t state, fault, fault_joint;
  bool done, braking;
  uint8_t pace;  // BRAKE_SLOTS is full speed
  uint16_t limp;
  uint32_t heard_us, start_us, time_us;  // time_us is motion time

  uint16_t command[MAX_JOINTS], target[MAX_JOINTS];  // sixteenths of raw values
  uint16_t last_pulse[PULSES];                       // last command: a servo without read-back is there; 0 since boot
  uint8_t measured[MAX_JOINTS];                      // of smart servos; 0 if unknown

  uint8_t pool[POOL_BYTES], before[4 + 2 * PULSES + CHAINS * PLACES];  // waypoints as received; the one passed last
  uint8_t head, count, depth;
  uint16_t next_index;
  bool have_last;
};

extern struct motion motion;

static inline bool is_smart(const struct joint *joint) { return joint->channel >= SMART; }

void motion_fault(uint8_t fault, uint8_t joint);

// Messages; each returns a fault code, and one other than FAULT_NONE has become the board's fault.
uint8_t motion_config(const uint8_t *payload, uint8_t count);
uint8_t motion_commit(const uint8_t *payload);
uint8_t motion_enable(uint16_t calibration);
uint8_t motion_waypoints(const uint8_t *payload, uint8_t count);
uint8_t motion_start(uint32_t start_us, uint32_t now_us);
uint8_t motion_setpoint(const uint8_t *payload);
uint8_t motion_limp(uint16_t mask);
void motion_stop(void);
void motion_hold(void);
void motion_release(void);
void motion_clear(void);  // stop, and forget a fault without releasing the servos

// Advance to the slot that starts at slot_us, command its pulse output, and return the width of its pulse in sixteenths
// of a microsecond, which is cycles; 0 for no pulse.
uint16_t motion_slot(uint8_t slot, uint32_t slot_us);

// Command the smart servos for a packet that leaves now.
void motion_packet(void);

// Return the goal of a place on a chain, or 0 if it must be limp.
uint8_t motion_goal(uint8_t chain, uint8_t place);

// Take the position that a smart servo reports; 0 for a servo that does not answer any more.
void motion_measured(uint8_t chain, uint8_t place, uint8_t position);
