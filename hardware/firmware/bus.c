#include "bus.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

enum { PINS = (1 << CHAINS) - 1 };
enum { BIT_TICKS = 104, SAMPLE_TICKS = 26 };  // of 4 us: 416 us a bit, and four samples in that time
enum { BITS = 11, SAMPLES = 152, REST_BITS = 4, LONG_SAMPLES = 5 };

static enum { RESTING, SENDING, LISTENING } phase;
static volatile uint8_t outgoing[CHAINS][PACKET_BYTES];
static volatile uint8_t incoming[CHAINS];
static volatile bool finished, ready;
static uint8_t used, step, byte, shift[CHAINS];
static struct {
  uint8_t high, bits;
  bool started;
} ear[CHAINS];

void bus_use(uint8_t mask) {
  if (mask == used) return;
  TIMSK0 = 0;
  used = mask;
  DDRB &= (uint8_t)~PINS;
  PORTB |= mask;  // pulled up while nobody talks
  phase = RESTING;
  step = 0;
  ready = false;
  finished = true;
  incoming[0] = incoming[1] = 0;
  TCCR0A = 1 << WGM01;
  TCCR0B = 1 << CS01 | 1 << CS00;
  TCNT0 = 0;
  OCR0A = BIT_TICKS - 1;
  TIMSK0 = mask ? 1 << OCIE0A : 0;
}

static void send(void) {
  if (byte == PACKET_BYTES) {  // the last stop bit has been out for its time: let go of the line and listen
    DDRB &= (uint8_t)~PINS;
    OCR0A = SAMPLE_TICKS - 1;
    phase = LISTENING;
    step = 0;
    for (uint8_t i = 0; i < CHAINS; i++) ear[i].high = ear[i].bits = ear[i].started = 0;
    return;
  }
  uint8_t level = 0;
  for (uint8_t i = 0; i < CHAINS; i++) {
    if (step == 0) {
      shift[i] = outgoing[i][byte];
    } else {
      if (step > 8 || shift[i] & 1) level |= (uint8_t)(1 << i);
      shift[i] >>= 1;
    }
  }
  PORTB = (PORTB & (uint8_t)~used) | (level & used);
  DDRB |= used;
  if (++step == BITS) {
    step = 0;
    byte++;
  }
}

// A reply begins with a long low; then each bit is a high, long for a one, and a low.
static void listen(void) {
  uint8_t lines = PINB;
  for (uint8_t i = 0; i < CHAINS; i++) {
    if (lines & 1 << i) {
      ear[i].high++;
    } else {
      if (ear[i].started && ear[i].high && ear[i].bits < 8) {
        shift[i] = (uint8_t)(shift[i] >> 1 | (ear[i].high >= LONG_SAMPLES ? 0x80 : 0));
        ear[i].bits++;
      }
      ear[i].started = true;
      ear[i].high = 0;
    }
  }
  if (++step == SAMPLES) {
    for (uint8_t i = 0; i < CHAINS; i++) incoming[i] = ear[i].bits == 8 ? shift[i] : 0;
    OCR0A = BIT_TICKS - 1;
    phase = RESTING;
    step = 0;
    finished = true;
  }
}

// Gives way to the pulses' interrupt, which must not wait.
ISR(TIMER0_COMPA_vect, ISR_NOBLOCK) {
  if (phase == SENDING) {
    send();
  } else if (phase == LISTENING) {
    listen();
  } else if (step < REST_BITS) {
    step++;
  } else if (ready) {
    ready = false;
    phase = SENDING;
    step = byte = 0;
  }
}

bool bus_answers(uint8_t answers[CHAINS]) {
  if (!used || !finished) return false;
  finished = false;
  for (uint8_t i = 0; i < CHAINS; i++) answers[i] = incoming[i];
  return true;
}

void bus_send(uint8_t packets[CHAINS][PACKET_BYTES]) {
  for (uint8_t i = 0; i < CHAINS; i++)
    for (uint8_t k = 0; k < PACKET_BYTES; k++) outgoing[i][k] = packets[i][k];
  ready = true;
}
