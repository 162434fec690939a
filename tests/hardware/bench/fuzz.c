/* The firmware's codec, link and motion on this machine, fed with bytes that a bad line and a bad host could send.
 *
 * usage: fuzz FRAMES SEED. Built with sanitizers. Prints the number of frames and of those that were valid. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bytes.h"
#include "chain.h"
#include "frame.h"
#include "link.h"
#include "motion.h"

struct board board;
static uint32_t now_us;
static unsigned long long sent;
uint32_t board_now_us(void) { return now_us; }
void board_send(const uint8_t *bytes, uint8_t count) { sent += bytes[count - 1] + count; }

static uint64_t state;
static uint32_t draw(uint32_t below) {
  state = state * 6364136223846793005u + 1442695040888963407u;
  return (uint32_t)((state >> 33) % below);
}

static void fail(const char *what, long frame) {
  printf("frame %ld: %s\n", frame, what);
  exit(1);
}

/* A message that is meaningful, more or less. */
static uint8_t make(uint8_t sequence, uint8_t *wire) {
  static const uint8_t kinds[] = {HELLO, PING, STOP, HOLD, RELEASE, CONFIG, COMMIT, ENABLE, WAYPOINTS, START, SETPOINT, LIMP};
  uint8_t payload[MAX_PAYLOAD], *at = payload, kind = kinds[draw(sizeof kinds)];
  static const uint8_t record[] = {0, 0xF4, 0x01, 0xC4, 0x09, 0xB0, 0x04, 0xDC, 0x05, 0x11, 24, 0, 232, 0, 64, 0, 128, 0};
  switch (kind) {
    case PING: at = put32(at, now_us); break;
    case CONFIG: at = put8(put8(at, 0), 2); memcpy(at, record, sizeof record); at += sizeof record; break;
    case COMMIT: at = put16(put16(put16(put16(at, 7), crc16(0xFFFF, record, sizeof record)), 300), 2000); break;
    case ENABLE: at = put16(at, draw(9) ? 7 : 8); break;
    case WAYPOINTS:
      at = put8(put16(at, motion.next_index + !draw(20)), !draw(6));
      for (uint32_t i = 0; i < 1 + draw(3); i++) {
        uint32_t after = motion.count ? motion.next_index * 20000u : 0;
        at = put32(at, after + 20000 * (i + 1));
        at = put8(put16(at, (uint16_t)(1480 + draw(40))), (uint8_t)(126 + draw(4)));
      }
      break;
    case START: at = put32(at, now_us + draw(100000)); break;
    case SETPOINT: at = put8(put16(at, (uint16_t)(500 + draw(2000))), (uint8_t)(24 + draw(208))); break;
    case LIMP: at = put16(at, (uint16_t)draw(8)); break;
  }
  if (!draw(10)) { /* the right form with arbitrary content */
    at = payload + draw(MAX_PAYLOAD + 1);
    for (uint8_t *p = payload; p < at; p++) *p = (uint8_t)draw(256);
  }
  return frame_encode(sequence, kind, payload, (uint8_t)(at - payload), wire);
}

static void check_commands(long frame) {
  if (motion.state == DETACHED) return;
  for (uint8_t j = 0; j < motion.joint_count; j++) {
    const struct joint *joint = &motion.joints[j];
    bool smart = is_smart(joint); /* a smart servo may stand outside its limits before it is driven */
    if (!smart && (motion.command[j] < joint->low * 16 || motion.command[j] > joint->high * 16))
      fail("a command outside its limits", frame);
  }
  if (motion.count > motion.depth || motion.depth * motion.entry_bytes > POOL_BYTES) fail("the queue overflows", frame);
}

int main(int count, char **words) {
  long frames = count > 1 ? atol(words[1]) : 1000, valid = 0;
  state = count > 2 ? strtoull(words[2], 0, 10) : 1;
  struct decoder witness = {0};
  uint8_t sequence = 0, slot = 0;
  for (long frame = 0; frame < frames; frame++) {
    uint8_t wire[2 * MAX_WIRE], length = make(sequence, wire);
    uint32_t damage = draw(4);
    if (damage == 0) { /* noise */
      length = (uint8_t)(1 + draw(2 * MAX_WIRE - 1));
      for (uint8_t i = 0; i < length; i++) wire[i] = (uint8_t)draw(256);
    } else if (damage == 1) { /* flipped bits */
      for (uint32_t i = 0; i < 1 + draw(3); i++) wire[draw(length)] ^= (uint8_t)(1 << draw(8));
    } else if (damage == 2 && !draw(3)) { /* truncated */
      length = (uint8_t)draw(length);
    }
    for (uint8_t i = 0; i < length; i++) {
      uint8_t plain = decoder_take(&witness, wire[i]);
      bool good = plain && witness.bytes[0] == VERSION;
      struct motion before = motion;
      link_take(wire[i]);
      if (!good && memcmp(&before, &motion, sizeof motion)) fail("the state changed without a valid frame", frame);
      if (good) {
        valid++;
        sequence = (uint8_t)(witness.bytes[1] + 1);
      }
    }
    for (uint32_t steps = draw(12); steps--; now_us += SLOT_US) {
      slot = (uint8_t)((slot + 1) % PULSES);
      motion_slot(slot, now_us + SLOT_US);
      if (!draw(14)) {
        uint8_t packet[PACKET_BYTES];
        for (uint8_t chain = 0; chain < CHAINS; chain++) {
          static const uint8_t answers[] = {0, 0xFE, 0x01, 0x02, 128, 127, 0xE8, 0x17};
          chain_answer(chain, draw(4) ? 128 : answers[draw(sizeof answers)]);
        }
        motion_packet();
        for (uint8_t chain = 0; chain < CHAINS; chain++) chain_packet(chain, packet);
      }
      check_commands(frame);
    }
  }
  printf("%ld frames, %ld valid, fault %d\n", frames, valid, motion.fault);
  return 0;
}
