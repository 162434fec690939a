// What interrupts leave to the main loop: bits of a register in which one instruction sets, tests or clears a bit.
#pragma once
#include <avr/io.h>

#define NEWS GPIOR0
enum { NEWS_BYTES = 1 << 0, NEWS_SLOT = 1 << 1, NEWS_ANSWERS = 1 << 2 };
