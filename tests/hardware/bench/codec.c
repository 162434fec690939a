/* The firmware's codec as a library for Python. */
#include <string.h>

#include "chain.h"
#include "frame.h"
#include "motion.h"

struct decoder codec;

/* Feed bytes; write the plain frames, each after its length, and return the number of bytes written. */
long codec_feed(const uint8_t *bytes, long count, uint8_t *out) {
  uint8_t *at = out;
  for (long i = 0; i < count; i++) {
    uint8_t length = decoder_take(&codec, bytes[i]);
    if (!length || codec.bytes[0] != VERSION) continue;
    *at++ = length;
    memcpy(at, codec.bytes, length);
    at += length;
  }
  return at - out;
}
