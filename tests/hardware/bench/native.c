// The firmware's motion.c on this machine, to be called from Python: hours of motion in seconds, and jumps ahead in time.

#include <string.h>

#include "../../../hardware/firmware/bytes.h"
#include "../../../hardware/firmware/motion.h"

void native_reset(void) { memset(&motion, 0, sizeof motion); }
void native_heard(uint32_t now_us) { motion.heard_us = now_us; }
uint8_t native_state(void) { return motion.state | motion.fault << 2; }
uint16_t native_command(uint8_t j) { return motion.command[j]; }
uint16_t native_index(void) { return motion.next_index; }

static void shift(uint8_t *time, uint32_t us) { put32(time, get32(time) + us); }

// Pretend that the motion has been going on for longer: by this time, and with so many more waypoints.
void native_jump(uint32_t us, uint16_t waypoints) {
  motion.next_index += waypoints;
  motion.start_us -= us;
  motion.time_us += us;
  shift(motion.before, us);
  for (uint8_t i = 0; i < motion.count; i++)
    shift(motion.pool + (motion.head + i) % motion.depth * motion.entry_bytes, us);
}
