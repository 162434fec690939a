#include "motion.h"

#include <string.h>

#include "bytes.h"
#include "frame.h"
#include "limits.h"

struct motion motion;
#define m (&motion)

static uint8_t *entry(uint8_t i) {
  uint8_t at = m->head + i < m->depth ? m->head + i : m->head + i - m->depth;  // fits: depth <= 127
  return m->pool + (uint16_t)at * m->entry_bytes;
}

static uint16_t value(const struct joint *joint, const uint8_t *entry) {
  const uint8_t *at = entry + 4 + joint->offset;
  return is_smart(joint) ? *at : get16(at);
}

static uint8_t output(uint8_t channel) { return channel < PULSES ? channel : channel - SMART + PULSES; }

static int8_t joint_on(uint8_t output) { return (int8_t)(m->driven_by[output] - 1); }

static uint8_t refuse(uint8_t fault, uint8_t joint) {
  motion_fault(fault, joint);
  return fault;
}

static void drop(void) {
  m->head = m->count = 0;
  m->next_index = 0;
  m->time_us = 0;
  m->have_last = m->braking = m->done = false;
  m->pace = BRAKE_SLOTS;
}

static void rest(void) {
  for (uint8_t j = 0; j < m->joint_count; j++) m->target[j] = m->command[j];
  if (m->state == PLAYING) m->state = HOLDING;
}

void motion_fault(uint8_t fault, uint8_t joint) {
  if (m->fault == FAULT_NONE) {
    m->fault = fault;
    m->fault_joint = joint;
  }
  motion_hold();
}

void motion_hold(void) {
  if (m->state != PLAYING)
    rest();
  else if (m->time_us == 0)  // not moving yet
    motion_stop();
  else
    m->braking = true;
}

void motion_stop(void) {
  rest();
  drop();
}

void motion_clear(void) {
  motion_stop();
  m->fault = FAULT_NONE;
}

void motion_release(void) {
  motion_stop();
  m->state = DETACHED;
  m->limp = 0;
}

static bool plausible(const struct joint *joint) {
  uint16_t lowest = PULSE_LOW, highest = PULSE_HIGH, max_step = PULSE_MAX_STEP;
  bool exists = joint->channel < PULSES;
  if (is_smart(joint)) {
    lowest = SMART_LOW, highest = SMART_HIGH, max_step = SMART_MAX_STEP;
    exists = joint->channel < SMART + CHAINS * PLACES;
  }
  return exists && joint->low >= lowest && joint->high <= highest && joint->low < joint->high && joint->step > 0 &&
         joint->step <= max_step && joint->safe >= joint->low && joint->safe <= joint->high;
}

uint8_t motion_config(const uint8_t *payload, uint8_t count) {
  uint8_t first = payload[0], total = payload[1];
  if (m->state == PLAYING) return refuse(FAULT_STATE, 0);
  if (first == 0) {
    motion_release();
    m->configured = false;
    m->chains = m->joint_count = m->records = m->value_bytes = 0;
    memset(m->driven_by, 0, sizeof m->driven_by);
    m->records_crc = 0xFFFF;
  }
  if (first != m->records || total == 0 || total > MAX_JOINTS) return refuse(FAULT_CONFIG, first);
  m->records_crc = crc16(m->records_crc, payload + 2, count - 2);
  for (const uint8_t *at = payload + 2; at < payload + count; at += RECORD_BYTES) {
    if (m->records == total) return refuse(FAULT_CONFIG, m->records);
    struct joint *joint = &m->joints[m->records];
    *joint = (struct joint){at[0], m->value_bytes, get16(at + 1), get16(at + 3), get16(at + 5), get16(at + 7)};
    if (!plausible(joint) || joint_on(output(joint->channel)) >= 0) return refuse(FAULT_CONFIG, m->records);
    m->value_bytes += is_smart(joint) ? 1 : 2;
    m->driven_by[output(joint->channel)] = ++m->records;
  }
  m->joint_count = m->records == total ? total : 0;
  return FAULT_NONE;
}

uint8_t motion_commit(const uint8_t *payload) {
  uint16_t stop_within = get16(payload + 4), release_after = get16(payload + 6);
  if (m->state == PLAYING) return refuse(FAULT_STATE, 0);
  if (m->joint_count == 0 || get16(payload + 2) != m->records_crc || stop_within <= STOP_MARGIN_MS ||
      release_after < stop_within)
    return refuse(FAULT_CONFIG, m->joint_count);
  motion_release();
  m->calibration = get16(payload);
  m->stop_us = (stop_within - STOP_MARGIN_MS + 1) * 1000L;
  m->release_us = (release_after + 1L) * 1000;
  m->entry_bytes = 4 + m->value_bytes;
  m->depth = POOL_BYTES / m->entry_bytes < 127 ? POOL_BYTES / m->entry_bytes : 127;
  m->fault = FAULT_NONE;
  m->configured = true;
  for (uint8_t j = 0; j < m->joint_count; j++) {
    const struct joint *joint = &m->joints[j];
    if (is_smart(joint)) m->chains |= 1 << (joint->channel - SMART) / PLACES;
    uint16_t last = is_smart(joint) ? 0 : m->last_pulse[joint->channel];
    bool inside = last >= joint->low * 16 && last <= joint->high * 16;
    m->command[j] = m->target[j] = inside ? last : joint->safe * 16;
    m->measured[j] = 0;
  }
  return FAULT_NONE;
}

uint8_t motion_enable(uint16_t calibration) {
  if (!m->configured || calibration != m->calibration) return refuse(FAULT_CONFIG, 0);
  if (m->fault != FAULT_NONE) return m->fault;
  if (m->state != DETACHED) return FAULT_NONE;
  for (uint8_t j = 0; j < m->joint_count; j++) {
    const struct joint *joint = &m->joints[j];
    if (!is_smart(joint)) continue;
    if (m->measured[j] == 0) return refuse(FAULT_SERVO, j);
    uint8_t inside = m->measured[j] < joint->low ? joint->low : m->measured[j] > joint->high ? joint->high : m->measured[j];
    m->command[j] = m->measured[j] * 16;
    m->target[j] = inside * 16;
  }
  m->state = HOLDING;
  return FAULT_NONE;
}

// Check values against ranges, and against rates from those before; return a fault code.
static uint8_t check_waypoint(const uint8_t *at, const uint8_t *from, uint32_t gap_us) {
  uint16_t gap = (uint16_t)(gap_us >> 4);
  for (uint8_t j = 0; j < m->joint_count; j++) {
    const struct joint *joint = &m->joints[j];
    uint16_t wanted = value(joint, at), present = value(joint, from);
    if (wanted < joint->low || wanted > joint->high) return refuse(FAULT_RANGE, j);
    uint16_t distance = wanted > present ? wanted - present : present - wanted;
    // Both values are rounded: one raw step more is allowed.
    if (distance > 1 && (uint32_t)(distance - 1) * FRAME_US > (uint32_t)joint->step * gap) return refuse(FAULT_RATE, j);
  }
  return FAULT_NONE;
}

// Take the present command as a waypoint at time zero.
static void note_present(void) {
  memset(m->before, 0, 4);
  for (uint8_t j = 0; j < m->joint_count; j++) {
    uint8_t *at = m->before + 4 + m->joints[j].offset;
    uint16_t raw = (m->command[j] + 8) >> 4;
    if (is_smart(&m->joints[j]))
      *at = (uint8_t)raw;
    else
      put16(at, raw);
  }
}

uint8_t motion_waypoints(const uint8_t *payload, uint8_t count) {
  if (m->fault != FAULT_NONE) return m->fault;
  if (m->state == DETACHED) return refuse(FAULT_STATE, 0);
  if ((uint8_t)(count - 3) % m->entry_bytes) return refuse(FAULT_LENGTH, 0);
  if (get16(payload) != m->next_index || m->have_last || m->done) return refuse(FAULT_ORDER, 0);
  bool first = m->next_index == 0 && m->count == 0;  // the index wraps in mid-motion, when waypoints are queued
  if (first) note_present();
  for (const uint8_t *at = payload + 3; at < payload + count; at += m->entry_bytes) {
    const uint8_t *from = m->count ? entry(m->count - 1) : m->before;
    uint32_t time = get32(at), gap = time - get32(from);
    if (m->time_us && (int32_t)(time - m->time_us) <= SLOT_US) return refuse(FAULT_LATE, 0);
    bool spaced = gap >= MIN_GAP_US || first;
    first = false;
    if (!spaced || gap > MAX_GAP_US || m->count == m->depth) return refuse(FAULT_ORDER, 0);
    uint8_t fault = check_waypoint(at, from, gap);
    if (fault) return fault;
    memcpy(entry(m->count), at, m->entry_bytes);
    m->count++;
    m->next_index++;
  }
  m->have_last = payload[2];
  return FAULT_NONE;
}

uint8_t motion_start(uint32_t start_us, uint32_t now_us) {
  if (m->fault != FAULT_NONE) return m->fault;
  if (m->state != HOLDING || m->count == 0) return refuse(FAULT_STATE, 0);
  uint32_t lead = start_us - now_us;
  if (lead > MAX_LEAD_US) return refuse(FAULT_LATE, 0);
  m->start_us = start_us;
  m->time_us = 0;
  m->state = PLAYING;
  return FAULT_NONE;
}

uint8_t motion_setpoint(const uint8_t *payload) {
  if (m->fault != FAULT_NONE) return m->fault;
  if (m->state != HOLDING) return refuse(FAULT_STATE, 0);
  for (uint8_t j = 0; j < m->joint_count; j++) {
    uint16_t wanted = value(&m->joints[j], payload - 4);
    if (wanted < m->joints[j].low || wanted > m->joints[j].high) return refuse(FAULT_RANGE, j);
  }
  for (uint8_t j = 0; j < m->joint_count; j++) m->target[j] = value(&m->joints[j], payload - 4) * 16;
  return FAULT_NONE;
}

uint8_t motion_limp(uint16_t mask) {
  if (m->state == PLAYING) return refuse(FAULT_STATE, 0);
  m->limp = mask;
  return FAULT_NONE;
}

// Return part / whole in 65536ths, for part < whole.
static uint16_t fraction(uint16_t part, uint16_t whole) {
  uint16_t quotient = 0;
  for (uint8_t bit = 0; bit < 16; bit++) {
    bool carry = part & 0x8000;
    part <<= 1;
    quotient <<= 1;
    if (carry || part >= whole) {
      part -= whole;
      quotient |= 1;
    }
  }
  return quotient;
}

// Position of a motion time: on the line between two waypoints, or at the last one known.
struct moment {
  const uint8_t *from, *to;
  uint16_t fraction;
};

static struct moment moment(uint32_t time) {
  const uint8_t *from = m->before;
  for (uint8_t i = 0; i < m->count; i++) {
    const uint8_t *to = entry(i);
    if ((int32_t)(get32(to) - time) > 0) {
      uint16_t part = (uint16_t)((time - get32(from)) >> 4), whole = (uint16_t)((get32(to) - get32(from)) >> 4);
      return part < whole ? (struct moment){from, to, fraction(part, whole)} : (struct moment){to, to, 0};
    }
    from = to;
  }
  return (struct moment){from, from, 0};
}

static uint16_t at(const struct moment *moment, const struct joint *joint) {
  int16_t start = (int16_t)value(joint, moment->from), change = (int16_t)value(joint, moment->to) - start;
  return (uint16_t)(start * 16 + ((int32_t)change * moment->fraction >> 12));
}

static void arrive(void) {
  for (uint8_t j = 0; j < m->joint_count; j++) m->target[j] = value(&m->joints[j], m->before) * 16;
  m->state = HOLDING;
  m->done = true;
}

static void advance(uint32_t slot_us) {
  if (m->time_us == 0 && (int32_t)(slot_us - m->start_us) < 0) return;
  if (!m->braking) {
    m->time_us = slot_us - m->start_us;
  } else if (--m->pace) {
    m->time_us += (uint16_t)SLOT_US * m->pace / BRAKE_SLOTS;
  } else {
    motion_stop();
    return;
  }
  while (m->count && (int32_t)(get32(entry(0)) - m->time_us) <= 0) {
    memcpy(m->before, entry(0), m->entry_bytes);
    m->head = m->head + 1 == m->depth ? 0 : m->head + 1;
    m->count--;
  }
  if (m->have_last) {
    if (m->count == 0) arrive();
  } else if (m->count == 0 || get32(entry(m->count - 1)) - m->time_us < BRAKE_US) {
    motion_fault(FAULT_UNDERRUN, 0);
  }
}

static void check_silence(uint32_t now_us) {
  int32_t silent_us = (int32_t)(now_us - m->heard_us);
  if (silent_us >= m->stop_us) {
    if (m->state == PLAYING)
      motion_fault(FAULT_SILENCE, 0);
    else
      rest();
  }
  if (silent_us >= m->release_us) motion_release();
}

// Return the next command of a joint that approaches its target outside a motion.
static uint16_t approach(uint16_t from, uint16_t to, uint16_t step) {
  if (to > from) return to - from > step ? from + step : to;
  return from - to > step ? from - step : to;
}

uint16_t motion_slot(uint8_t slot, uint32_t slot_us) {
  if (m->state != DETACHED) check_silence(slot_us);
  if (m->state == PLAYING) advance(slot_us);
  int8_t j = joint_on(slot);
  if (m->state == DETACHED || j < 0) return 0;
  if (m->state != PLAYING) {
    m->command[j] = approach(m->command[j], m->target[j], m->joints[j].step);
  } else if (m->time_us) {
    struct moment now = moment(m->time_us);
    m->command[j] = m->target[j] = at(&now, &m->joints[j]);
  }
  return m->last_pulse[slot] = m->command[j];
}

void motion_packet(void) {
  if (m->state == DETACHED) return;
  struct moment ahead = moment(m->time_us + (uint32_t)PACKET_US / BRAKE_SLOTS * m->pace);
  for (uint8_t j = 0; j < m->joint_count; j++) {
    if (!is_smart(&m->joints[j]) || m->limp & 1u << j) continue;
    if (m->state != PLAYING)
      m->command[j] = approach(m->command[j], m->target[j], m->joints[j].step * 2);
    else if (m->time_us)
      m->command[j] = m->target[j] = at(&ahead, &m->joints[j]);
  }
}

uint8_t motion_goal(uint8_t chain, uint8_t place) {
  int8_t j = joint_on(PULSES + PLACES * chain + place);
  if (j < 0 || m->state == DETACHED || m->limp & 1u << j) return 0;
  return (uint8_t)((m->command[j] + 8) >> 4);
}

void motion_measured(uint8_t chain, uint8_t place, uint8_t position) {
  int8_t j = joint_on(PULSES + PLACES * chain + place);
  if (j < 0) return;
  m->measured[j] = position;
  if (position == 0 && m->state != DETACHED)
    motion_fault(FAULT_SERVO, (uint8_t)j);
  else if (m->limp & 1u << j)  // it will hold where the hand leaves it
    m->command[j] = m->target[j] = position * 16;
}
