#include "pulses.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "motion.h"
#include "events.h"

// The timer counts cycles. The interrupt comes earlier than others can delay it, and then waits for its cycle.
enum { EARLY = 300, SLOT_CYCLES = SLOT_US * 16U, FIRST_PIN = 2 };
enum { OVERHEAD = 24 };  // cycles from reading the counter to the edge, without the waiting loop

static volatile uint16_t width[PULSES];
static volatile uint32_t overflows, next_us;  // start of the next slot
static volatile uint8_t next;                 // its number
static uint16_t edge, slot_edge;
static uint8_t slot;
static bool high;

void pulses_begin(void) {
  DDRD |= 0x3F << FIRST_PIN;
  slot_edge = edge = SLOT_CYCLES;
  next_us = SLOT_US;
  TCCR1A = 0;
  TCCR1B = 1 << CS10;
  OCR1A = edge - EARLY;
  TIMSK1 = 1 << OCIE1A | 1 << TOIE1;
}

ISR(TIMER1_OVF_vect) { overflows++; }

uint32_t pulses_now_us(void) {
  uint32_t high_part;
  uint16_t low_part;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    low_part = TCNT1;
    high_part = overflows;
    if ((TIFR1 & 1 << TOV1) && low_part < 0x8000) high_part++;
  }
  return (high_part << 12) + (low_part >> 4);  // 65536 cycles are 4096 us
}

ISR(TIMER1_COMPA_vect) {
  bool starts = !high;
  uint16_t cycles = starts ? width[slot] : 0;
  uint8_t port = PORTD & (uint8_t)~(0x3F << FIRST_PIN);
  if (cycles) port |= (uint8_t)(1 << FIRST_PIN) << slot;
  uint16_t left = edge - TCNT1 - OVERHEAD;
  if (left < 256) {
    uint8_t wait = (uint8_t)left;
    // Takes wait + 6 cycles: three per turn, the rest by branches to the next instruction, one cycle longer if taken.
    __asm__ volatile(
        "1: subi %0, 3 \n brcc 1b \n"
        "cpi %0, 254 \n brcc 2f \n 2: cpi %0, 255 \n brcc 3f \n 3: \n"
        : "+d"(wait));
  }
  PORTD = port;
  high = cycles;
  uint8_t following = slot + 1 == PULSES ? 0 : slot + 1;
  if (starts) {
    next = following;
    next_us += SLOT_US;
    EVENTS |= EVENT_SLOT;
  }
  if (high) {
    edge += cycles;
  } else {
    slot = following;
    edge = slot_edge += SLOT_CYCLES;
  }
  OCR1A = edge - EARLY;
}

void pulses_next(uint8_t *slot, uint32_t *slot_us) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    *slot = next;
    *slot_us = next_us;
  }
}

void pulses_set(uint8_t slot, uint16_t cycles) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { width[slot] = cycles; }
}
