#include "chain.h"

#include "motion.h"

#include <stdbool.h>

enum { EMPTY, CLAIMED, SERVO, OTHER };  // known of a place
enum { REPORT_POSITION = 0xFA, REPORT_TYPE = 0xFC, NO_ID = 0xFE, LIGHTS_OFF = 0x00 };
enum { IS_SERVO = 0x01, IS_LIGHT = 0x02 };
enum { MISSES = 3 };  // in a row: long leads lose an answer now and then

static struct {
  uint8_t module[PLACES], misses[PLACES], asked;
  bool driven, talks[PLACES];  // the one asked has a goal; places known to answer even then
} chains[CHAINS];

uint8_t chain_check_byte(const uint8_t data[PLACES], uint8_t place) {
  uint16_t sum = (uint16_t)(data[0] + data[1] + data[2] + data[3]);
  sum += sum >> 8;
  sum += (uint16_t)(sum << 4);
  return (uint8_t)((sum & 0xF0) | place);
}

void chain_packet(uint8_t chain, uint8_t packet[PACKET_BYTES]) {
  chains[chain].asked = (chains[chain].asked + 1) % PLACES;
  chains[chain].driven = false;
  packet[0] = 0xFF;
  for (uint8_t place = 0; place < PLACES; place++) {
    uint8_t goal = motion_goal(chain, place), byte = NO_ID;
    switch (chains[chain].module[place]) {
      case CLAIMED: byte = REPORT_TYPE; break;
      case SERVO: byte = goal ? goal : REPORT_POSITION; break;
      case OTHER: byte = LIGHTS_OFF; break;
    }
    packet[1 + place] = byte;
    if (place == chains[chain].asked) chains[chain].driven = chains[chain].module[place] == SERVO && goal;
  }
  packet[5] = chain_check_byte(packet + 1, chains[chain].asked);
}

// Forget a module that is gone, and those behind it.
static void lose(uint8_t chain, uint8_t first) {
  for (uint8_t place = first; place < PLACES; place++) {
    if (chains[chain].module[place] == SERVO) motion_measured(chain, place, 0);
    chains[chain].module[place] = EMPTY;
    chains[chain].misses[place] = 0;
    chains[chain].talks[place] = false;
  }
}

void chain_answer(uint8_t chain, uint8_t answer) {
  uint8_t place = chains[chain].asked, *module = &chains[chain].module[place];
  if (answer == 0) {
    // Not every servo may answer while it is driven: silence counts only for one that has done so before.
    if (chains[chain].driven && !chains[chain].talks[place]) return;
    if (*module != EMPTY && ++chains[chain].misses[place] >= MISSES) lose(chain, place);
    return;
  }
  chains[chain].misses[place] = 0;
  if (answer == NO_ID) {  // has just claimed this place, perhaps again after a loss of power
    if (*module == SERVO) lose(chain, place);
    if (place == 0 || chains[chain].module[place - 1] != EMPTY) *module = CLAIMED;
  } else if (*module == CLAIMED && (answer == IS_SERVO || answer == IS_LIGHT)) {
    *module = answer == IS_SERVO ? SERVO : OTHER;
  } else if (*module == SERVO && answer >= POSITION_LOW && answer <= POSITION_HIGH) {
    if (chains[chain].driven) chains[chain].talks[place] = true;
    motion_measured(chain, place, answer);
  }
}
