// Firmware of the servo board: an ATmega328P at 16 MHz, as on an Arduino Pro Mini, Nano or Uno.
//
// Interrupts make pulses, bits and bytes; this loop does everything else, one small piece at a time, and feeds the watchdog.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "bus.h"
#include "link.h"
#include "motion.h"
#include "pulses.h"
#include "reset.h"
#include "serial.h"

struct board board;
static uint16_t boots __attribute__((section(".noinit")));  // survives a reset, so that a host notices one

uint32_t board_now_us(void) { return pulses_now_us(); }
void board_send(const uint8_t *bytes, uint8_t count) { serial_write(bytes, count); }

// The supply from what the 1.1 V reference reads against it.
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
  sei();
}

static void next_pulse(void) {
  uint8_t slot;
  uint32_t slot_us;
  if (!pulses_next(&slot, &slot_us)) return;
  motion_slot(slot, slot_us);
  pulses_set(slot, motion_pulse(slot));
  if (motion.state == DETACHED)
    for (uint8_t other = 0; other < PULSES; other++) pulses_set(other, 0);
  if (slot == 0) measure_supply();
}

static void next_packet(void) {
  uint8_t answers[CHAINS], packets[CHAINS][PACKET_BYTES];
  uint8_t used = 0;
  for (uint8_t chain = 0; chain < CHAINS; chain++)
    if (motion_has_chain(chain)) used |= 1 << chain;
  bus_use(used);
  if (!bus_answers(answers)) return;
  for (uint8_t chain = 0; chain < CHAINS; chain++) chain_answer(chain, answers[chain]);
  motion_packet();
  for (uint8_t chain = 0; chain < CHAINS; chain++) chain_packet(chain, packets[chain]);
  bus_send(packets);
}

int main(void) {
  begin();
  for (;;) {
    uint8_t byte;
    while (serial_read(&byte)) {
      link_take(byte);
      next_pulse();
    }
    next_pulse();
    next_packet();
    wdt_reset();
    cli();
    if (!serial_waiting()) {
      sleep_enable();
      sei();
      sleep_cpu();
      sleep_disable();
    }
    sei();
  }
}
