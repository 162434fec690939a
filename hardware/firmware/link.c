#include "link.h"

#include "bytes.h"
#include "frame.h"
#include "motion.h"

static struct decoder decoder;
static uint8_t expected;

static void answer(uint8_t type, const uint8_t *payload, uint8_t count) {
  uint8_t wire[MAX_WIRE];
  board_send(wire, frame_encode(expected, type, payload, count, wire));
}

static void answer_hello(void) {
  uint8_t payload[16], *at = payload;
  at = put8(at, FIRMWARE);
  at = put16(at, board.boots);
  at = put8(at, board.reset_cause);
  at = put8(at, MAX_JOINTS);
  at = put16(at, POOL_BYTES);
  at = put16(at, motion.configured ? motion.calibration : 0);
  answer(HELLO_REPLY, payload, (uint8_t)(at - payload));
}

static void answer_status(const uint8_t *echo) {
  const struct motion *m = &motion;
  uint8_t payload[MAX_PAYLOAD], *at = put32(payload, get32(echo));
  at = put32(at, board_now_us());
  at = put32(at, m->state == PLAYING ? board_now_us() - m->start_us : m->time_us);
  at = put8(at, (uint8_t)(m->state | m->done << 2 | m->configured << 3 | m->braking << 4));
  at = put8(at, m->fault);
  at = put8(at, m->fault_joint);
  at = put8(at, m->configured ? m->depth - m->count : 0);
  at = put16(at, m->next_index);
  at = put16(at, m->configured ? m->calibration : 0);
  at = put16(at, board.vcc_mv);
  for (uint8_t j = 0; j < m->joint_count && m->configured; j++) {
    uint16_t raw = (m->command[j] + 8) >> 4;
    at = is_smart(&m->joints[j]) ? put8(put8(at, (uint8_t)raw), m->measured[j]) : put16(at, raw);
  }
  answer(STATUS, payload, (uint8_t)(at - payload));
}

static uint8_t execute(uint8_t type, const uint8_t *payload, uint8_t count) {
  uint8_t fixed = 0xFF;
  switch (type) {
    case STOP: case HOLD: case RELEASE: case CLEAR: fixed = 0; break;
    case COMMIT: fixed = 8; break;
    case ENABLE: case LIMP: fixed = 2; break;
    case START: fixed = 4; break;
    case SETPOINT: fixed = motion.value_bytes; break;
    case CONFIG: fixed = count >= 2 + RECORD_BYTES && (count - 2) % RECORD_BYTES == 0 ? count : 0xFF; break;
    case WAYPOINTS: fixed = count > 3 ? count : 0xFF; break;
  }
  if (count != fixed) {
    motion_fault(FAULT_LENGTH, 0);
    return FAULT_LENGTH;
  }
  switch (type) {
    case STOP: motion_stop(); break;
    case HOLD: motion_hold(); break;
    case RELEASE: motion_release(); break;
    case CONFIG: return motion_config(payload, count);
    case COMMIT: return motion_commit(payload);
    case ENABLE: return motion_enable(get16(payload));
    case WAYPOINTS: return motion_waypoints(payload, count);
    case START: return motion_start(get32(payload), board_now_us());
    case SETPOINT: return motion_setpoint(payload);
    case LIMP: return motion_limp(get16(payload));
    case CLEAR: motion_clear(); break;
  }
  return FAULT_NONE;
}

static void handle(uint8_t sequence, uint8_t type, const uint8_t *payload, uint8_t count) {
  int8_t ahead = (int8_t)(sequence - expected);
  bool fresh = type < IN_SEQUENCE_FROM ? ahead >= 0 : ahead == 0;
  if (type == HELLO && count == 0) {
    expected = sequence + 1;
    answer_hello();
  } else if (type == PING && count == 4) {
    answer_status(payload);
  } else if (type < ANY_ORDER_BELOW || type >= 0x80) {
    return;
  } else if (ahead > 0 && !fresh) {
    answer(NAK, 0, 0);
  } else {
    uint8_t code = motion.fault;  // answer to a message that has been executed before
    if (fresh) {
      expected = sequence + 1;
      code = execute(type, payload, count);
    }
    answer(ACK, &code, 1);
  }
}

bool link_take(uint8_t byte) {
  uint8_t count = decoder_take(&decoder, byte);
  if (count == 0 || decoder.bytes[0] != VERSION) return false;
  motion.heard_us = board_now_us();
  handle(decoder.bytes[1], decoder.bytes[2], decoder.bytes + HEAD_BYTES, count - HEAD_BYTES);
  return true;
}
