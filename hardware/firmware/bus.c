#include "bus.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdbool.h>
#include <string.h>

#include "news.h"

enum { PINS = (1 << CHAINS) - 1 };
enum { BITS = 11, PACKET_BITS = BITS * PACKET_BYTES, REST_BITS = 4, LISTEN_TURNS = 15 };
enum { BIT_TICKS = 104, TURN_TICKS = 256, LONG_TICKS = 117 };  // of 4 us: 416 us a bit, 1024 us a turn, 468 us for a one
// An answer begins with a long low; then each bit is a high, long for a one, and a low; then the line is let go.
enum { EDGES = 2 + 2 * 8, MOST_INTERRUPTS = 3 * EDGES };

static volatile enum { RESTING, SENDING, LISTENING } phase;
static volatile bool ready;
static uint8_t used, step;
static uint8_t levels[PACKET_BITS];  // what goes out, both lines bit by bit
static uint8_t lines, interrupts;
static struct {
  uint8_t count, ticks[EDGES + 1];  // what came in: when the line changed, from high on
} ear[CHAINS];

void bus_use(uint8_t mask) {
  if (mask == used) return;
  TIMSK0 = PCMSK0 = 0;
  used = mask;
  DDRB &= (uint8_t)~PINS;
  PORTB = (PORTB & (uint8_t)~PINS) | mask;  // pulled up while nobody talks
  phase = RESTING;
  step = 0;
  ready = false;
  ear[0].count = ear[1].count = 0;
  TCCR0A = 1 << WGM01;
  TCCR0B = 1 << CS01 | 1 << CS00;
  TCNT0 = 0;
  OCR0A = BIT_TICKS - 1;
  PCICR = 1 << PCIE0;
  if (!mask) return;
  TIMSK0 = 1 << OCIE0A;
  NEWS |= NEWS_ANSWERS;
}

// The last stop bit has been out for its time: lets go of the lines.
static void listen(void) {
  DDRB &= (uint8_t)~PINS;
  OCR0A = TURN_TICKS - 1;
  phase = LISTENING;
  step = 0;
  for (uint8_t i = 0; i < CHAINS; i++) ear[i].count = 0;
  interrupts = 0;
  lines = PINS;
  PCIFR = 1 << PCIF0;
  PCMSK0 = used;
}

static void rest(void) {
  PCMSK0 = 0;
  OCR0A = BIT_TICKS - 1;
  phase = RESTING;
  step = 0;
  NEWS |= NEWS_ANSWERS;
}

ISR(TIMER0_COMPA_vect) {
  if (phase == SENDING) {
    if (step == PACKET_BITS) {
      listen();
    } else {
      PORTB = (PORTB & (uint8_t)~PINS) | levels[step++];
      DDRB |= used;
    }
  } else if (phase == LISTENING) {
    if (++step == LISTEN_TURNS) rest();
  } else if (step < REST_BITS) {
    step++;
  } else if (ready) {
    ready = false;
    phase = SENDING;
    step = 0;
  }
}

// However noisy a line is, only so many interrupts a packet.
ISR(PCINT0_vect) {
  uint8_t now = TCNT0, before = lines, changed;
  lines = PINB;
  changed = lines ^ before;
  for (uint8_t i = 0; i < CHAINS; i++)
    if (changed & 1 << i && ear[i].count <= EDGES) ear[i].ticks[ear[i].count++] = now;
  if (++interrupts == MOST_INTERRUPTS) PCMSK0 = 0;
}

void bus_answers(uint8_t answers[CHAINS]) {
  for (uint8_t i = 0; i < CHAINS; i++) {
    answers[i] = 0;
    if (ear[i].count != EDGES) continue;
    for (const uint8_t *at = ear[i].ticks + 1; at < ear[i].ticks + EDGES - 1; at += 2)
      answers[i] = (uint8_t)(answers[i] >> 1 | ((uint8_t)(at[1] - at[0]) >= LONG_TICKS ? 0x80 : 0));
  }
}

void bus_send(uint8_t packets[CHAINS][PACKET_BYTES]) {
  uint8_t *level = levels;
  for (uint8_t k = 0; k < PACKET_BYTES; k++) {
    uint8_t first = packets[0][k], second = packets[1][k];
    *level++ = 0;
    for (uint8_t bit = 0; bit < 8; bit++, first >>= 1, second >>= 1) *level++ = ((first & 1) | (second & 1) << 1) & used;
    for (uint8_t bit = 9; bit < BITS; bit++) *level++ = used;
  }
  ready = true;
}
