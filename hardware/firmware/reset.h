// Why the board started, noted before anything else ran.
#pragma once
#include <stdint.h>

extern uint8_t reset_cause;  // the register MCUSR
