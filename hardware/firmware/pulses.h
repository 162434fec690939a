// Six pulse outputs D2 to D7, one after the other, each edge exact to the cycle; and the board's clock. Timer 1.
#pragma once
#include <stdint.h>

void pulses_begin(void);
uint32_t pulses_now_us(void);

// The slot whose pulse is next, and its start; EVENT_SLOT follows every change.
void pulses_next(uint8_t *slot, uint32_t *slot_us);
void pulses_set(uint8_t slot, uint16_t cycles);  // 0 for none
