// Messages between host and board. hardware/protocol.py has the same numbers in Python; tests compare the two.
//
// A frame is COBS(version, sequence, type, payload, CRC-16) and a zero. The CRC (polynomial 0x1021, start 0xFFFF) is
// sent inverted, high byte first: the CRC of a whole frame is then CRC_RESIDUE. Without the inversion it would be zero,
// and would stay zero for every zero byte that a garbled end of frame appends. Everything else is little endian.
#pragma once
#include <stdint.h>

enum { VERSION = 1, FIRMWARE = 2 };
enum { HEAD_BYTES = 3, CRC_BYTES = 2, MAX_PAYLOAD = 56 };
enum { CRC_RESIDUE = 0x1D0F };
enum { MAX_PLAIN = HEAD_BYTES + MAX_PAYLOAD + CRC_BYTES, MAX_WIRE = MAX_PLAIN + 2 };

// From the host. The first group is answered at any time. The second is executed even if frames before it were lost, and
// cancels those. The third is executed strictly in sequence.
enum {
  HELLO = 0x01,      // -
  PING = 0x02,       // u32 to echo
  STOP = 0x08,       // -; stop at once
  HOLD = 0x09,       // -; brake along the path
  RELEASE = 0x0A,    // -; stop driving the servos
  CONFIG = 0x10,     // u8 first joint, u8 number of joints, then records of u8 channel, u16 low, high, step, safe
  COMMIT = 0x11,     // u16 calibration, u16 CRC of all records, u16 stop within [ms], u16 release after [ms]
  ENABLE = 0x12,     // u16 calibration
  WAYPOINTS = 0x13,  // u16 first index, u8 1 if the motion ends here, then waypoints of u32 time and values
  START = 0x14,      // u32 board time of the motion's zero
  SETPOINT = 0x15,   // values
  LIMP = 0x16,       // u16 mask of smart servos to go limp
  CLEAR = 0x17,      // -; forget a fault, drop the queue and go on holding
};
enum { ANY_ORDER_BELOW = 0x08, IN_SEQUENCE_FROM = 0x10 };

// From the board; the sequence byte is the number expected next from the host.
enum { HELLO_REPLY = 0x81, STATUS = 0x82, ACK = 0x83, NAK = 0x84 };

enum fault {
  FAULT_NONE = 0,
  FAULT_LATE = 1,
  FAULT_UNDERRUN = 2,
  FAULT_RANGE = 3,
  FAULT_RATE = 4,
  FAULT_ORDER = 5,
  FAULT_SILENCE = 6,
  FAULT_CONFIG = 7,
  FAULT_STATE = 8,
  FAULT_SERVO = 9,
  FAULT_LENGTH = 10,
};
enum state { DETACHED = 0, HOLDING = 1, PLAYING = 2 };

// A channel is a pulse output 0-5, or a place on a chain: 0x10 + 4 * chain + place.
enum { PULSES = 6, CHAINS = 2, PLACES = 4, SMART = 0x10, MAX_JOINTS = PULSES + CHAINS * PLACES };
enum { RECORD_BYTES = 9 };
