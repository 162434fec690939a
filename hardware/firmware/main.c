// Firmware of the servo board: an ATmega328P at 16 MHz, as on an Arduino Pro Mini, Nano or Uno.
//
// Interrupts make pulses, bits and bytes; this loop does everything else in small steps and feeds the watchdog.

#include <avr/cpufunc.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "bus.h"
#include "link.h"
#include "motion.h"
#include "events.h"
#include "pulses.h"
#include "reset.h"
#include "serial.h"

struct board board;
static uint16_t boots __attribute__((section(".noinit")));  // survives a reset, so that the host notices one

uint32_t board_now_us(void) { return pulses_now_us(); }
void board_send(const uint8_t *bytes, uint8_t count) { serial_write(bytes, count); }

// Measure the supply by reading the 1.1 V reference against it.
static void measure_supply(void) {
  if (ADCSRA & 1 << ADSC) return;
  uint16_t reading = ADC;
  if (reading) board.vcc_mv = (uint16_t)(1100UL * 1024 / reading);
  ADCSRA |= 1 << ADSC;
}

static void begin(void) {
  board.boots = ++boots;
  board.reset_cause = reset_cause;
  ADMUX = 1 << REFS0 | 0x0E;
  ADCSRA = 1 << ADEN | 1 << ADPS2 | 1 << ADPS1 | 1 << ADPS0;
  serial_begin();
  pulses_begin();
  wdt_enable(WDTO_120MS);
  set_sleep_mode(SLEEP_MODE_IDLE);
  sleep_enable();
  sei();
}

static void next_pulse(void) {
  uint8_t slot;
  uint32_t slot_us;
  pulses_next(&slot, &slot_us);
  pulses_set(slot, motion_slot(slot, slot_us));
  if (motion.state == DETACHED)
    for (uint8_t other = 0; other < PULSES; other++) pulses_set(other, 0);
  if (slot == 0) measure_supply();
}

static void next_packet(void) {
  uint8_t answers[CHAINS], packets[CHAINS][PACKET_BYTES];
  bus_answers(answers);
  for (uint8_t chain = 0; chain < CHAINS; chain++) chain_answer(chain, answers[chain]);
  motion_packet();
  for (uint8_t chain = 0; chain < CHAINS; chain++) chain_packet(chain, packets[chain]);
  bus_send(packets);
}

static inline __attribute__((always_inline)) bool take_event(uint8_t kind) {
  if (!(EVENTS & kind)) return false;
  EVENTS &= (uint8_t)~kind;
  return true;
}

int main(void) {
  begin();
  for (;;) {
    cli();
    if (!EVENTS) {  // most interrupts leave nothing to do
      sei();        // takes effect after the next instruction: no interrupt comes between the test and the sleep
      sleep_cpu();
      _NOP();  // the simulator takes a pending interrupt only after one more instruction
      continue;
    }
    sei();
    wdt_reset();
    uint8_t byte;
    if (take_event(EVENT_BYTES))
      while (serial_read(&byte)) {
        if (link_take(byte)) bus_use(motion.chains);
        if (take_event(EVENT_SLOT)) next_pulse();
      }
    if (take_event(EVENT_SLOT)) next_pulse();
    if (take_event(EVENT_ANSWERS)) next_packet();
  }
}
