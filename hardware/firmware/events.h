// Events from interrupts to the main loop: bits of a register in which one instruction sets, tests or clears a bit.
#pragma once
#include <avr/io.h>

#define EVENTS GPIOR0
enum { EVENT_BYTES = 1 << 0, EVENT_SLOT = 1 << 1, EVENT_ANSWERS = 1 << 2 };
