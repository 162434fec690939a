#include "frame.h"

#ifdef __AVR__
#include <util/crc16.h>
static uint16_t crc_byte(uint16_t crc, uint8_t byte) { return _crc_xmodem_update(crc, byte); }
#else
static uint16_t crc_byte(uint16_t crc, uint8_t byte) {
  crc ^= (uint16_t)(byte << 8);
  for (int i = 0; i < 8; i++) crc = (uint16_t)(crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1);
  return crc;
}
#endif

uint16_t crc16(uint16_t crc, const uint8_t *bytes, uint8_t count) {
  while (count--) crc = crc_byte(crc, *bytes++);
  return crc;
}

// Decode COBS in place; return the length, or 0 if the blocks do not fit.
static uint8_t unstuff(uint8_t *bytes, uint8_t count) {
  uint8_t in = 0, out = 0;
  while (in < count) {
    uint8_t block = bytes[in++];
    if (block == 0 || block - 1 > count - in) return 0;
    for (uint8_t i = 1; i < block; i++) bytes[out++] = bytes[in++];
    if (in < count) bytes[out++] = 0;
  }
  return out;
}

uint8_t decoder_take(struct decoder *decoder, uint8_t byte) {
  if (byte != 0) {
    if (decoder->count == MAX_WIRE)
      decoder->overflow = true;
    else
      decoder->bytes[decoder->count++] = byte;
    return 0;
  }
  uint8_t count = decoder->overflow ? 0 : unstuff(decoder->bytes, decoder->count);
  decoder->count = 0;
  decoder->overflow = false;
  if (count < HEAD_BYTES + CRC_BYTES || count > MAX_PLAIN) return 0;
  return crc16(0xFFFF, decoder->bytes, count) == CRC_RESIDUE ? count - CRC_BYTES : 0;
}

uint8_t frame_encode(uint8_t sequence, uint8_t type, const uint8_t *payload, uint8_t count, uint8_t *wire) {
  const uint8_t head[HEAD_BYTES] = {VERSION, sequence, type};
  uint16_t crc = (uint16_t)~crc16(crc16(0xFFFF, head, HEAD_BYTES), payload, count);
  uint8_t total = HEAD_BYTES + count + CRC_BYTES, block = 0, out = 1;
  for (uint8_t i = 0; i < total; i++) {
    uint8_t byte = i < HEAD_BYTES                ? head[i]
                   : i < HEAD_BYTES + count      ? payload[i - HEAD_BYTES]
                   : i == HEAD_BYTES + count     ? (uint8_t)(crc >> 8)
                                                 : (uint8_t)crc;
    if (byte == 0) {
      wire[block] = out - block;
      block = out++;
    } else {
      wire[out++] = byte;
    }
  }
  wire[block] = out - block;
  wire[out++] = 0;
  return out;
}
