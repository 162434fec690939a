// Little-endian numbers in messages, at any address.
#pragma once
#include <stdint.h>

static inline uint16_t get16(const uint8_t *at) { return (uint16_t)(at[0] | at[1] << 8); }
static inline uint32_t get32(const uint8_t *at) { return get16(at) | (uint32_t)get16(at + 2) << 16; }

static inline uint8_t *put8(uint8_t *at, uint8_t x) {
  *at = x;
  return at + 1;
}
static inline uint8_t *put16(uint8_t *at, uint16_t x) { return put8(put8(at, (uint8_t)x), (uint8_t)(x >> 8)); }
static inline uint8_t *put32(uint8_t *at, uint32_t x) { return put16(put16(at, (uint16_t)x), (uint16_t)(x >> 16)); }
