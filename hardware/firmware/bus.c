#include "bus.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdbool.h>

#include "events.h"

enum { PINS = (1 << CHAINS) - 1 };
enum { BITS = 11, PACKET_BITS = BITS * PACKET_BYTES, REST_BITS = 4 };
enum { BIT_TICKS = 104, BIT_CLOCK = 1 << CS01 | 1 << CS00 };  // of 4 us: 416 us per bit
// Of 16 us: an answer comes within four turns of the timer of 3840 us. It begins with a long low; then each bit is a
// high, long for a one, and a low, together 1100 us; then the line is released. Short noise is filtered out; if the rest
// does not fit, the answer counts as silence.
enum { TURN_TICKS = 240, TURN_CLOCK = 1 << CS02, TURNS = 4 };
enum { NOISE = 6, HIGH_LEAST = 15, HIGH_ONE = 29, HIGH_MOST = 60, PERIOD_LEAST = 50, PERIOD_MOST = 90 };
enum { EDGES = 1 + 2 * 8, MOST_EDGES = EDGES + 9, MOST_INTERRUPTS = 54 };

static volatile enum { RESTING, SENDING, LISTENING } phase;
static volatile bool ready;
static uint8_t used, step;
static uint8_t levels[PACKET_BITS];  // of the packet, both lines bit by bit
static uint8_t lines, interrupts;
static struct {
  uint8_t count, ticks[MOST_EDGES];  // times at which the line changed, from high on
} heard[CHAINS];

void bus_use(uint8_t mask) {
  if (mask == used) return;
  TIMSK0 = PCMSK0 = 0;
  used = mask;
  DDRB &= (uint8_t)~PINS;
  PORTB = (PORTB & (uint8_t)~PINS) | mask;  // pulled up while nothing is sent
  phase = RESTING;
  step = 0;
  ready = false;
  heard[0].count = heard[1].count = 0;
  TCCR0A = 1 << WGM01;
  TCCR0B = BIT_CLOCK;
  TCNT0 = 0;
  OCR0A = BIT_TICKS - 1;
  PCICR = 1 << PCIE0;
  EVENTS &= (uint8_t)~EVENT_ANSWERS;
  if (!mask) return;
  TIMSK0 = 1 << OCIE0A;
  EVENTS |= EVENT_ANSWERS;
}

// Release the lines after the last stop bit.
static void listen(void) {
  DDRB &= (uint8_t)~PINS;
  OCR0A = TURN_TICKS - 1;
  TCCR0B = TURN_CLOCK;
  TCNT0 = 0;
  phase = LISTENING;
  step = 0;
  for (uint8_t i = 0; i < CHAINS; i++) heard[i].count = 0;
  interrupts = 0;
  lines = PINS;
  PCIFR = 1 << PCIF0;
  PCMSK0 = used;
}

static void rest(void) {
  PCMSK0 = 0;
  OCR0A = BIT_TICKS - 1;
  TCCR0B = BIT_CLOCK;
  phase = RESTING;
  step = 0;
  EVENTS |= EVENT_ANSWERS;
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
    if (++step == TURNS) rest();
  } else if (step < REST_BITS) {
    step++;
  } else if (ready) {
    ready = false;
    phase = SENDING;
    step = 0;
  }
}

// The number of interrupts per packet is limited, however noisy a line is.
ISR(PCINT0_vect) {
  uint8_t now = TCNT0, before = lines, changed;
  lines = PINB;
  changed = lines ^ before;
  for (uint8_t i = 0; i < CHAINS; i++)
    if (changed & 1 << i && heard[i].count < MOST_EDGES) heard[i].ticks[heard[i].count++] = now;
  if (++interrupts == MOST_INTERRUPTS) PCMSK0 = 0;
}

static uint8_t ticks_between(uint8_t from, uint8_t to) { return to >= from ? to - from : to + TURN_TICKS - from; }

// Remove pulses too short to be bits; return the number of edges left.
static uint8_t without_noise(uint8_t *ticks, uint8_t count) {
  uint8_t left = 0;
  for (uint8_t i = 0; i < count; i++)
    if (left && ticks_between(ticks[left - 1], ticks[i]) < NOISE)
      left--;
    else
      ticks[left++] = ticks[i];
  return left;
}

static uint8_t answer_in(uint8_t *ticks, uint8_t count) {
  uint8_t answer = 0;
  if (without_noise(ticks, count) < EDGES) return 0;
  for (uint8_t rise = 1; rise < EDGES; rise += 2) {
    uint8_t high = ticks_between(ticks[rise], ticks[rise + 1]);
    if (high < HIGH_LEAST || high > HIGH_MOST) return 0;
    answer = (uint8_t)(answer >> 1 | (high >= HIGH_ONE ? 0x80 : 0));
    if (rise + 2 == EDGES) break;
    uint8_t period = ticks_between(ticks[rise], ticks[rise + 2]);
    if (period < PERIOD_LEAST || period > PERIOD_MOST) return 0;
  }
  return answer;
}

void bus_answers(uint8_t answers[CHAINS]) {
  for (uint8_t i = 0; i < CHAINS; i++) answers[i] = answer_in(heard[i].ticks, heard[i].count);
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
