// Cause of the last reset, read before anything else runs.
#pragma once
#include <stdint.h>

extern uint8_t reset_cause;  // value of the register MCUSR
