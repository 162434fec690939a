// Frames: COBS and CRC-16. Plain C, so that tests run it on any machine.
#pragma once
#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

struct decoder {
  uint8_t bytes[MAX_WIRE];
  uint8_t count;
  bool overflow;
};

uint16_t crc16(uint16_t crc, const uint8_t *bytes, uint8_t count);

// Take one byte from the wire; return the length of the plain frame now in `bytes`, checked and without CRC, or 0.
uint8_t decoder_take(struct decoder *decoder, uint8_t byte);

// Write a frame as it goes on the wire, zero included, and return its length. `wire` has room for MAX_WIRE bytes.
uint8_t frame_encode(uint8_t sequence, uint8_t type, const uint8_t *payload, uint8_t count, uint8_t *wire);
