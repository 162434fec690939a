// What travels between host and board. hardware/messages.py says the same in Python; tests compare the two.
//
// A frame is COBS(version, sequence, type, payload, CRC-16) and a zero. The CRC (polynomial 0x1021, start 0xFFFF) comes
// inverted and high byte first: over a whole frame it is then CRC_RESIDUE. Not inverted that would be zero, and stay zero
// with every zero byte that a garbled end of frame appends. Everything else is little endian.
#pragma once
#include <stdint.h>

enum { VERSION = 1, FIRMWARE = 1 };
enum { HEAD_BYTES = 3, CRC_BYTES = 2, MAX_PAYLOAD = 56 };
enum { CRC_RESIDUE = 0x1D0F };
enum { MAX_PLAIN = HEAD_BYTES + MAX_PAYLOAD + CRC_BYTES, MAX_WIRE = MAX_PLAIN + 2 };

// From the host. The first group is answered in any order; the second ends what came before it, lost frames included; the
// third is executed strictly in sequence.
enum {
  HELLO = 0x01,  // -
  PING = 0x02,   // u32 echoed
  STOP = 0x08,     // - freeze
  HOLD = 0x09,     // - brake along the path
  RELEASE = 0x0A,  // - stop driving
  CONFIG = 0x10,     // u8 first joint, u8 joints in all, then records of u8 channel, u16 low, high, step, safe
  COMMIT = 0x11,     // u16 calibration, u16 CRC of all records, u16 stop within [ms], u16 release after [ms]
  ENABLE = 0x12,     // u16 calibration
  WAYPOINTS = 0x13,  // u16 first index, u8 whether the motion ends here, then waypoints of u32 time and values
  START = 0x14,      // u32 board time of the motion's zero
  SETPOINT = 0x15,   // values
  LIM = 0x16,        // u16 mask of smart servos to go limp
};
enum { ANY_ORDER_BELOW = 0x08, IN_SEQUENCE_FROM = 0x10 };

// From the board; their sequence byte is the next one expected of the host.
enum { HELLO_REPLY = 0x81, STATUS = 0x82, ACK = 0x83, NAK = 0x84 };

enum fault {
  FAULT_NONE, FAULT_LATE, FAULT_UNDERRUN, FAULT_RANGE, FAULT_RATE, FAULT_ORDER, FAULT_SILENCE, FAULT_CONFIG, FAULT_STATE,
  FAULT_SERVO, FAULT_LENGTH,
};
enum state { DETACHED, HOLDING, PLAYING };

// A channel is a pulse output 0-5, or a place on a chain: 0x10 + 4 * chain + place.
enum { PULSES = 6, CHAINS = 2, PLACES = 4, SMART = 0x10, MAX_JOINTS = PULSES + CHAINS * PLACES };
enum { RECORD_BYTES = 9 };
